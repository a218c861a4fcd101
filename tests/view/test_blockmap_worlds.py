"""Worlds of BlockMaps drawn by the reference renderer: like their source, and from a part of their values."""

from __future__ import annotations

import numpy as np
import pytest

from bake.test_blockmaps import BOTH, OPTIONS, SIDE, baked, city
from farfield.geometry.cameras import Camera
from farfield.octree.grid import CellKey
from farfield.quality.metrics import psnr
from farfield.view.blockmaps import BlockMapPass, map_of
from farfield.view.frame import Frame
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.shading import Light
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.keys import blockmap_key
from farfield.world.world import World

SIZE = (160, 120)
AFAR = Camera((-130.0, -170.0, 120.0), (64.0, 64.0, 15.0), 27.0)
ABOVE = Camera((64.0, 64.0, 400.0), (64.0, 64.0, 0.0), 24.0)


@pytest.fixture(scope="module")
def world() -> World:
    return World.open(baked(city()))


def drawn(
    world: World, camera: Camera = AFAR, held: set[str] | None = None, bias: float = 0.0, near: float = 0.0
) -> Picture:
    options = RenderOptions(supersampling=2, near_radius=near, held=held, bias=bias, ids=True)
    return render_world(world, camera, SIZE, options)


def shown(picture: Picture) -> np.ndarray:
    """(h, w, 3) uint8."""
    return picture.pixels(Light().sky_linear)[..., :3]


def map_keys(world: World, *cells: CellKey) -> set[str]:
    """Of the BlockMaps of these cells."""
    entries = [world.entry(cell) for cell in cells]
    return {blockmap_key(entry.cell, entry.blockmap.hash) for entry in entries if entry.blockmap}


def leaves(world: World) -> list[CellKey]:
    return [entry.cell for entry in world.cells() if entry.cell.level == 0]


def test_maps_are_read_once_and_kept_until_they_were_drawn_last(world: World) -> None:
    first, second = (world.entry(cell) for cell in leaves(world)[:2])
    assert first.blockmap is not None
    assert second.blockmap is not None
    a, b = map_of(first, first.blockmap), map_of(second, second.blockmap)
    casting = BlockMapPass(world, Frame.empty(ABOVE, SIZE, 1), Light())
    assert casting.draw([a, b, a]) == (3, 0)
    assert casting.bytes == first.blockmap.bytes + second.blockmap.bytes
    assert not casting._maps


@pytest.mark.parametrize("azimuth", [0.4, 1.9, 3.6, 5.2])
def test_from_afar_it_looks_like_its_source(world: World, azimuth: float) -> None:
    eye = 64 + 270 * np.cos(azimuth), 64 + 270 * np.sin(azimuth), 120.0
    camera = Camera(eye, (64.0, 64.0, 15.0), 27.0)
    truth = draw_truth(city(), camera, SIZE, TruthOptions(supersampling=2, ids=True, normals=True))
    picture = drawn(world, camera)
    assert picture.statistics.warnings == 0
    assert picture.statistics.triangles == picture.statistics.orthoviews == 0
    assert psnr(shown(truth), shown(picture)) > 30
    assert np.mean((truth.alpha > 0.5) == (picture.alpha > 0.5)) > 0.99
    near = np.isfinite(truth.depth) & np.isfinite(picture.depth)
    assert np.median(np.abs(truth.depth[near] - picture.depth[near])) < 0.5
    # Of walls, which are objects of their own here, maps know none: they are of the top above them.
    assert truth.ids is not None
    assert truth.normal is not None
    assert picture.ids is not None
    tops = near & (truth.normal[..., 2] > 0.9)
    assert (picture.ids[near] > 0).all()
    # The bake numbers objects by where they are, so another number is the same object wherever it is seen.
    pairs = np.stack([picture.ids[tops], truth.ids[tops]], axis=1)
    owners = {int(name): int(np.bincount(pairs[pairs[:, 0] == name, 1]).argmax()) for name in np.unique(pairs[:, 0])}
    assert len(set(owners.values())) == 6
    assert np.mean([owners[int(name)] == true for name, true in pairs]) > 0.98


