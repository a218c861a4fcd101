"""The image of walls: which texels of it each wall of a BlockMap has (BLK 3.1, 3.3).

Two ways. `by_area` gives every side texels about as wide as high, as many as it is wide and high: what the paper leaves
to future work (BLK 6). Otherwise each texel of the map with a wall has one column, whatever its height, that all its
sides share, and the columns are squeezed when there are more of them than the image has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.unfold import place_walls, trace_walls

DENSITIES = ((4, 1), (3, 1), (2, 1), (1, 1), (1, 2), (1, 4), (1, 8), (1, 16))
"""Columns of a side, and sides that share them, from fine to coarse."""


@dataclass(frozen=True, slots=True, eq=False)
class Unfolded:
    """The walls of a BlockMap in the order in which one walks along them."""

    sides: NDArray[np.int32]
    """(count,) 4 (n j + i) + k of texel (i, j) and side k: west, east, south, north; where texels have one column
    each, 4 (n j + i)."""
    places: NDArray[np.int32]
    """(n, n, 4, 3) of each side its first column and row in the image of walls, and its rows; 0 rows: no wall."""
    normal: NDArray[np.int32]
    """(n, n, 4) which of `sides` tells its normal; -1: no wall."""
    across: int
    """Columns of a side."""
    rows: int
    """Of the image that are used."""

    @property
    def is_wall(self) -> NDArray[np.bool_]:
        """(n, n, 4) whether a side is one."""
        return self.normal >= 0


def unfolded(
    codes: NDArray[np.uint8],
    floors: NDArray[np.uint8] | None,
    border: NDArray[np.uint8],
    least: int,
    columns: int,
    density: int,
    scale: int,
    by_area: bool,
) -> Unfolded:
    """Where walls are in an image of `columns` columns; see BlockMap. It may take more rows than the image has."""
    n = codes.shape[0]
    taken, order = np.zeros(4 * n * n, np.int32), np.zeros(4 * n * n, np.int32)
    under = np.zeros_like(codes) if floors is None else floors
    count = trace_walls(codes, under, border, least, taken, order)
    sides = order[:count]
    places, normal = np.zeros((4 * n * n, 3), np.int32), np.full(4 * n * n, -1, np.int32)
    if by_area:
        across, sharing = DENSITIES[density]
        rows = place_walls(codes, under, border, least, order, count, columns, across, sharing, scale, places)
        normal[sides] = np.arange(count, dtype=np.int32)
    else:
        across, rows = 1, n
        texels, first = np.unique(sides >> 2, return_index=True)
        walked = np.argsort(first)
        number = np.empty(len(texels), np.int32)
        number[walked] = np.arange(len(texels), dtype=np.int32)
        of_side = number[np.searchsorted(texels, sides >> 2)]
        normal[sides] = of_side
        squeezed = of_side * columns // max(len(texels), columns)
        places[sides] = np.stack([squeezed, np.zeros_like(squeezed), np.full_like(squeezed, n)], axis=1)
        sides = (texels[walked] * 4).astype(np.int32)
    return Unfolded(sides, places.reshape(n, n, 4, 3), normal.reshape(n, n, 4), across, rows)
