"""How far apart two surfaces are, from points spread over both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.nearest import distances
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.triangle_grid import TriangleGrid

SAMPLES = 4096
"""Points on each surface."""
PERCENTILE = 90.0
"""Of the distances: the farthest tenth of a surface is often what nobody sees, such as the inside of a base."""
_MOST_CELLS = 32
"""Of the grid, along the longest axis."""


@dataclass(frozen=True, slots=True)
class SampledSurface:
    """Points on a surface, and its triangles in a grid."""

    samples: NDArray[np.float64]
    """(SAMPLES, 3) metres; (0, 3) for one without area."""
    grid: TriangleGrid

    @classmethod
    def of(cls, chunk: Chunk) -> SampledSurface:
        """Of its triangles."""
        points = chunk.positions.astype(np.float64)
        return cls(_spread_over(points, chunk.triangles), TriangleGrid.of(points, chunk.triangles, _MOST_CELLS))

    def distances(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) metres from each of (k, 3) points to the nearest triangle; there must be one."""
        found, grid = np.empty(len(samples)), self.grid
        distances(grid.points, grid.triangles, grid.low, grid.size, grid.shape, grid.start, grid.inside, samples, found)
        return found


def surface_distance(one: SampledSurface, other: SampledSurface) -> float:
    """Metres: 90th percentile of the distances of points on either surface from the other, the larger of the two.

    inf when one of them has no area, 0 when neither has.
    """
    if not (len(one.samples) and len(other.samples)):
        return 0.0 if len(one.samples) == len(other.samples) else float("inf")
    apart = one.distances(other.samples), other.distances(one.samples)
    return max(float(np.percentile(found, PERCENTILE)) for found in apart)


def _spread_over(points: NDArray[np.float64], triangles: NDArray[np.uint32]) -> NDArray[np.float64]:
    """(SAMPLES, 3) points, one in every SAMPLES-th of the area in the order of the triangles."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    if not len(area) or not area[-1] > 0:
        return np.empty((0, 3))
    at = np.searchsorted(area, (np.arange(SAMPLES) + 0.5) / SAMPLES * area[-1]).clip(0, len(area) - 1)
    # Points of a low-discrepancy sequence (Roberts' R2), folded into the triangle.
    s, t = np.outer([0.7548776662466927, 0.5698402909980532], np.arange(SAMPLES)) % 1
    folded = s + t > 1
    s, t = np.where(folded, 1 - s, s)[:, None], np.where(folded, 1 - t, t)[:, None]
    return np.asarray(a[at] + s * (b[at] - a[at]) + t * (c[at] - a[at]))
