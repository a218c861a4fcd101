"""What is inside of bodies that are open above, against points in polygons."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.kernels.caps import fill_inside


def is_inside(point: tuple[float, float], polygon: NDArray[np.float64]) -> bool:
    """By the edges that a ray to the right crosses."""
    crossings = 0
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if (y0 <= point[1]) != (y1 <= point[1]):
            crossings += point[0] < x0 + (point[1] - y0) / (y1 - y0) * (x1 - x0)
    return crossings % 2 == 1


def walls_of(polygon: NDArray[np.float64], along_y: bool) -> NDArray[np.float64]:
    """(k, 5) as `fill_inside` takes the edges of a polygon, counter-clockwise."""
    ends = np.concatenate([polygon, np.roll(polygon, -1, axis=0)], axis=1)
    return np.ascontiguousarray(np.concatenate([ends, normals_of(ends, along_y)], axis=1))


def normals_of(ends: NDArray[np.float64], along_y: bool) -> NDArray[np.float64]:
    """(k, 1) the outward normal's part along lines: of an edge with the body on its left it is (dy, -dx)."""
    return (ends[:, 0] - ends[:, 2] if along_y else ends[:, 3] - ends[:, 1])[:, None]


def filled(polygons: list[NDArray[np.float64]], size: int, along_y: bool) -> tuple[NDArray, NDArray]:
    inside, known = np.zeros((size, size), np.uint32), np.zeros(size, np.int64)
    walls = np.concatenate([walls_of(polygon, along_y) for polygon in polygons])
    objects = np.repeat(np.arange(1, len(polygons) + 1), [len(one) for one in polygons]).astype(np.uint32)
    fill_inside(walls, objects, objects, np.zeros(len(walls), np.uint8), size, along_y, inside, known)
    return inside, known


def star(random: np.random.Generator, size: int) -> NDArray[np.float64]:
    """A polygon round a point, counter-clockwise, often with corners that point inwards."""
    corners = random.integers(3, 9)
    angles = (np.arange(corners) + random.uniform(-0.3, 0.3, corners)) * 2 * np.pi / corners
    reach = random.uniform(0.1, 0.45, len(angles)) * size
    return random.uniform(0.3, 0.7, 2) * size + reach[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 3), st.booleans())
def test_as_points_in_polygons(seed: int, bodies: int, along_y: bool) -> None:
    size, random = 14, np.random.default_rng(seed)
    polygons = [star(random, size) for _ in range(bodies)]
    inside, known = filled(polygons, size, along_y)
    for row in range(size):
        for column in range(size):
            line = column if along_y else row
            owners = [n + 1 for n, own in enumerate(polygons) if is_inside((column + 0.5, row + 0.5), own)]
            # A cell that the cut of a wall goes through within the nudge may be told either way.
            near = any(is_near((column + 0.5, row + 0.5), own, along_y) for own in polygons)
            assert near or (inside[row, column] in owners if owners else inside[row, column] == 0), (row, column)
            assert not owners or known[line] > 0


def is_near(point: tuple[float, float], polygon: NDArray[np.float64], along_y: bool) -> bool:
    """Whether an edge crosses the line through a point within .001 of it."""
    p, q = (1, 0) if along_y else (0, 1)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if abs(a[q] - point[q]) < 1e-9 or (a[q] <= point[q]) != (b[q] <= point[q]):
            share = (point[q] - a[q]) / (b[q] - a[q])
            if abs(a[p] + share * (b[p] - a[p]) - point[p]) < 1e-3:
                return True
    return False


@pytest.mark.parametrize("along_y", [False, True])
def test_bodies_that_the_map_cuts_were_inside_from_the_beginning(along_y: bool) -> None:
    house = np.array([[6.0, 0.0, 6.0, 5.0], [6.0, 5.0, 0.0, 5.0]])
    beyond = np.array([[16.0, 9.0, 12.0, 9.0], [12.0, 9.0, 12.0, 2.0], [12.0, 2.0, 16.0, 2.0]])
    ends = np.concatenate([house, beyond])
    walls = np.concatenate([ends, normals_of(ends, along_y)], axis=1)
    objects = np.array([1, 1, 2, 2, 2], np.uint32)
    inside = np.zeros((16, 16), np.uint32)
    fill_inside(walls, objects, objects, np.ones(5, np.uint8), 16, along_y, inside, np.zeros(16, np.int64))
    expected = np.zeros((16, 16), np.uint32)
    expected[:5, :6], expected[2:9, 12:] = 1, 2
    assert (inside == expected).all()


@pytest.mark.parametrize("along_y", [False, True])
def test_behind_a_single_sheet_nothing_is_inside(along_y: bool) -> None:
    """As a sign has but one side, or a house walls that are objects of their own: none goes on at the rim."""
    ends = np.array([[3.0, 9.0, 12.0, 4.0], [12.0, 4.0, 3.0, 9.0]])
    for one in (ends[:1], ends[1:]):
        walls, inside = np.concatenate([one, normals_of(one, along_y)], axis=1), np.zeros((16, 16), np.uint32)
        body = np.ones(1, np.uint32)
        fill_inside(walls, body, body, np.zeros(1, np.uint8), 16, along_y, inside, np.zeros(16, np.int64))
        assert not inside.any()
