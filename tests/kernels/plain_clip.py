"""The plain twin of kernels.clip: Sutherland-Hodgman with fractions, one cell at a time."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

STEPS = 65536
Point = tuple[Fraction, Fraction, Fraction]


def step(value: Fraction, leaf_size: Fraction) -> int:
    """Fixed-point coordinate, rounded to nearest."""
    return (value * STEPS / leaf_size + Fraction(1, 2)).__floor__()


def keep(polygon: list[Point], axis: int, plane: int, side: int, leaf_size: Fraction) -> list[Point]:
    """The part above (1) or below (-1) cell plane number `plane`."""
    offsets = [side * (step(p[axis], leaf_size) - plane * STEPS) for p in polygon]
    if max(offsets) <= 0 and not (side == 1 and max(offsets) == min(offsets) == 0):
        return []
    kept: list[Point] = []
    for i, p in enumerate(polygon):
        j = (i + 1) % len(polygon)
        if offsets[i] >= 0:
            kept.append(p)
        if offsets[i] * offsets[j] < 0:
            q = polygon[j]
            t = (plane * leaf_size - p[axis]) / (q[axis] - p[axis])
            x, y, z = (a + t * (b - a) for a, b in zip(p, q, strict=True))
            kept.append((x, y, z))
    return kept


def clip_to_cell(triangle: list[Point], cell: tuple[int, int, int], leaf_size: Fraction) -> list[Point]:
    """Corners of the part of a triangle in a cell; fewer than 3: nothing."""
    polygon = triangle
    for axis in range(3):
        for plane, side in ((cell[axis], 1), (cell[axis] + 1, -1)):
            polygon = keep(polygon, axis, plane, side, leaf_size)
            if len(polygon) < 3:
                return []
    return polygon


def vector_area(polygon: list[Point]) -> Point:
    """Twice the oriented area."""
    total = [Fraction(0)] * 3
    o = polygon[0]
    for p, q in pairwise(polygon[1:]):
        u, v = [a - b for a, b in zip(p, o, strict=True)], [a - b for a, b in zip(q, o, strict=True)]
        for k in range(3):
            total[k] += u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]
    return total[0], total[1], total[2]
