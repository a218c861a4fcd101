"""The textured land with objects, and its walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farfield.errors import OptionError
from farfield.scene.procedural.land import roll
from farfield.scene.procedural.terrain import SECONDS, SIDE, STEP, TILES, TerrainOptions, make_terrain
from farfield.scene.procedural.walks import EYE, FPS
from farfield.scene.read import read_scene
from farfield.view.path import read_path
from scene.test_procedural import contents

SMALL = TerrainOptions(count=10, triangles=400, seed=3)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_terrain(tmp_path_factory.mktemp("terrain") / "a", SMALL).path


def test_is_the_same_every_time(made: Path, tmp_path: Path) -> None:
    make_terrain(tmp_path / "b", SMALL)
    assert contents(made.parent) == contents(tmp_path / "b")


def test_tiles_are_textured_and_objects_stand_on_the_land(made: Path) -> None:
    scene = read_scene([made])
    meshes = [source.load() for source in scene.meshes]
    textured = [mesh for mesh in meshes if mesh.materials[0].name == "land"]
    assert len(textured) == TILES**2
    assert len(meshes) == TILES**2 + SMALL.count
    looks = {mesh.materials[0].texture.pixels.tobytes() for mesh in textured if mesh.materials[0].texture}
    assert len(looks) == TILES**2
    land = roll(SIDE, STEP, 12.0, 0.3, 0, SMALL.seed)
    places = scene.instances.transform[:, :, 3]
    objects = np.array([meshes[row].materials[0].name != "land" for row in scene.instances.mesh])
    np.testing.assert_allclose(places[objects, 2], land.height_at(places[objects, :2]), atol=1e-3)


def test_the_walk_follows_the_land(made: Path) -> None:
    path = read_path(made.parent / "path.json")
    assert len(path.frames) == SECONDS * FPS
    eyes = np.array([frame.eye for frame in path.frames])
    land = roll(SIDE, STEP, 12.0, 0.3, 0, SMALL.seed)
    np.testing.assert_allclose(eyes[:, 2] - land.height_at(eyes[:, :2]), EYE, atol=1e-6)
    assert np.linalg.norm(np.diff(eyes[:, :2], axis=0), axis=1).max() * FPS < 6


def test_nothing_to_make(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="1 object"):
        make_terrain(tmp_path, TerrainOptions(count=0))
