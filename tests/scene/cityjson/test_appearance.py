"""Colours, materials, textures and façades."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from farfield.bake.survey import MeshCache, survey, survey_mesh
from farfield.progress import NoProgress
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.decoded import DecodedImages
from farfield.scene.cityjson.read import read_cityjson
from farfield.scene.footprints.facades import BAYS, FACADES, FLOORS
from farfield.scene.model import Mesh, Scene
from farfield.scene.options import ReadOptions
from scene.cityjson.small_city import CUBE, City, box, load, moved, notes, semantics

NAMES = {facade.name for facade in FACADES}
FACING = [(0, 0, -1), (0, 0, 1), (0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0)]


def on_side(mesh: Mesh, side: int) -> tuple[Any, str, Any]:
    """Colour, material and uvs (n, 2) of a side of the only cube."""
    own = np.flatnonzero((mesh.normals[mesh.triangles[:, 0]] @ np.array(FACING[side])) > 0.9)
    assert len(own) == 2
    assert mesh.colors is not None
    assert mesh.uvs is not None
    corners = np.unique(mesh.triangles[own])
    material = mesh.materials[mesh.triangle_material[own[0]]]
    return mesh.colors[corners[0], :3].tolist(), material.name, mesh.uvs[corners]


@pytest.mark.parametrize("told", [True, False])
def test_buildings_have_facades_roofs_and_ground(tmp_path: Path, told: bool) -> None:
    city = City()
    city.add("a", city.cube(**(semantics() if told else {})))
    mesh = load(city.read(tmp_path))
    for side in range(2, 6):
        _, name, uvs = on_side(mesh, side)
        assert name in NAMES
        # Whole bays and floors: no window is cut.
        size = np.ptp(uvs, axis=0) * (BAYS, FLOORS)
        np.testing.assert_allclose(size, [3 if side % 2 == 0 else round(8 / 3), 2], atol=1e-5)
    assert on_side(mesh, 1)[1] == "plain"
    assert on_side(mesh, 0)[0] == [112, 106, 98]
    plain = load(city.read(tmp_path, facades=False))
    assert {material.name for material in plain.materials} == {"plain"}


def test_windows_stand_upright(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube())
    mesh = load(city.read(tmp_path))
    assert mesh.uvs is not None
    walls = np.abs(mesh.normals[:, 2]) < 0.1
    points, uvs, normals = mesh.positions[walls], mesh.uvs[walls], mesh.normals[walls]
    right = (points[:, :2] * np.stack([-normals[:, 1], normals[:, 0]], -1)).sum(1)
    for side in FACING[2:]:
        own = normals @ side > 0.9
        assert np.corrcoef(uvs[own, 0], right[own])[0, 1] > 0.99
        assert np.corrcoef(uvs[own, 1], points[own, 2])[0, 1] < -0.99


def test_walls_of_several_faces_are_one(tmp_path: Path) -> None:
    city = City()
    corners = [[0, 0, 0], [5, 0, 0], [12, 0, 0], [12, 0, 6], [5, 0, 9], [0, 0, 6]]
    city.points(corners)
    faces = [[[0, 1, 4]], [[0, 4, 5]], [[1, 2, 3, 4]]]
    # Another wall in the same plane that does not touch.
    first = city.points(np.array(corners)[[0, 1, 4, 5]] + (40, 0, 0))
    city.add("a", city.geometry([*faces, [[first, first + 1, first + 2, first + 3]]], "MultiSurface"))
    mesh = load(city.read(tmp_path))
    assert mesh.uvs is not None
    one = mesh.positions[:, 0] < 20
    place = {tuple(point): uv for point, uv in zip(mesh.positions[one].round(3), mesh.uvs[one].tolist(), strict=True)}
    for point, uv in zip(mesh.positions[one].round(3), mesh.uvs[one], strict=True):
        np.testing.assert_allclose(place[tuple(point)], uv, atol=1e-6)
    assert np.ptp(mesh.uvs[one, 0]) * BAYS == pytest.approx(4)
    assert np.ptp(mesh.uvs[~one, 0]) * BAYS == pytest.approx(2)


def test_looks_follow_from_the_place_alone(tmp_path: Path) -> None:
    one, two = City(), City()
    one.add("a", one.cube())
    two.add("z", two.cube(corners=box(x=-50)))
    two.add("a", two.cube())
    first, both = load(one.read(tmp_path)), load(two.read(tmp_path))
    assert first.colors is not None
    assert both.colors is not None
    own = {tuple(color) for color in both.colors.tolist()}
    assert {tuple(color) for color in first.colors.tolist()} <= own


def test_windows_doors_and_closures(tmp_path: Path) -> None:
    city = City()
    names = ["GroundSurface", "ClosureSurface", "WallSurface", "Window", "Door", "+Odd"]
    city.add("a", city.cube(**semantics(names)))
    mesh = load(city.read(tmp_path))
    assert len(mesh.triangles) == 10
    assert on_side(mesh, 3)[0] == [70, 84, 98]
    assert on_side(mesh, 4)[0] == [104, 78, 58]
    # What has windows of its own gets no others.
    assert {material.name for material in mesh.materials} == {"plain"}


@pytest.mark.parametrize(("kind", "color"), [("PlantCover", [98, 126, 64]), ("WaterBody", [70, 104, 132]),
                                             ("Road", [92, 92, 94]), ("TINRelief", [122, 126, 88])])  # fmt: skip
def test_colours_by_type(tmp_path: Path, kind: str, color: list[int]) -> None:
    city = City()
    city.add("a", city.cube(), kind=kind)
    mesh = load(city.read(tmp_path))
    assert mesh.colors is not None
    np.testing.assert_allclose(mesh.colors[0, :3], color, rtol=0.09)
    assert {material.name for material in mesh.materials} == {"plain"}


def test_materials(tmp_path: Path) -> None:
    city = City()
    values = [[None, 0, 1, 2, 3, 99]]
    themes = {"winter": {"value": 1}, "summer": {"values": values}}
    city.add("a", city.cube(material=themes, **semantics()))
    city.json["appearance"] = {
        "default-theme-material": "summer",
        "materials": [{"diffuseColor": [1, 0.5, 0]}, {"diffuseColor": [0, 0, 1], "transparency": 0.2},
                      {"diffuseColor": [0, 0, 1], "transparency": 0.9}, {"name": "says nothing"}],
    }  # fmt: skip
    scene = city.read(tmp_path)
    mesh = load(scene)
    assert on_side(mesh, 1)[:2] == ([255, 128, 0], "plain")
    assert on_side(mesh, 2)[:2] == ([0, 0, 255], "plain")
    assert on_side(mesh, 4)[1] in NAMES
    assert on_side(mesh, 5)[1] in NAMES
    assert len(mesh.triangles) == 10
    assert notes(scene) == ["left out 1 surface more than half transparent"]
    del city.json["appearance"]["default-theme-material"]
    mesh = load(city.read(tmp_path))
    assert {tuple(row) for row in np.asarray(mesh.colors)[:, :3].tolist()} == {(0, 0, 255)}


def textured(city: City, image: str = "look/roof.png") -> None:
    rings = [[[None]], [[0, 0, 1, 2, 3]], [[0, 3, 0, 1, 2]], [[0, 0, 1, 2]], [[7, 0, 1, 2, 3]], [[0, 0, 1, 2, 99]]]
    city.add("a", city.cube(texture={"visual": {"values": [rings]}}, **semantics()))
    city.json["appearance"] = {"textures": [{"type": "PNG", "image": image}],
                               "vertices-texture": [[0, 0.25], [1, 0.25], [1, 1], [0, 1]]}  # fmt: skip


def test_textures(tmp_path: Path) -> None:
    (tmp_path / "look").mkdir()
    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[0] = (255, 0, 0)
    Image.fromarray(pixels).save(tmp_path / "look/roof.png")
    city = City()
    textured(city)
    scene = city.read(tmp_path)
    mesh = load(scene)
    color, name, uvs = on_side(mesh, 1)
    assert (color, name) == ([255, 255, 255], "image")
    corners = {tuple(point): uv for point, uv in zip(mesh.positions.tolist(), mesh.uvs.tolist(), strict=True)  # type: ignore[union-attr]
               if point[2] == 6}  # fmt: skip
    assert np.ptp(uvs, axis=0).tolist() == [1, 0.75]
    assert {tuple(uv) for uv in uvs.tolist()} == {(0, 0.75), (1, 0.75), (1, 0), (0, 0)}
    assert len(corners) == 4
    texture = next(m.texture for m in mesh.materials if m.name == "image")
    assert texture is not None
    assert texture.pixels[0, 0].tolist() == [255, 0, 0, 255]
    assert notes(scene) == ["3 surfaces have texture coordinates that do not exist, and default colours"]
    assert on_side(mesh, 3)[1] in NAMES


@pytest.mark.parametrize("image", ["https://example.org/a.png", "gone.png", "", None, "\0"])
def test_missing_images(tmp_path: Path, image: Any) -> None:
    city = City()
    textured(city, image)
    scene = city.read(tmp_path)
    if image:
        assert notes(scene)[0] == f"cannot find the image {image}; their surfaces have default colours"
    assert on_side(load(scene), 2)[1] in NAMES


def test_images_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no image")
    city = City()
    textured(city, "a.png")
    scene = city.read(tmp_path)
    assert notes(scene)[0] == "cannot read the image a.png; their surfaces have default colours"
    assert load(scene).warnings == ()
    assert on_side(load(scene), 2)[1] in NAMES


def street(folder: Path, images: list[str]) -> Scene:
    """A chunk for each house; the roof of each has the next image, and the last has none."""
    city = City()
    city.json["appearance"] = {"textures": [{"image": name} for name in images],
                               "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]}  # fmt: skip
    for number in range(len(images) + 1):
        roof = [[number, 0, 1, 2, 3]] if number < len(images) else [[None]]
        values = [[[[None]], roof, *[[[None]]] * 4]]
        city.add(f"{number}", city.cube(corners=box(x=20 * number), texture={"visual": {"values": values}}))
    return read_cityjson(city.write(folder / "a.city.json"), ReadOptions(), most=24)


def image_of(source: CityChunk) -> int | None:
    """The red of the chunk's only texture; None without one."""
    reds = [material.texture.pixels[0, 0, 0] for material in source.load().materials if material.name == "image"
            and material.texture is not None]  # fmt: skip
    assert len(reds) <= 1
    return int(reds[0]) if reds else None


