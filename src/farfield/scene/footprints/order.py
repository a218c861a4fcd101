"""Features ordered and split by place, so that nearby buildings share a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.scene.options import Facades

BUILDINGS_PER_MESH = 1024
"""Some 500 m of a city: a changed building costs the leaves that its mesh reaches into."""
UNIQUE_PER_MESH = 64
"""With a façade each: 17 MB of them when they are loaded."""
LEVELS = 22
_FINEST = 16.0
"""Metres: side of the smallest square of the quadtree; the largest is 67,000 km wide, more than any CRS on Earth."""
_HALF = 1 << (LEVELS - 1)


def most_in_mesh(facades: Facades) -> int:
    """Buildings that share a mesh."""
    return UNIQUE_PER_MESH if facades == "unique" else BUILDINGS_PER_MESH


@dataclass(frozen=True, slots=True)
class Square:
    """A square of the quadtree that is anchored to the coordinates' own zero."""

    level: int
    """Its side is 16 m * 2^level."""
    prefix: int
    """The codes of what lies in it, without their lowest 2 * level bits."""

    def __str__(self) -> str:
        x, y, right, _ = self.box
        return f"{right - x:,.0f} m square at {x:,.0f}, {y:,.0f}"

    @property
    def codes(self) -> tuple[int, int]:
        """The first code in it and the first beyond."""
        return self.prefix << 2 * self.level, (self.prefix + 1) << 2 * self.level

    @property
    def box(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1, metres."""
        side = _FINEST * (1 << self.level)
        x, y = ((_gathered(self.prefix >> axis) << self.level) - _HALF for axis in (0, 1))
        return x * _FINEST, y * _FINEST, x * _FINEST + side, y * _FINEST + side


def morton_codes(centres: NDArray[np.float64]) -> NDArray[np.uint64]:
    """(n,) uint64: interleaved bits of the 16 m square each centre lies in.

    The squares do not depend on the other features, so that adding one building reorders only its neighbours.
    """
    cells = np.clip(np.floor(centres / _FINEST) + _HALF, 0, 2 * _HALF - 1).astype(np.uint64)
    return _spread(cells[:, 0]) | (_spread(cells[:, 1]) << np.uint64(1))


def split(
    codes: NDArray[np.uint64], most: int, weights: NDArray[np.int64] | None = None
) -> list[tuple[Square, int, int]]:
    """The largest squares with at most `most` features (more only in one 16 m square), and the range of each.

    codes: (n,) ascending. weights: (n,) features that stand at each code; None: one.
    """
    totals = np.arange(len(codes) + 1) if weights is None else np.concatenate([[0], np.cumsum(weights)])
    ranges: list[tuple[Square, int, int]] = []
    pending = [(0, len(codes), 0, LEVELS)]
    while pending:
        low, high, prefix, level = pending.pop()
        if totals[high] - totals[low] <= most or level == 0:
            if high > low:
                ranges.append((Square(level, prefix), low, high))
            continue
        shift = 2 * (level - 1)
        edges = np.array([((prefix << 2) + quarter) << shift for quarter in range(5)], np.uint64)
        cuts = low + np.searchsorted(codes[low:high], edges)
        pending.extend(
            (int(cuts[quarter]), int(cuts[quarter + 1]), (prefix << 2) + quarter, level - 1)
            for quarter in reversed(range(4))
        )
    return ranges


def _spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Bit k moved to bit 2 k."""
    out = values
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F),
                        (2, 0x3333333333333333), (1, 0x5555555555555555)):  # fmt: skip
        out = (out | (out << np.uint64(shift))) & np.uint64(mask)
    return out


def _gathered(value: int) -> int:
    """Bit 2 k moved to bit k, the others dropped."""
    return sum((value >> 2 * k & 1) << k for k in range(LEVELS))
