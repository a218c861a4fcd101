"""The garden of statues and its walk, and simplification."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farfield.errors import OptionError
from farfield.scene.gltf.write import write_glb
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.garden import SECONDS, STOPS, GardenOptions, make_garden
from farfield.scene.procedural.walks import FPS
from farfield.scene.read import read_scene
from farfield.scene.simplify import simplify
from farfield.view.path import read_path
from scene.test_procedural import contents, edges

SMALL = GardenOptions(count=9, triangles=300, seed=2)


def test_is_the_same_every_time_and_counted(tmp_path: Path) -> None:
    one = make_garden(tmp_path / "a", SMALL)
    make_garden(tmp_path / "b", SMALL)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    # The blobs are of 300 triangles, pedestals have five sides, the ground is two.
    assert one.triangles == 9 * 300 + 9 * 10 + 2


def test_every_statue_is_a_mesh_of_its_own_and_stands_on_its_pedestal(tmp_path: Path) -> None:
    scene = read_scene([make_garden(tmp_path / "a", SMALL).path])
    lows = []
    for row, transform in zip(scene.instances.mesh, scene.instances.transform, strict=True):
        points = scene.meshes[row].load().positions @ transform[:, :3].T + transform[:, 3]
        lows.append(points[:, 2].min())
        assert points[:, 2].max() < 4
    assert sorted(np.round(lows, 3)) == [0.0] * 10 + [1.0] * 9
    heights = {round(float(np.ptp(mesh.load().positions[:, 2])), 6) for mesh in scene.meshes}
    # Nine statues, the pedestal, the ground.
    assert len(heights) == 11


def test_given_meshes_become_statues(tmp_path: Path) -> None:
    write_glb(tmp_path / "one.glb", blob(3_000, 7.0, 1))
    made = make_garden(tmp_path / "a", GardenOptions(count=4, triangles=500, meshes=(tmp_path / "one.glb",)))
    assert made.triangles == pytest.approx(4 * 510 + 2, rel=0.02)


def test_the_walk_stands_where_it_should_and_meets_nothing(tmp_path: Path) -> None:
    made = make_garden(tmp_path / "a", GardenOptions(triangles=12))
    path = read_path(made.path.parent / "path.json")
    eyes = np.array([frame.eye for frame in path.frames])
    assert len(eyes) == SECONDS * FPS
    steps = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    for begin, end in STOPS:
        assert (steps[round(begin * FPS) + 1 : round(end * FPS) - 1] < 1e-9).all()
    # A brisk walk, the same all the way.
    assert 0 < steps.max() * FPS < 5
    scene = read_scene([made.path])
    places = scene.instances.transform[:, :2, 3]
    middle = np.abs(places).max(axis=1) < 1e-9
    nearest = np.linalg.norm(eyes[:, None, :2] - places[~middle], axis=2).min()
    # It comes near, and passes beside the pedestals.
    assert 1.4 < nearest < 1.6


def test_nothing_to_make(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="1 statue"):
        make_garden(tmp_path, GardenOptions(count=0))


def test_simplified_bodies_stay_closed_and_in_place() -> None:
    mesh = blob(12_000, 10.0, 3)
    few = simplify(mesh, 1_000)
    assert len(few.triangles) == pytest.approx(1_000, rel=0.02)
    assert (edges(few) == 2).all()
    np.testing.assert_allclose(few.positions.min(axis=0), mesh.positions.min(axis=0), atol=0.3)
    np.testing.assert_allclose(few.positions.max(axis=0), mesh.positions.max(axis=0), atol=0.3)
    assert simplify(mesh, 20_000) is mesh
