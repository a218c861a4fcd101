"""Resolved pixels to the integers of a layer: lattice steps, sRGB, hemi-octahedral normals (spec/orthoview.md)."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.geometry.color import BYTE_OF_LINEAR
from farfield.geometry.normals import MAXIMUM
from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F32_3, FAR, I32_2, U8_2, U8_3

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)


@device
def normal_code(x, y, z):  # type: ignore[no-untyped-def]
    """(a, b, length) of a mean normal in the frame (u, v, -w), with codes 0..63 as `geometry.normals.encode` gives.

    What points away from the camera (shading normals at silhouettes) is moved onto the rim of the hemisphere.
    """
    length = math.sqrt(x * x + y * y + z * z)
    z = max(z, _ZERO)
    total = abs(x) + abs(y) + z
    if total < np.float32(1e-12):
        return MAXIMUM // 2 + 1, MAXIMUM // 2 + 1, length
    scale = np.float32(0.5) / total
    a = math.floor(((x + y) * scale + _HALF) * np.float32(MAXIMUM) + _HALF)
    b = math.floor(((x - y) * scale + _HALF) * np.float32(MAXIMUM) + _HALF)
    return min(max(np.int64(a), 0), MAXIMUM), min(max(np.int64(b), 0), MAXIMUM), length


@kernel(
    types.void(F32_3, types.int64, types.int64, types.int64, I32_2, U8_3, U8_3, U8_2, U8_2, U8_2),
)
def quantise(  # type: ignore[no-untyped-def]
    pixels, depth_steps, coverage_steps, length_steps, depth, color, normal, length, coverage, flags
):
    """pixels (h, w, 9) float32 as left by `resolve` -> integer planes; all but depth are 0 where nothing is.

    depth: (h, w) int32 out: round(mean depth * depth_steps), -2^31 where nothing is.
    color (h, w, 3), normal (h, w, 2), length, coverage, flags (h, w): uint8 out, as in OrthoLayer (flags: unlit only).
    """
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            y = np.uintp(row)
            x = np.uintp(column)
            pixel = pixels[y, x]
            if pixel[0] >= FAR:
                depth[y, x] = -2147483648
                color[y, x, 0] = color[y, x, 1] = color[y, x, 2] = 0
                normal[y, x, 0] = normal[y, x, 1] = 0
                length[y, x] = coverage[y, x] = flags[y, x] = 0
                continue
            depth[y, x] = np.int32(math.floor(np.float64(pixel[0]) * depth_steps + 0.5))
            for k in range(3):
                linear = min(max(pixel[3 + k], _ZERO), _ONE)
                color[y, x, k] = BYTE_OF_LINEAR[np.int64(linear * np.float32(4095.0) + _HALF)]
            a, b, size = normal_code(pixel[6], pixel[7], pixel[8])
            normal[y, x, 0] = a
            normal[y, x, 1] = b
            eighths = np.int64(math.floor(size * np.float32(length_steps) + _HALF))
            length[y, x] = min(max(eighths, 1), length_steps)
            filled = np.int64(math.floor(pixel[1] * np.float32(coverage_steps) + _HALF))
            coverage[y, x] = min(max(filled, 1), coverage_steps)
            flags[y, x] = 2 if pixel[2] > _HALF else 0
