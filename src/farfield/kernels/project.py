"""Corners to the screen, in float64, rounded to the corner grid of the rasterisers."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import kernel
from farfield.kernels.edges import SUBSAMPLES
from farfield.kernels.surface import F32_2, F64_1, F64_2, U32_2


@kernel(types.void(F32_2, F64_2, F64_2))
def lattice_bounds(positions, matrix, bounds):  # type: ignore[no-untyped-def]
    """positions (n, 3) float32, matrix (3, 4) float64 -> bounds (2, 3) float64: least and largest of matrix @ p."""
    for row in range(3):
        a, b, c, d = matrix[row, 0], matrix[row, 1], matrix[row, 2], matrix[row, 3]
        low = np.inf
        high = -np.inf
        for i in range(positions.shape[0]):
            value = a * positions[i, 0] + b * positions[i, 1] + c * positions[i, 2] + d
            low = min(low, value)
            high = max(high, value)
        bounds[0, row] = low
        bounds[1, row] = high


@kernel(types.void(F32_2, F64_2, F64_1, types.int64, F32_2))
def project_orthographic(positions, matrix, first, samples, screen):  # type: ignore[no-untyped-def]
    """Corners of an orthographic view.

    positions: (n, 3) float32. matrix: (3, 4) float64 to lattice pitches along u, v, w. first: (3,) float64, the whole
    pitches of the upper left pixel and of the zero of depth. samples: along each side of a pixel.
    screen: (n, 4) float32 out, as `rasterise` takes it; z in pitches.
    """
    grain = np.float64(samples * SUBSAMPLES)
    for i in range(positions.shape[0]):
        x = np.float64(positions[i, 0])
        y = np.float64(positions[i, 1])
        z = np.float64(positions[i, 2])
        u = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + (matrix[0, 3] - first[0])
        v = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + (matrix[1, 3] - first[1])
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + (matrix[2, 3] - first[2])
        screen[i, 0] = np.float64(np.int64(u * grain + 0.5)) * (1.0 / SUBSAMPLES)
        screen[i, 1] = np.float64(np.int64(v * grain + 0.5)) * (1.0 / SUBSAMPLES)
        screen[i, 2] = w
        screen[i, 3] = 1.0


@kernel(types.float64(F32_2, U32_2, types.int64))
def mean_area(screen, triangles, stride):  # type: ignore[no-untyped-def]
    """Mean area in samples of every stride-th triangle; screen (n, 4) float32, triangles (m, 3) uint32, m > 0."""
    total = 0.0
    count = 0
    for t in range(0, triangles.shape[0], stride):
        a = np.uintp(triangles[t, 0])
        b = np.uintp(triangles[t, 1])
        c = np.uintp(triangles[t, 2])
        ux = screen[b, 0] - screen[a, 0]
        uy = screen[b, 1] - screen[a, 1]
        vx = screen[c, 0] - screen[a, 0]
        vy = screen[c, 1] - screen[a, 1]
        total += 0.5 * abs(ux * vy - uy * vx)
        count += 1
    return total / count


@kernel(types.void(F32_2, F64_2, F64_2))
def to_clip(positions, matrix, clip):  # type: ignore[no-untyped-def]
    """positions (n, 3) float32, relative to the eye; matrix (3, 3) float64; clip (n, 3) float64 out: matrix @ p."""
    for i in range(positions.shape[0]):
        x = np.float64(positions[i, 0])
        y = np.float64(positions[i, 1])
        z = np.float64(positions[i, 2])
        for row in range(3):
            clip[i, row] = matrix[row, 0] * x + matrix[row, 1] * y + matrix[row, 2] * z


@kernel(types.int64(F64_2, F32_2))
def project_perspective(clip, screen):  # type: ignore[no-untyped-def]
    """Corners of a perspective view: clip (n, 3) float64 rows (x w, y w, w) in samples, w > 0 -> screen (n, 4) float32.

    Screen z is -1 / w. Rows with w <= 0 become NaN, which draws nothing; returns how many.
    """
    lost = 0
    for i in range(clip.shape[0]):
        w = clip[i, 2]
        if not w > 0.0:
            for k in range(4):
                screen[i, k] = np.nan
            lost += 1
            continue
        inverse = 1.0 / w
        screen[i, 0] = math.floor(clip[i, 0] * inverse * SUBSAMPLES + 0.5) * (1.0 / SUBSAMPLES)
        screen[i, 1] = math.floor(clip[i, 1] * inverse * SUBSAMPLES + 0.5) * (1.0 / SUBSAMPLES)
        screen[i, 2] = -inverse
        screen[i, 3] = inverse
    return lost
