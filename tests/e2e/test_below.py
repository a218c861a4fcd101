"""Leaves below far cells: a page without a session learns of them once it rests, and shows what they show more."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from bake.scenes import box, ground, scene_of
from e2e.browsing import Visit
from e2e.test_instances import statue
from e2e.world import ROOF
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.octree.cut import cut, near_radius
from farfield.scene.model import Scene
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore
from farfield.world.world import World

LEAF = 8.0
REACH = 16 * LEAF
"""Metres: that many leaves have four levels above them, of which the lowest begins index tiles of its own."""
EYE, TARGET = (-110.0, -120.0, 60.0), (12.0, 12.0, 1.0)
FOV = 45.0
ASKED = "performance.getEntriesByType('resource').map(({name}) => name)"
"""Addresses that the page has asked for."""


def scene() -> Scene:
    """Statues on a ground in one corner, and a box in the other."""
    places = [(x, y, 0.4) for x in (4.0, 12.0, 20.0) for y in (4.0, 12.0, 20.0)]
    far = box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0), ROOF)
    return scene_of((ground(0.5, 23.5), [(0.0, 0.0, 0.0)]), (statue(1), places), (far, [(REACH - 3, REACH - 3, 0.0)]))


@pytest.fixture(scope="module")
def village(tmp_path_factory: pytest.TempPathFactory) -> DirectoryStore:
    """The village, baked."""
    store = DirectoryStore(tmp_path_factory.mktemp("below") / "village")
    grid = {"leaf_size": LEAF, "resolution": 64, "corner": (0.0, 0.0, -LEAF / 2)}
    bake(scene(), store, BakeOptions(**grid, directions="9", workers=2))  # type: ignore[arg-type]
    return store


def test_a_page_at_rest_reads_the_index_below_far_cells(visit: Callable[..., Visit], village: DirectoryStore) -> None:
    world = World.open(village)
    radius = near_radius(world.grid, 640, 2 * math.atan(math.tan(math.radians(FOV / 2)) * 640 / 480))
    drawn = cut(world, world.grid, np.array(EYE), radius)
    assert min(key.level for key in drawn.pictures) > 0, "the cut needs nothing of the tiles that begin there"
    at, to = (",".join(map(str, place)) for place in (EYE, TARGET))
    with serving(village, ServeOptions(port=0)) as url:
        page = visit(f"{url}?sessions=0#eye={at}&target={to}&fov={FOV}")
        page.complete()
        page.page.wait_for_function(f"{ASKED}.some((name) => name.includes('index/1/'))")
        page.page.wait_for_function("farfield.stats().triangles > 0")
        page.leave()
