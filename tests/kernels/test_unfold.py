"""Walls of random maps in the order and the places that the plain twin gives them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.kernels.unfold import place_walls, trace_walls
from farfield.represent.blockmap.unfolding import DENSITIES, unfolded
from kernels.plain_unfold import PlainWalls, number_of

Map = tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], int]


@st.composite
def maps(draw: st.DrawFn) -> Map:
    """Codes, floors, rim, and the least drop of a wall: of blocks of few heights, of any heights, of nearly nothing."""
    n, kind = draw(st.sampled_from([2, 3, 5, 16])), draw(st.integers(0, 2))
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    if kind == 0:
        codes = random.choice(np.array([0, 1, 2, 90, 255], np.uint8), (n, n))
    elif kind == 1:
        codes = random.integers(0, 256, (n, n)).astype(np.uint8)
    else:
        codes = (random.integers(1, 256, (n, n)) * (random.random((n, n)) < 0.1)).astype(np.uint8)
    border = (random.random((4, n)) < draw(st.sampled_from([0.0, 0.5, 1.0]))).astype(np.uint8)
    # Some end just below their tops, at them, or above them.
    floors = random.choice(np.array([0, 1, 2, 89, 90, 91, 255], np.uint8), (n, n))
    floors[random.random((n, n)) >= draw(st.sampled_from([0.0, 0.5, 1.0]))] = 0
    return codes, floors, border, draw(st.sampled_from([1, 2, 40, 255]))


def traced(of: Map) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The walls in their order, and which sides are some."""
    codes, floors, border, least = of
    taken, order = np.zeros(4 * codes.size, np.int32), np.full(4 * codes.size, -1, np.int32)
    count = trace_walls(codes, floors, border, least, taken, order)
    return order[:count], taken


@settings(deadline=None, max_examples=60)
@given(maps())
def test_walls_are_listed_as_by_the_plain_twin(of: Map) -> None:
    order, taken = traced(of)
    plain = [number_of(side, len(of[0])) for side in PlainWalls(*of).listed()]
    assert order.tolist() == plain
    assert sorted(plain) == np.flatnonzero(taken).tolist()


def test_one_goes_round_a_house_with_it_on_the_left() -> None:
    codes = np.ones((16, 16), np.uint8)
    codes[4:7, 3:8] = 50
    order, _ = traced((codes, np.zeros_like(codes), np.zeros((4, 16), np.uint8), 1))
    sides, texels = order & 3, order >> 2
    assert len(order) == 2 * (3 + 5)
    # From the west side of the first texel on: its south, then east, north and west.
    assert sides.tolist() == [0] + [2] * 5 + [1] * 3 + [3] * 5 + [0] * 2
    assert (texels % 16)[1:6].tolist() == [3, 4, 5, 6, 7]
    assert (texels // 16)[6:9].tolist() == [4, 5, 6]


@settings(deadline=None, max_examples=60)
@given(maps(), st.sampled_from(DENSITIES), st.sampled_from([1, 64, 300, 65535]), st.sampled_from([4, 7, 64]))
def test_walls_have_the_places_of_the_plain_twin(of: Map, density: tuple[int, int], scale: int, columns: int) -> None:
    (codes, floors, border, least), n = of, len(of[0])
    order, _ = traced(of)
    places = np.zeros((4 * n * n, 3), np.int32)
    used = place_walls(codes, floors, border, least, order, len(order), columns, *density, scale, places)
    plain, plainly_used = PlainWalls(*of).placed(columns, *density, scale)
    assert used == plainly_used
    assert {int(k): tuple(places[k].tolist()) for k in np.flatnonzero(places[:, 2])} == {
        number_of(side, n): place for side, place in plain.items()
    }


@settings(deadline=None, max_examples=60)
@given(maps(), st.integers(0, len(DENSITIES) - 1), st.sampled_from([1, 64, 300, 65535]))
def test_walls_have_texels_of_their_own_but_for_those_that_share(of: Map, density: int, scale: int) -> None:
    columns = 64
    found = unfolded(*of, columns, density, scale, by_area=True)
    across, sharing = DENSITIES[density]
    owners = np.zeros((max(found.rows, 1), columns), int)
    shared: set[tuple[int, int]] = set()
    for column, top, rows in found.places.reshape(-1, 3)[found.sides].tolist():
        assert 0 <= column <= columns - across
        assert 0 <= top <= top + rows <= found.rows
        if (column, top) not in shared:
            owners[top : top + rows, column : column + across] += 1
        shared.add((column, top))
    assert owners.max(initial=0) <= 1
    assert len(shared) == -(-len(found.sides) // sharing)


@settings(deadline=None, max_examples=60)
@given(maps(), st.sampled_from([4, 64]))
def test_by_column_each_texel_with_a_wall_has_one_normal_and_one_column(of: Map, columns: int) -> None:
    n = len(of[0])
    found = unfolded(*of, columns, 3, 1, by_area=False)
    first: dict[tuple[int, int], int] = {}
    for i, j, _ in PlainWalls(*of).listed():
        first.setdefault((i, j), len(first))
    assert len(found.sides) == len(first)
    for i, j, name in PlainWalls(*of).listed():
        number = first[i, j]
        side = found.places[j, i, number_of((0, 0, name), n)]
        assert side.tolist() == [number * columns // max(len(first), columns), 0, n]
        assert found.normal[j, i, number_of((0, 0, name), n)] == number
        assert found.sides[number] == number_of((i, j, "west"), n)
    assert (found.normal >= 0).sum() == len(PlainWalls(*of).listed())
    assert (found.is_wall == (found.places[..., 2] > 0)).all()


@pytest.mark.parametrize("by_area", [False, True])
def test_where_nothing_stands_there_are_no_walls(by_area: bool) -> None:
    flat = np.full((16, 16), 7, np.uint8)
    found = unfolded(flat, None, np.zeros((4, 16), np.uint8), 1, 64, 0, 256, by_area)
    assert not found.is_wall.any()
    assert len(found.sides) == 0
