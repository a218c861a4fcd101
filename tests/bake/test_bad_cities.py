"""Cities as people have them: what cannot stand is left out, what can is built, and so is all beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.represent.blockmap.coding import decode_blockmap
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene
from farfield.store.memory import MemoryStore
from farfield.world.keys import blockmap_key
from farfield.world.verification import verify_world
from farfield.world.world import World
from scene.test_footprints import AT, write

LEAF = 32.0
OPTIONS = BakeOptions(
    leaf_size=LEAF, resolution=32, workers=1, orthoviews=False, blockmap="32:192", object_ids=False, geometry=False
)
READ = ReadOptions(height_attribute="height", base_attribute="ground")
GOOD = [shapely.box(x, y, x + 9, y + 11) for x in range(0, 120, 20) for y in range(0, 120, 20)]
HEIGHT = 10.0
NOWHERE = -1e9
Building = tuple[shapely.Geometry | None, float, float]
"""Footprint, height and the altitude of its ground."""
BOW = shapely.Polygon([(10, 12), (18, 19), (18, 12), (10, 19)])
LARGE = shapely.box(-60, 130, 150, 190)


def read(folder: Path, *bad: Building) -> Scene:
    """The good buildings with others among them."""
    folder.mkdir(exist_ok=True)
    shapes = GOOD + [shape for shape, _, _ in bad]
    heights = [HEIGHT] * len(GOOD) + [height for _, height, _ in bad]
    ground = [0.0] * len(GOOD) + [altitude for _, _, altitude in bad]
    return read_scene([write(folder / "city.gpkg", shapes, height=heights, ground=ground)], READ)


def baked(scene: Scene) -> World:
    store = MemoryStore()
    bake(scene, store, OPTIONS)
    world = World.open(store)
    assert not verify_world(world).faults
    return world


def from_above(world: World) -> Callable[[float, float], float]:
    """Altitude of the highest top at a place of `GOOD`'s frame by BlockMaps of leaves; NOWHERE without one."""
    leaves = {}
    for entry in world.cells():
        if entry.cell.level == 0 and entry.blockmap is not None:
            key = blockmap_key(entry.cell, entry.blockmap.hash)
            leaves[entry.cell] = decode_blockmap(world.store.get(key), key).heights
    x0, y0, z0 = np.array(world.manifest.grid.corner) + world.manifest.origin

    def altitude(x: float, y: float) -> float:
        east, north = x + AT[0] - x0, y + AT[1] - y0
        highest = NOWHERE
        for cell, heights in leaves.items():
            i, j = (int((metres - at * LEAF) // (LEAF / 32)) for metres, at in ((east, cell.x), (north, cell.y)))
            if 0 <= i < 32 and 0 <= j < 32 and not np.isnan(heights[j, i]):
                highest = max(highest, z0 + cell.z * LEAF + float(heights[j, i]))
        return highest

    return altitude


def check_good_ones(altitude: Callable[[float, float], float]) -> None:
    for shape in GOOD:
        assert altitude(shape.centroid.x, shape.centroid.y) == pytest.approx(HEIGHT, abs=0.3)


WITHOUT_HEIGHT = "without height (above 0 and below 2,000 m)"
LEFT_OUT: dict[str, tuple[Building, str]] = {
    "no height": ((shapely.box(12, 0, 16, 4), np.nan, 0.0), WITHOUT_HEIGHT),
    "below nothing": ((shapely.box(12, 20, 16, 24), -5.0, 0.0), WITHOUT_HEIGHT),
    "a million km high": ((shapely.box(12, 40, 16, 44), 1e9, 0.0), WITHOUT_HEIGHT),
    "infinite": ((shapely.box(12, 60, 16, 64), np.inf, 0.0), WITHOUT_HEIGHT),
    "a line": ((shapely.Polygon([(0, 12), (10, 12), (20, 12), (0, 12)]), 10.0, 0.0), "of no area"),
    "no footprint": ((None, 10.0, 0.0), "without a shape"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_what_cannot_stand_is_told_and_left_out(tmp_path: Path, name: str) -> None:
    building, says = LEFT_OUT[name]
    scene = read(tmp_path, building)
    (warning,) = scene.warnings
    assert "left out 1 f" in warning
    assert says in warning
    assert scene.object_count == len(GOOD)


def test_the_rest_of_a_city_is_built(tmp_path: Path) -> None:
    """And is what it is without them, to the byte."""
    alone = read(tmp_path / "alone")
    with_bad = read(tmp_path / "bad", *(building for building, _ in LEFT_OUT.values()))
    assert len(with_bad.warnings) == 3
    contents = []
    for scene in (alone, with_bad):
        store = MemoryStore()
        bake(scene, store, OPTIONS)
        contents.append({key: store.get(key) for key in store.list("blockmap")})
    assert contents[0] == contents[1]


STRANGE: dict[str, tuple[list[Building], list[tuple[float, float, float]]]] = {
    "crosses itself": ([(BOW, 10.0, 0.0)], [(16.5, 15.5, 10.0), (11.5, 15.5, 10.0), (14, 18.5, NOWHERE)]),
    "larger than a leaf": ([(LARGE, 12.0, 0.0)], [(-50, 135, 12.0), (50, 160, 12.0), (145, 185, 12.0)]),
    "500 m high": ([(shapely.box(50, 50, 58, 58), 500.0, 0.0)], [(54, 54, 500.0)]),
    "partly underground": ([(shapely.box(70, 75, 78, 78), 34.0, -30.0)], [(74, 76, 4.0)]),
    "all underground": ([(shapely.box(90, 92, 98, 98), 12.0, -30.0)], [(94, 95, -18.0)]),
    "one in the other": (
        [(shapely.box(30, 70, 38, 78), 14.0, 0.0), (shapely.box(34, 74, 42, 82), 20.0, 0.0)],
        [(32, 72, 14.0), (36, 76, 20.0), (40, 81, 20.0)],
    ),
    "one twice": ([(shapely.box(50, 14, 58, 18), 14.0, 0.0)] * 2, [(54, 16, 14.0)]),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_strange_is_built(tmp_path: Path, name: str) -> None:
    buildings, points = STRANGE[name]
    altitude = from_above(baked(read(tmp_path, *buildings)))
    for x, y, wanted in points:
        assert altitude(x, y) == pytest.approx(wanted, abs=0.3)
    check_good_ones(altitude)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_million_buildings_in_a_leaf_are_built(tmp_path: Path) -> None:
    """Three minutes and 6 GB of memory, on two cores."""
    random = np.random.default_rng(1)
    lower, size = random.uniform(0, 1000, (1_000_000, 2)), random.uniform(3, 15, (1_000_000, 2))
    shapes = shapely.box(*lower.T, *(lower + size).T)
    path = write(tmp_path / "city.fgb", list(shapes), height=random.uniform(4, 40, len(shapes)).tolist())
    scene = read_scene([path], ReadOptions(height_attribute="height"))
    store = MemoryStore()
    bake(scene, store, BakeOptions(leaf_size=1024.0, resolution=64, workers=1, orthoviews=False, blockmap="64:256"))
    world = World.open(store)
    assert not verify_world(world).faults
    assert sum(entry.geometry.triangles for entry in world.cells() if entry.cell.level == 0 and entry.geometry) >= 1e7
