"""Cells share every surface exactly: nothing is lost, nothing is there twice, edges stay closed."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.represent.clipping import Pieces, clip_to_cells
from kernels import plain_clip

LEAF = 3.0

coordinate = st.one_of(
    st.floats(-7, 7, allow_nan=False, width=32),
    st.integers(-3, 3).map(lambda k: k * LEAF),
    st.integers(-3, 3).map(lambda k: k * LEAF + LEAF / 65536 / 3),
    st.integers(-8, 8).map(float),
)
corners = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=3, max_size=3)


def cells_of(points: NDArray[np.float64]) -> Pieces:
    triangles = np.arange(len(points), dtype=np.uint32).reshape(-1, 3)
    return clip_to_cells(np.asarray(points, dtype=np.float64), triangles, LEAF)


def areas(points: NDArray[np.float64], pieces: Pieces) -> dict[tuple[int, int, int], NDArray[np.float64]]:
    """Cell -> twice the oriented area in it."""
    found: dict[tuple[int, int, int], NDArray[np.float64]] = {}
    for source, cell, piece in zip(pieces.source, pieces.cell, pieces.piece, strict=True):
        p = points[3 * source : 3 * source + 3] if piece < 0 else pieces.positions[piece]
        x, y, z = (int(c) for c in cell)
        found[x, y, z] = found.get((x, y, z), np.zeros(3)) + np.cross(p[1] - p[0], p[2] - p[0])
    return found


@settings(max_examples=100, deadline=None)
@given(corners)
def test_cells_hold_what_the_plain_twin_finds(triangle: list[tuple[float, float, float]]) -> None:
    points = np.array(triangle)
    exact = [(Fraction(x), Fraction(y), Fraction(z)) for x, y, z in triangle]
    found = areas(points, cells_of(points))
    whole = np.cross(points[1] - points[0], points[2] - points[0])
    np.testing.assert_allclose(sum(found.values(), np.zeros(3)), whole, atol=1e-11)
    first, last = (np.floor((f(points, axis=0) + d) / LEAF).astype(int) for f, d in ((np.min, -0.1), (np.max, 0.1)))
    for x in range(first[0], last[0] + 1):
        for y in range(first[1], last[1] + 1):
            for z in range(first[2], last[2] + 1):
                polygon = plain_clip.clip_to_cell(exact, (x, y, z), Fraction(LEAF))
                expected = np.array([float(a) for a in plain_clip.vector_area(polygon)]) if polygon else np.zeros(3)
                np.testing.assert_allclose(found.get((x, y, z), np.zeros(3)), expected, atol=1e-11)


@settings(max_examples=200, deadline=None)
@given(corners)
def test_pieces_lie_in_their_cells_and_on_their_triangle(triangle: list[tuple[float, float, float]]) -> None:
    points = np.array(triangle)
    pieces = cells_of(points)
    cut = pieces.piece >= 0
    low = pieces.cell[cut][:, None] * LEAF
    half_step = LEAF / 65536 / 2 + 1e-12
    corner = pieces.positions[pieces.piece[cut]]
    assert (corner >= low - half_step).all()
    assert (corner <= low + LEAF + half_step).all()
    weights = pieces.weights[pieces.piece[cut]]
    np.testing.assert_allclose(weights.sum(-1), 1, atol=1e-12)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights @ points, corner, atol=1e-11)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=4, max_size=4))
def test_a_shared_edge_is_cut_at_the_same_points(four: list[tuple[float, float, float]]) -> None:
    points = np.array(four)
    a, b = points[0], points[1]
    one, other = points[[0, 1, 2]], points[[1, 0, 3]]
    length = np.linalg.norm(b - a)
    if min(np.linalg.norm(np.cross(b - a, points[k] - a)) for k in (2, 3)) < 1e-3 * max(length, 1):
        return
    assert on_edge(one, (0, 1)) == on_edge(other, (1, 0))


def on_edge(triangle: NDArray[np.float64], edge: tuple[int, int]) -> set[tuple[float, ...]]:
    """Points of all pieces on an edge: those whose third weight is exactly 0."""
    pieces = cells_of(triangle)
    third = 3 - sum(edge)
    cut = pieces.weights[..., third] == 0
    return {tuple(p) for p in pieces.positions[cut].tolist()} - {tuple(triangle[k].tolist()) for k in edge}


def test_a_face_on_a_cell_plane_belongs_to_the_upper_cell() -> None:
    for axis in range(3):
        square = np.array([[0.5, 0.5, 0], [1, 0.5, 0], [0.5, 1, 0]])
        points = np.roll(square, axis + 1, axis=1)
        points[:, axis] = 2 * LEAF
        pieces = cells_of(points)
        assert len(pieces.source) == 1
        assert pieces.cell[0, axis] == 2
        assert pieces.piece[0] == -1


def test_a_face_that_touches_a_plane_with_an_edge_stays_below() -> None:
    pieces = cells_of(np.array([[3.0, 0.5, 0.5], [3.0, 1.5, 0.5], [2.0, 1, 1]]))
    assert pieces.cell.tolist() == [[0, 0, 0]]
    assert pieces.piece.tolist() == [-1]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite_are_left_out(bad: float) -> None:
    points = np.array([[0, 0, 0], [bad, 0, 0], [0, 1, 0], [1, 1, 1], [2, 1, 1], [1, 2, 1]], dtype=np.float64)
    assert cells_of(points).source.tolist() == [1]


def test_one_cell_and_all_cells_agree() -> None:
    generator = np.random.default_rng(5)
    points = generator.uniform(-7, 7, (300, 3))
    everything = areas(points, cells_of(points))
    triangles = np.arange(300, dtype=np.uint32).reshape(-1, 3)
    for cell, area in everything.items():
        alone = areas(points, clip_to_cells(points, triangles, LEAF, cell, cell))
        np.testing.assert_array_equal(alone[cell], area)


def test_a_large_triangle_over_many_cells_grows_the_buffers() -> None:
    points = np.array([[0.0, 0, 0.1], [300, 0, 0.1], [0, 300, 0.1]])
    found = areas(points, cells_of(points))
    assert len(found) == 100 * 101 // 2
    np.testing.assert_allclose(sum(found.values(), np.zeros(3)), [0, 0, 90000], rtol=1e-12)
