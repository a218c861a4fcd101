"""Worlds drawn from a part of their values, as by a viewer that has no more of them yet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from e2e.world import town
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.store import MemoryStore
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

CAMERA, SIZE = Camera((-40.0, -42.0, 8.0), (0.0, 0.0, 2.0)), (80, 60)


@pytest.fixture(scope="module")
def world() -> World:
    store = MemoryStore()
    bake(town(), store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    return World.open(store)


def drawn(world: World, held: set[str] | None, near: float | None = None, far: bool = False) -> Picture:
    options = RenderOptions(supersampling=2, held=held, near_radius=near, far_geometry=far)
    return render_world(world, CAMERA, SIZE, options)


def keys(world: World, *beginnings: str) -> set[str]:
    return {key for key in world.store.list() if key.startswith(beginnings)}


@pytest.mark.parametrize("near", [0.0, 40.0, math.inf])
def test_who_holds_all_sees_all(world: World, near: float) -> None:
    whole, held = drawn(world, None, near), drawn(world, keys(world, "orthoview", "geometry", "mesh", "texture"), near)
    assert np.array_equal(whole.color, held.color)
    assert held.statistics.warnings == 0


GEOMETRY = "geometry", "mesh", "texture"


def test_geometry_that_is_held_is_drawn_however_far_away(world: World) -> None:
    whole, held = drawn(world, None, math.inf), drawn(world, keys(world, *GEOMETRY), 1.0, far=True)
    assert np.array_equal(whole.color, held.color)
    assert held.statistics.cells == 0
    assert np.array_equal(held.color, drawn(world, keys(world, "orthoview", *GEOMETRY), 1.0, far=True).color)
    # Whoever wants none has none.
    assert drawn(world, keys(world, *GEOMETRY), 0.0, far=True).statistics.triangles == 0


def test_where_some_leaf_lacks_its_cell_is_drawn_from_pictures(world: World) -> None:
    held = keys(world, "orthoview", *GEOMETRY)
    one = min(key for key in held if key.startswith("geometry/"))
    found, whole = drawn(world, held - {one}, 1.0, far=True), drawn(world, held, 1.0, far=True)
    assert 0 < found.statistics.triangles < whole.statistics.triangles
    assert found.statistics.cells > 0


@pytest.mark.parametrize("near", [0.0, math.inf])
def test_who_holds_nothing_sees_nothing(world: World, near: float) -> None:
    found = drawn(world, set(), near)
    assert found.alpha.max() == 0
    assert found.statistics.warnings == 0


def test_cells_above_stand_in(world: World) -> None:
    top = f"orthoview/{world.grid.top_level}/"
    whole, coarse = drawn(world, None, 0.0), drawn(world, keys(world, top), 0.0)
    assert coarse.statistics.orthoviews > 0
    assert np.mean((coarse.alpha > 0.5) == (whole.alpha > 0.5)) > 0.95


def test_pictures_stand_in_for_geometry(world: World) -> None:
    whole, held = drawn(world, None, math.inf), drawn(world, keys(world, "orthoview", "mesh"), math.inf)
    assert held.statistics.triangles == 0
    assert np.mean((held.alpha > 0.5) == (whole.alpha > 0.5)) > 0.95


def test_what_stands_in_and_lacks_tiles_is_stood_in_for_itself(world: World) -> None:
    """Single tiles of the cells between hide the root no more than they show."""
    top, level = world.grid.top_level, world.grid.top_level - 1
    coarse = drawn(world, keys(world, f"orthoview/{top}/"), 0.0)
    places = {tuple(key.split("/")[5:7]) for key in keys(world, f"orthoview/{level}/")}
    places = {(direction, layer.split("-")[0]) for direction, layer in places}
    assert len(places) > 5
    for place in places:
        between = {k for k in keys(world, f"orthoview/{level}/") if f"/{'/'.join(place)}-" in k}
        both = drawn(world, keys(world, f"orthoview/{top}/") | between, 0.0)
        assert (both.alpha > 0.5).sum() > 0.85 * (coarse.alpha > 0.5).sum(), place


def test_some_tiles_of_a_cell_lie_before_what_stands_in(world: World) -> None:
    """With two directions of the leaves the picture is nearer to the whole than with the root alone."""
    top = keys(world, f"orthoview/{world.grid.top_level}/")
    some = {key for key in keys(world, "orthoview/0/") if key.split("/")[5] in ("4", "10")}
    whole = drawn(world, None, 0.0)

    def error(held: set[str]) -> float:
        return float(np.abs(drawn(world, held, 0.0).color - whole.color).mean())

    assert error(top | some) < 0.9 * error(top)
