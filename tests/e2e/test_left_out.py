"""Option `farOnly`: what reaches into leaves that are left out is left out there, too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bake.scenes import Held, ground
from e2e.browsing import Visit
from e2e.test_instances import COLORS, kinds, statue
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.scene.model import Instances, Scene
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore
from farfield.world.world import World

LEAF = 8.0
CAMERA = Camera((4.0, -6.0, 4.0), (10.0, 4.0, 2.0), 60.0)
NEAR = 7.0
"""Metres: within them lies the first leaf, from 0 to LEAF along x and y, and no other one in the picture."""
ALONG = 4.0
"""Times that the statue is stretched along x."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> DirectoryStore:
    """A statue in the second leaf, an arm of which reaches through the first."""
    turned = np.array([[-ALONG, 0, 0, 12.0], [0, -1.0, 0, 4.0], [0, 0, 1.0, 0.2]])
    meshes = (Held(ground(0.5, 23.5), "ground"), Held(statue(3), "statue"))
    instances = Instances(
        np.arange(2, dtype=np.int32), np.stack([np.eye(3, 4), turned]), np.arange(1, 3), np.ones(2, int)
    )
    place = DirectoryStore(tmp_path_factory.mktemp("left-out") / "statue")
    grid = {"leaf_size": LEAF, "resolution": 64, "corner": (0.0, 0.0, -LEAF / 2)}
    bake(Scene(list(meshes), instances, object_count=2), place, BakeOptions(**grid, directions="9", workers=2))  # type: ignore[arg-type]
    listed = {entry.key: len(entry.instances) for entry in World.open(place).cells() if entry.instances}
    assert listed == {"0/1/0/0": 1}, "the first leaf lists nothing"
    return place


def test_instances_are_cut_at_what_is_left_out(visit: Callable[..., Visit], store: DirectoryStore) -> None:
    wall = CAMERA.matrix((640, 480)) @ np.array([LEAF, 4.0, 2.2, 1.0])
    column = wall[0] / wall[2]
    with serving(store, ServeOptions(port=0)) as url:
        page = visit(url + "?sessions=0")
        page.options(fade=0, supersampling=2, sky="rgb(40, 42, 46)", nearRadius=NEAR, farGeometry=True)
        first = []
        for is_cut in (False, True):
            page.options(farOnly=is_cut)
            page.look(CAMERA.eye, CAMERA.target, CAMERA.fov)
            page.page.wait_for_function("farfield.stats().triangles > 100")
            shown = np.flatnonzero((kinds(page.picture()) < len(COLORS)).any(0) & (kinds(page.picture()) >= 0).any(0))
            first.append(int(shown[0]))
        page.leave()
    assert first[0] < column - 30
    assert abs(first[1] - column) < 8
