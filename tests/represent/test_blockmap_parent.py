"""BlockMaps of cells from those of their children."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.geometry.color import LINEAR_OF_BYTE, srgb_from_linear
from farfield.octree.grid import Grid
from farfield.represent.blockmap.blockmap import SIZES, BlockMap
from farfield.represent.blockmap.build import Square, build_blockmap
from farfield.represent.blockmap.coding import decode_blockmap, encode_blockmap
from farfield.represent.blockmap.parent import ChildMap, build_parent
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.scene.model import Mesh
from represent.prisms import WHITE, House, chunk_of, random_town
from represent.random_maps import random_map
from represent.shapes import IDENTITY, PLAIN

WIDE, DEEP, HIGH = Square(128.0, 96.0, 64.0), (1, 1, 0), 64.0
N = 32
TOWN, HOUSES = 3, 25
"""Which of the random towns, and how many houses it may have."""


def children_of(chunk: Chunk, layers: int = 1, leaf: float = 64.0, by_area: bool = True) -> list[ChildMap]:
    """Of the cells 2 x 2 x `layers` that a chunk in the first 128 m is cut to."""
    count = len(chunk.triangles)
    material = np.zeros(count, np.uint16)
    mesh = Mesh(
        chunk.positions.astype(np.float64), chunk.triangles, chunk.normals, (PLAIN,), material, colors=chunk.colors,
        triangle_object=chunk.objects, object_count=int(chunk.objects.max()) + 1,
    )  # fmt: skip
    grid, blocked = Grid(leaf, 32, (0.0, 0.0, 0.0), (1, 1, layers - 1)), BlockedMesh.from_mesh(mesh)
    found = []
    for place in np.ndindex(2, 2, layers):
        part = blocked.cell_chunk(IDENTITY, grid, place, 0, 0)
        made = None if part is None else build_blockmap(part, WHITE, Square(leaf, leaf, leaf), SIZES[1], by_area)
        if made is not None:
            found.append(ChildMap(made, (place[0], place[1], place[2]), place[2] * leaf))
    return found


def town(seed: int = TOWN, gables: bool = False, layers: int = 1, by_area: bool = True) -> list[ChildMap]:
    square = Square(128.0, 128.0, 64.0 * layers)
    return children_of(chunk_of(random_town(seed, gables, count=HOUSES), square), layers, by_area=by_area)


def parent_of(children: list[ChildMap], layers: int = 1) -> BlockMap:
    return build_parent(children, Square(128.0, 128.0, 64.0 * layers), (1, 1, layers - 1))


def laid_out(children: list[ChildMap], name: str) -> np.ndarray:
    """An array of children of one layer side by side, as blocks: (n, n, 4, …)."""
    fine = np.zeros((2 * N, 2 * N, *getattr(children[0].blockmap, name).shape[2:]))
    for child in children:
        x, y, _ = child.place
        fine[y * N : y * N + N, x * N : x * N + N] = getattr(child.blockmap, name)[:, :N]
    parted = fine.reshape(N, 2, N, 2, *fine.shape[2:])
    return np.moveaxis(parted, 1, 2).reshape(N, N, 4, *fine.shape[2:])


def seen_from_above(color: np.ndarray) -> np.ndarray:
    """(3,) sRGB of the mean light of tops."""
    return srgb_from_linear(LINEAR_OF_BYTE[color.astype(np.uint8)].reshape(-1, 3).mean(axis=0)) * 255


@pytest.mark.parametrize("gables", [False, True])
def test_a_texel_is_as_high_as_one_of_the_finer_ones_and_is_its(gables: bool) -> None:
    children = town(gables=gables)
    found = parent_of(children)
    heights, ids = laid_out(children, "heights"), laid_out(children, "objects")
    off = np.abs(heights - found.heights[..., None])
    assert off.min(axis=-1).max() <= found.step / 2 + 1e-3
    assert found.objects is not None
    nearest = off <= found.step / 2 + 1e-3
    assert (nearest & (ids == found.objects[..., None])).any(axis=-1).all()
    # Neither always the highest nor always the lowest of those that differ.
    mixed = np.ptp(heights, axis=-1) > 2
    high = (heights.max(axis=-1) - found.heights < 1)[mixed].mean()
    assert 0.25 < high < 0.75


@pytest.mark.parametrize("gables", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_from_above_it_looks_as_its_children_do(seed: int, gables: bool) -> None:
    children = town(seed, gables)
    found = parent_of(children)
    off = seen_from_above(found.colors[:, :N]) - seen_from_above(laid_out(children, "colors"))
    assert np.abs(off).max() < 6
    built = laid_out(children, "codes") > 2
    assert abs((found.heights > 2).mean() - (laid_out(children, "heights") > 2).mean()) < 0.04
    assert 0.1 < built.mean() < 0.7


def test_walls_keep_their_colours_and_normals() -> None:
    children = town()
    found = parent_of(children)
    walls = found.unfolded
    assert walls.rows <= N
    assert found.objects is not None
    houses, checked, outwards, off = random_town(TOWN, gables=False, count=HOUSES), 0, 0, []
    for j, i, k in np.argwhere(walls.is_wall).tolist():
        if found.heights[j, i] < 4:
            continue
        column, top, rows = walls.places[j, i, k].tolist()
        shown = found.colors[top : top + rows, N + column : N + column + walls.across].reshape(-1, 3).astype(int)
        assert np.abs(shown - [200, 60, 30]).max() <= 3
        angle = float(found.azimuths[j, i, k])
        outward = [(-1, 0), (1, 0), (0, -1), (0, 1)][k]
        facing = np.cos(angle) * outward[0] + np.sin(angle) * outward[1]
        assert facing > 0
        outwards += facing > 0.5
        faces = houses[found.objects[j, i] - 2].turn + np.arange(4) * np.pi / 2
        off.append(np.abs((angle - faces + np.pi) % (2 * np.pi) - np.pi).min())
        checked += 1
    assert checked > 100
    assert outwards > 0.8 * checked
    # 64ths of a turn; at corners two walls are seen together.
    assert np.median(off) <= np.pi / 64


@pytest.mark.parametrize("by_area", [False, True])
def test_a_tower_through_two_cells_is_one_wall(by_area: bool) -> None:
    tower = House((61.3, 65.2), (30.0, 22.0), 105.0, color=(30, 80, 160))
    low = House((20.3, 20.2), (22.0, 22.0), 12.0)
    children = children_of(chunk_of([tower, low], Square(128.0, 128.0, 128.0)), 2, by_area=by_area)
    assert len(children) == 8
    found = parent_of(children, 2)
    place = slice(17, 19), slice(14, 17)
    assert (np.abs(found.heights[place] - 105) <= found.step).all()
    assert (found.colors[place] == found.colors[17, 15]).all()
    assert np.abs(found.colors[17, 15].astype(int) - [70, 120, 200]).max() <= 1
    assert found.objects is not None
    assert len(np.unique(found.objects[found.heights > 50])) == 1
    walls = found.unfolded.is_wall & (found.heights > 50)[..., None]
    assert walls.sum() >= 2 * (7 + 5)
    off = []
    for j, i, k in np.argwhere(walls).tolist():
        column, top, rows = found.unfolded.places[j, i, k].tolist()
        last = round(rows * 105 / (254 * found.step)) if not by_area else rows
        shown = found.colors[top + rows - last : top + rows, N + column].astype(int)
        off.append(np.abs(shown - [30, 80, 160]).max(axis=1))
    # Of a block in which no finer wall stands, as it is drawn, texels are filled from those beside them in the image.
    assert (np.concatenate(off) <= 3).mean() > 0.85
    assert np.concatenate(off).max() < 40
    assert not found.border.any()


def test_the_rim_is_a_wall_where_a_finer_one_is() -> None:
    houses = [House((4.2, 40.0), (8.0, 20.0), 9.0), House((90.0, 123.9), (30.0, 8.0), 9.0)]
    children = children_of(chunk_of(houses, Square(128.0, 128.0, 64.0)))
    found = parent_of(children)
    for k, (axis, place) in enumerate(((1, 0), (1, 1), (0, 0), (0, 1))):
        fine = np.zeros(2 * N, bool)
        for child in children:
            if child.place[1 - axis] == place:
                first = child.place[axis] * N
                fine[first : first + N] = child.blockmap.border[k]
        np.testing.assert_array_equal(found.border[k], fine.reshape(N, 2).any(axis=1), str(k))
    assert found.border[0].any()
    assert found.border[3].any()


def test_it_depends_on_what_the_children_are_alone() -> None:
    children = town(1, gables=True, layers=2)
    found = parent_of(children, 2)
    data = encode_blockmap(found, 75)
    assert encode_blockmap(parent_of(children, 2), 75) == data
    assert encode_blockmap(parent_of(children[::-1], 2), 75) == data


def test_without_ids_of_one_of_them_it_has_none() -> None:
    children = town()
    children[1] = replace(children[1], blockmap=replace(children[1].blockmap, objects=None))
    assert parent_of(children).objects is None


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.booleans(), st.integers(0, 15), st.lists(st.booleans(), min_size=3, max_size=3))
def test_of_whatever_maps_it_can_be_stored_and_read(
    seed: int, by_area: bool, present: int, merging: list[bool]
) -> None:
    """Of random heights with holes, and of next to nothing."""
    merges = tuple(map(int, merging))
    random = np.random.default_rng(seed)
    places = [
        place for place in np.ndindex(*(merge + 1 for merge in merges)) if random.random() < 0.7 or not any(place)
    ]
    children = []
    for number, place in enumerate(places):
        own = random_map(seed + number, by_area, bool(number % 2), holes=0.3, hanging=float(random.integers(0, 2)) / 2)
        if present >> number % 4 & 1:
            codes = np.zeros_like(own.codes)
            codes[tuple(random.integers(0, 16, 2))] = random.integers(1, 256)
            own = replace(own, codes=codes)
            own = own.with_turns(np.zeros(len(own.unfolded.sides), np.uint8))
        children.append(ChildMap(own, (place[0], place[1], place[2]), place[2] * 16.0))
    found = build_parent(children, Square(96.0, 64.0, 32.0), (merges[0], merges[1], merges[2]))
    assert found.codes.any()
    read = decode_blockmap(encode_blockmap(found, 75), "")
    np.testing.assert_array_equal(read.codes, found.codes)
    np.testing.assert_array_equal(read.floors, found.floors)
    assert read.unfolded.rows <= 16


def test_of_a_single_texel_something_is_left() -> None:
    """What is drawn of each block at random would often be none of it, and a map of nothing is none."""
    for at in np.ndindex(4, 4):
        own = random_map(1, True, False)
        codes = np.zeros_like(own.codes)
        codes[at] = 90
        own = replace(own, codes=codes, border=np.ones((4, 16), np.uint8)).with_turns(np.zeros(4, np.uint8))
        found = build_parent([ChildMap(own, (0, 0, 0), 0.0)], Square(96.0, 64.0, 32.0), (1, 1, 0))
        assert found.codes[at[0] // 2, at[1] // 2] > 0
        assert (found.codes > 0).sum() == 1