def test_a_coarser_cut_is_coarser_and_not_another(world: World) -> None:
    truth = shown(draw_truth(city(), AFAR, SIZE, TruthOptions(supersampling=2)))
    fine, middle, coarse = (psnr(truth, shown(drawn(world, bias=bias))) for bias in (0.0, 2.0, 9.0))
    assert fine > coarse > 24
    assert fine >= middle > 24


def test_who_holds_all_sees_all_and_who_holds_nothing_sees_nothing(world: World) -> None:
    held = {key for key in world.store.list() if key.startswith("blockmap/")}
    assert np.array_equal(shown(drawn(world, held=held)), shown(drawn(world)))
    nothing = drawn(world, held=set())
    assert nothing.alpha.max() == 0
    assert nothing.statistics.warnings == 0


def test_the_root_stands_in_for_all_and_looks_as_it_does_itself(world: World) -> None:
    """Cut to the boxes of the cells that lack, part by part."""
    held = map_keys(world, *world.roots)
    parts, whole = drawn(world, held=held), drawn(world, held=held, bias=9.0)
    assert parts.statistics.cells >= whole.statistics.cells
    same = (np.abs(shown(parts).astype(int) - shown(whole)) <= 2).all(axis=-1)
    assert same.mean() > 0.985
    assert np.mean((parts.alpha > 0.5) == (whole.alpha > 0.5)) > 0.995


@pytest.mark.parametrize("seed", range(3))
def test_a_parent_stands_in_for_missing_children_within_their_boxes(world: World, seed: int) -> None:
    """From above: each cell is drawn by its own map or by that of the root, without holes between them."""
    random = np.random.default_rng(seed)
    there = [cell for cell in leaves(world) if random.random() < 0.5]
    root = map_keys(world, *world.roots)
    fine, coarse = drawn(world, ABOVE), drawn(world, ABOVE, held=root)
    mixed = drawn(world, ABOVE, held=root | map_keys(world, *there))
    rays = ABOVE.rays(SIZE)
    depth = np.where(np.isfinite(fine.depth), fine.depth, 400.0)
    place = (np.array(ABOVE.eye) + rays * depth[..., None])[..., :2]
    # Of columns of which all cells are there, or all lack, and away from their borders.
    columns = {(cell.x, cell.y) for cell in leaves(world)}
    some = {(cell.x, cell.y) for cell in there}
    all_of_them = {one for one in columns if all(cell in there for cell in leaves(world) if (cell.x, cell.y) == one)}
    x, y = np.floor(place[..., 0] / 32), np.floor(place[..., 1] / 32)
    inner = (np.abs(place % 32 - 16) < 12).all(axis=-1)
    flat = np.abs(fine.depth - 400) < 20
    checked = 0
    for column, row in columns:
        where = inner & flat & (x == column) & (y == row) & (np.isclose(coarse.depth, fine.depth, atol=2))
        if (column, row) in all_of_them:
            expected = fine
        elif (column, row) not in some:
            expected = coarse
        else:
            continue
        off = np.abs(shown(mixed)[where].astype(int) - shown(expected)[where])
        assert (off <= 2).all(axis=-1).mean() > 0.98, (column, row)
        checked += int(where.sum())
    assert checked > 1000
    ground = inner & (place > 2).all(axis=-1) & (place < SIDE - 2).all(axis=-1)
    assert (mixed.alpha[ground] == 1).all()


def test_a_damaged_map_is_counted_and_the_others_are_drawn() -> None:
    store = baked(city())
    world = World.open(store)
    (key,) = map_keys(world, CellKey(0, 1, 1, 0))
    store.put(key, store.get(key)[:-4])
    found = drawn(World.open(store))
    assert found.statistics.warnings == 1
    assert found.alpha.mean() > 0.8 * drawn(World.open(baked(city()))).alpha.mean()


def test_beside_orthoviews_pictures_are_drawn_unless_maps_alone_are_held() -> None:
    world = World.open(baked(city(), BOTH))
    held = {key for key in world.store.list() if key.startswith("blockmap/")}
    pictures = drawn(world)
    assert pictures.statistics.orthoviews > 0
    maps = drawn(world, held=held, near=1.0)
    assert maps.statistics.orthoviews == 0
    assert maps.statistics.cells > 0
    assert psnr(shown(maps), shown(drawn(World.open(baked(city(), OPTIONS))))) > 30
