"""Features ordered and split by place, so that nearby buildings share a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LEVELS = 20
_FINEST = 16.0
"""Metres: side of the smallest square of the quadtree; the largest is 16 km * 2^10."""


def morton_codes(centres: NDArray[np.float64]) -> NDArray[np.uint64]:
    """(n,) uint64: interleaved bits of the 16 m square each centre lies in, anchored to the coordinates' own zero.

    The squares do not depend on the other features, so that adding one building reorders only its neighbours.
    """
    half = 1 << (_LEVELS - 1)
    cells = np.clip(np.floor(centres / _FINEST) + half, 0, 2 * half - 1).astype(np.uint64)
    return _spread(cells[:, 0]) | (_spread(cells[:, 1]) << np.uint64(1))


def split(codes: NDArray[np.uint64], most: int) -> list[tuple[int, int]]:
    """Ranges of sorted codes, each a quadtree square with at most `most` features (more only in one 16 m square)."""
    ranges: list[tuple[int, int]] = []
    pending = [(0, len(codes), 0, _LEVELS)]
    while pending:
        low, high, prefix, level = pending.pop()
        if high - low <= most or level == 0:
            if high > low:
                ranges.append((low, high))
            continue
        shift = 2 * (level - 1)
        edges = np.array([(prefix + quarter) << shift for quarter in range(5)], np.uint64)
        cuts = low + np.searchsorted(codes[low:high], edges)
        pending.extend(
            (int(cuts[quarter]), int(cuts[quarter + 1]), (prefix + quarter) << 2, level - 1)
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
