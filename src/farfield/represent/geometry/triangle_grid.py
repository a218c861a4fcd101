"""The triangles of a surface in a grid of cubes, for whoever looks for those near a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.nearest import fill_cells

_CROWD = 8
"""Entries of the grid a triangle, at most on average."""
_MOST_CELLS = 1 << 20
"""In all: 8 MB."""


@dataclass(frozen=True, slots=True)
class TriangleGrid:
    """As `fill_cells` makes it."""

    points: NDArray[np.float64]
    """(n, 3) metres."""
    triangles: NDArray[np.uint32]
    """(m, 3) into the points."""
    low: NDArray[np.float64]
    size: float
    shape: NDArray[np.int64]
    start: NDArray[np.int64]
    inside: NDArray[np.uint32]

    @classmethod
    def of(cls, points: NDArray[np.float64], triangles: NDArray[np.uint32], most: int) -> TriangleGrid:
        """most: cells along the longest axis; there are fewer where they would hold little."""
        used = points[triangles.ravel()] if len(triangles) else np.zeros((1, 3))
        low = used.min(axis=0)
        across = used.max(axis=0) - low
        cells = min(most, max(1, round(len(triangles) ** 0.5)))
        while True:
            size = max(float(across.max()), 1e-12) / cells
            shape = np.maximum(np.ceil(across / size), 1).astype(np.int64)
            if shape.prod() <= _MOST_CELLS or cells == 1:
                start = np.empty(int(shape.prod()) + 1, np.int64)
                entries = fill_cells(points, triangles, low, size, shape, start, np.empty(0, np.uint32))
                if entries <= _CROWD * len(triangles) or cells == 1:
                    break
            cells //= 2
        inside = np.empty(entries, np.uint32)
        fill_cells(points, triangles, low, size, shape, start, inside)
        return cls(points, triangles, low, size, shape, start, inside)
