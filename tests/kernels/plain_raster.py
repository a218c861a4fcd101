"""The plain twin of the rasterisers: every triangle against every sample, in whole numbers."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.surface import FAR, NOTHING

Corner = tuple[int, int]


def edge(p: Corner, q: Corner, s: Corner) -> int:
    """Twice the area of p, q, s."""
    return (q[0] - p[0]) * (s[1] - p[1]) - (q[1] - p[1]) * (s[0] - p[0])


def owns(p: Corner, q: Corner) -> bool:
    """Whether the triangle to the left of p -> q (edge function positive) has the samples on that edge."""
    right, down = -(q[1] - p[1]), q[0] - p[0]
    return right > 0 or (right == 0 and down > 0)


def covers(triangle: list[Corner], sample: Corner) -> list[int] | None:
    """Weights of the corners times twice the area, or None when the sample is not covered. Grid of 1/256 sample."""
    area = edge(*triangle)
    if area == 0:
        return None
    order = triangle if area > 0 else [triangle[0], triangle[2], triangle[1]]
    weights = []
    for k in range(3):
        p, q = order[(k + 1) % 3], order[(k + 2) % 3]
        e = edge(p, q, sample)
        if e < 0 or (e == 0 and not owns(p, q)):
            return None
        weights.append(e)
    return weights if area > 0 else [weights[0], weights[2], weights[1]]


def rasterise(
    screen: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    width: int,
    height: int,
    behind: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Depth and triangle of the nearest fragment; for triangles without masks."""
    depth = np.full((height, width), float(FAR))
    ids = np.full((height, width), NOTHING, dtype=np.uint32)
    for t, triangle in enumerate(triangles):
        corners = [(round(float(screen[i, 0]) * 256), round(float(screen[i, 1]) * 256)) for i in triangle]
        z = [Fraction(float(screen[i, 2])) for i in triangle]
        for y in range(height):
            for x in range(width):
                weights = covers(corners, (x * 256 + 128, y * 256 + 128))
                if weights is None:
                    continue
                here = float(sum(w * k for w, k in zip(weights, z, strict=True)) / sum(weights))
                if here < depth[y, x] and (behind is None or here > behind[y, x]):
                    depth[y, x] = here
                    ids[y, x] = t
    return depth, ids


def grid(value: float) -> float:
    """On the corner grid."""
    return math.floor(value * 256 + 0.5) / 256