def test_chunks_have_the_images_of_their_own_faces(tmp_path: Path) -> None:
    names = ["a.png", "b.png", "c.png"]
    for red, name in enumerate(names):
        Image.new("RGB", (4, 4), (red, 0, 0)).save(tmp_path / name)
    chunks = [source for source in street(tmp_path, names).meshes if isinstance(source, CityChunk)]
    assert sorted([Path(image.path).name for image in chunk.images] for chunk in chunks) == [
        [], ["a.png"], ["b.png"], ["c.png"]]  # fmt: skip
    for chunk in chunks:
        assert image_of(chunk) == (names.index(Path(chunk.images[0].path).name) if chunk.images else None)


def test_decoded_images_are_bounded(tmp_path: Path) -> None:
    for name in "abc":
        Image.new("RGB", (8, 8)).save(tmp_path / f"{name}.png")
    chunks = [source for source in street(tmp_path, ["a.png", "b.png", "c.png"]).meshes
              if isinstance(source, CityChunk)]  # fmt: skip
    a, b, c = (image for chunk in chunks for image in chunk.images)
    decoded = DecodedImages(2 * 8 * 8 * 4)
    first, second = decoded.get(a), decoded.get(b)
    assert decoded.get(a) is first
    decoded.get(c)
    assert decoded.get(a) is first
    assert decoded.get(b) is not second


def test_a_damaged_image_is_told_of_once(tmp_path: Path) -> None:
    Image.effect_noise((64, 64), 50).save(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:500])
    scene = street(tmp_path, ["a.png", "a.png"])
    assert scene.warnings == ()
    said: list[str] = []

    class Listening(NoProgress):
        def note(self, text: str) -> None:
            said.append(text)

    cache = MeshCache(scene)
    survey([None] * 3, lambda wanted: (survey_mesh(cache, k, scene.meshes[k]) for k in wanted), Listening())
    assert said == [f"{tmp_path}/a.png: is not an image that can be read; its surfaces have default colours"]


def test_mirrored_walls_of_a_multisurface_are_seen_from_both_sides(tmp_path: Path) -> None:
    city = City()
    first = city.points(box())
    inwards = [[ring[::-1] for ring in surface] for surface in moved(CUBE, first)]
    city.add("a", city.geometry(inwards, **semantics(nested=0)))
    mesh = load(city.read(tmp_path))
    assert all(material.double_sided for material in mesh.materials)
