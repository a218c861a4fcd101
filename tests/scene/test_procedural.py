"""Made scenes: the same for the same seed, of the size asked for; and the bundled demo scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import farfield
from farfield.errors import OptionError
from farfield.scene.model import Mesh
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.land import roll, tile
from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape
from farfield.scene.procedural.made import count_triangles
from farfield.scene.procedural.objects import ObjectsOptions, floating, make_objects
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.scene.read import read_scene

SMALL = LandscapeOptions(side=260, step=8, towns=1, tree_triangles=1500, trees_per_hectare=30, seed=4)
DEMO = Path(farfield.__file__).parent / "demo"


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def edges(mesh: Mesh) -> np.ndarray:
    """Undirected edges by the places of their ends, sorted."""
    _, same = np.unique(np.round(mesh.positions, 6), axis=0, return_inverse=True)
    corners = same.reshape(-1)[mesh.triangles]
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    return np.unique(np.sort(pairs, 1), axis=0, return_counts=True)[1]


@pytest.mark.parametrize("triangles", [300, 12_000])
def test_blobs_are_closed_and_of_the_size_asked_for(triangles: int) -> None:
    mesh = blob(triangles, 10.0, 3)
    assert len(mesh.triangles) == pytest.approx(triangles, rel=0.1)
    assert np.ptp(mesh.positions, axis=0).max() == pytest.approx(10)
    assert (edges(mesh) == 2).all()
    corners = mesh.positions[mesh.triangles]
    assert np.einsum("mc,mc->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0


def test_objects_keep_their_distance() -> None:
    table = floating(ObjectsOptions(count=200))
    places = table[:, :3]
    distance = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e9 * np.eye(200)
    assert distance.min() > 0.35 * 22
    assert (table[:, 7] >= 0.7).all()


def test_objects_are_deterministic_and_counted(tmp_path: Path) -> None:
    options = ObjectsOptions(count=20, triangles=300, kinds=3, seed=7)
    one, two = make_objects(tmp_path / "a", options), make_objects(tmp_path / "b", options)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert (one.triangles, one.bytes) == (two.triangles, two.bytes)
    assert one.bytes == sum(file.stat().st_size for file in (tmp_path / "a").iterdir())
    scene = read_scene([tmp_path / "a"])
    assert scene.object_count == 20
    assert count_triangles(scene) == one.triangles == 20 * 300
    other = make_objects(tmp_path / "c", ObjectsOptions(count=20, triangles=300, kinds=3, seed=8))
    assert contents(other.path.parent) != contents(tmp_path / "a")


def test_objects_of_given_meshes_have_the_diameter(tmp_path: Path) -> None:
    made = make_objects(tmp_path / "a", ObjectsOptions(count=1, triangles=300, kinds=1))
    mesh = made.path.parent / "object-0.glb"
    given = make_objects(tmp_path / "b", ObjectsOptions(count=5, meshes=(mesh,), diameter=3.0))
    scene = read_scene([given.path])
    points = scene.meshes[0].load().positions
    for matrix in scene.instances.transform:
        scale = np.cbrt(np.linalg.det(matrix[:, :3]))
        assert 0.7 * 3 <= scale * np.ptp(points, axis=0).max() <= 1.3 * 3
    # An odd turn would move an object whose middle is not at zero.
    middle = (points.min(0) + points.max(0)) / 2
    centers = scene.instances.transform @ np.append(middle, 1)
    np.testing.assert_allclose(np.sort(centers, 0), np.sort(floating(ObjectsOptions(count=5, diameter=3.0))[:, :3], 0))


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(OptionError) as caught:
        make_objects(tmp_path, ObjectsOptions(count=1))
    assert str(caught.value) == f"{tmp_path}: holds something else (give an empty folder with -o)"


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_trees_stand_upright(shape: object) -> None:
    mesh = tree(shape, 4000, 1)  # type: ignore[arg-type]
    assert len(mesh.triangles) == pytest.approx(4000, rel=0.05)
    low, high = mesh.positions.min(0), mesh.positions.max(0)
    assert low[2] == pytest.approx(0, abs=0.05)
    assert 0.75 * shape.height < high[2] < 1.25 * shape.height  # type: ignore[attr-defined]
    leaves = mesh.positions[mesh.triangles[mesh.triangle_material == 1]]
    assert leaves[..., 2].mean() > 0.4 * high[2]
    assert mesh.materials[1].alpha_cutoff == 0.5


def test_land_tiles_meet_and_heights_lie_on_them() -> None:
    land = roll(400, 8, 10, 0.4, 1, 2)
    left, right = tile(land, (0, 0), (50, 25)), tile(land, (0, 25), (50, 50))
    border = land.step * 25
    ours = left.positions[left.positions[:, 0] == border]
    np.testing.assert_array_equal(ours, right.positions[right.positions[:, 0] == border])
    centers = left.positions[left.triangles].mean(1)
    np.testing.assert_allclose(land.height_at(centers[:, :2]), centers[:, 2], atol=1e-9)
    assert (left.normals[:, 2] > 0).all()


def test_landscape_is_deterministic_and_whole(tmp_path: Path) -> None:
    one, two = make_landscape(tmp_path / "a", SMALL), make_landscape(tmp_path / "b", SMALL)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert one.triangles == two.triangles
    scene = read_scene([tmp_path / "a"])
    names = {Path(source.name).name.split(",")[0].split("-")[0] for source in scene.meshes}
    assert names == {"land", "towns.fgb", "tree"}
    assert scene.warnings == ()
    land = roll(260, 8, 18, 0.4, 1, 4)
    placed = [(scene.meshes[row].name, matrix[:, 3])
              for row, matrix in zip(scene.instances.mesh, scene.instances.transform, strict=True)]  # fmt: skip
    trees = np.array([place for name, place in placed if "tree-" in name])
    assert not land.in_towns(trees[:, :2]).any()
    np.testing.assert_allclose(land.height_at(trees[:, :2]), trees[:, 2] + 0.1, atol=1e-6)


def test_the_default_landscape_has_a_hundred_million_triangles() -> None:
    options = LandscapeOptions()
    hectares = options.side**2 / 1e4 * options.forest_share
    assert hectares * options.trees_per_hectare * options.tree_triangles > 1.2e8


def test_demo_scene_is_small_credited_and_without_faults() -> None:
    assert sum(file.stat().st_size for file in DEMO.rglob("*") if file.is_file()) < 5_000_000
    scene = read_scene([DEMO])
    assert scene.warnings == ()
    assert scene.crs == "EPSG:6677"
    text = " ".join(scene.credits)
    assert all(name in text for name in ("PLATEAU", "CC BY 4.0", "Three D Scans", "ez-tree"))
    meshes = {Path(source.name).name: source.load() for source in scene.meshes}
    assert all(mesh.warnings == () for mesh in meshes.values())
    instances = np.bincount(scene.instances.mesh)
    assert sum(instances[k] for k, source in enumerate(scene.meshes) if ".npy" not in source.name) > 250
    assert {"pan.glb", "eagle.glb", "theodoric_the_great.glb"} <= meshes.keys()
    credits = (DEMO / "LICENSES/CREDITS.md").read_text()
    assert all(file.name in credits for file in DEMO.glob("*.*b"))
