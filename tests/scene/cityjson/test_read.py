"""City objects parted by place, and real files."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.read import read_cityjson
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene
from scene.cityjson.small_city import City, box


def town(folder: Path, side: int = 12) -> Path:
    """side x side boxes, 40 m apart, of heights of their own."""
    city = City()
    for k in range(side * side):
        corners = box(x=40 * (k % side), y=40 * (k // side), height=3 + k / 10)
        city.add(f"b{k}", city.cube(corners=corners), attributes={"height": 3 + k / 10})
    return city.write(folder / "town.city.json")


def heights(scene: Scene) -> dict[int, float]:
    """Object → its height as drawn."""
    found = {}
    for mesh, first in zip(scene.instances.mesh, scene.instances.first_object, strict=True):
        loaded = scene.meshes[mesh].load()
        assert loaded.triangle_object is not None
        for own in range(loaded.object_count):
            z = loaded.positions[loaded.triangles[loaded.triangle_object == own], 2]
            found[int(first) + own] = float(np.ptp(z))
    return found


def test_large_files_become_many_meshes(tmp_path: Path) -> None:
    path = town(tmp_path)
    whole, parted = read_scene([path]), read_cityjson(path, ReadOptions(), most=24 * 20)
    assert len(whole.meshes) == 1
    assert len(parted.meshes) > 7
    assert all(len(mesh.load().triangles) <= 240 for mesh in parted.meshes)
    assert whole.object_count == parted.object_count == 144
    for scene in (whole, parted):
        drawn = heights(scene)
        for row, told in enumerate(scene.attributes["height"]):
            assert drawn[row + 1] == pytest.approx(told, abs=1e-3)
    size = len(pickle.dumps(parted.meshes[0]))
    assert size < 20_000


def test_one_large_object_is_read_in_pieces(tmp_path: Path) -> None:
    city = City()
    side = 30
    x, y = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    city.points(np.stack([x.ravel() * 10, y.ravel() * 10, (x * y % 7).ravel()], -1))
    at = (y[:-1, :-1] * (side + 1) + x[:-1, :-1]).ravel()
    lower, upper = [at, at + 1, at + side + 2], [at, at + side + 2, at + side + 1]
    triangles = np.concatenate([np.stack(lower, -1), np.stack(upper, -1)])
    city.add("ground", city.geometry([[t] for t in triangles.tolist()], "CompositeSurface"), kind="TINRelief")
    city.add("house", city.cube(corners=box(x=100)))
    scene = read_cityjson(city.write(tmp_path / "a.json"), ReadOptions(), most=400)
    assert scene.object_count == 2
    assert scene.instances.first_object[0] == 1
    assert set(scene.instances.first_object[1:].tolist()) == {2}
    assert scene.attributes["id"].tolist() == ["house", "ground"]
    meshes = [mesh.load() for mesh in scene.meshes]
    assert sum(len(mesh.triangles) for mesh in meshes) == 1800 + 12
    assert all(len(mesh.triangles) <= 400 for mesh in meshes)


def test_the_order_of_the_file_does_not_matter(tmp_path: Path) -> None:
    path = town(tmp_path, 4)
    city = City()
    for k in reversed(range(16)):
        city.add(f"b{k}", city.cube(corners=box(x=40 * (k % 4), y=40 * (k // 4), height=3 + k / 10)))
    one, two = read_scene([path]), read_scene([city.write(tmp_path / "back.json")])
    assert one.attributes["id"].tolist() == two.attributes["id"].tolist()
    first, second = one.meshes[0].load(), two.meshes[0].load()
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.colors, second.colors)


REAL = [
    ("vienna_cityjson/vienna.city.jsonl", 149, 9_412, 39_330, None),
    ("denhaag_cityjson/DenHaag_01.json", 845, 21_804, 41_183, "EPSG:28992"),
    ("delft_cityjson/delft.city.json", 570, 36_271, 36_266, "EPSG:28992"),
    ("delfshaven_cityjson/3-20-DELFSHAVEN.city.json", 853, 15_482, 37_507, "EPSG:28992"),
]
"""File, objects, faces, triangles, CRS. Vienna has each of its surfaces twice, with semantics and as a solid."""


@pytest.mark.parametrize(("name", "objects", "faces", "triangles", "crs"), REAL)
def test_real_files(
    shared_data: Callable[[str], Path], name: str, objects: int, faces: int, triangles: int, crs: str | None
) -> None:
    scene = read_scene([shared_data(name)])
    assert (scene.object_count, scene.crs) == (objects, crs)
    sources = [source for source in scene.meshes if isinstance(source, CityChunk)]
    assert sum(len(source.faces) for source in sources) == faces
    meshes = [source.load() for source in sources]
    assert sum(len(mesh.triangles) for mesh in meshes) == triangles
    assert all(np.isfinite(mesh.positions).all() for mesh in meshes)
    a, b, c = (np.concatenate([mesh.positions[mesh.triangles[:, k]] for mesh in meshes]) for k in range(3))
    normals = np.concatenate([mesh.normals[mesh.triangles[:, 0]] for mesh in meshes])
    # Flat normals: those of the triangles themselves but for faces that are not plane.
    assert np.median((np.cross(b - a, c - a) * normals).sum(1)) > 0
