"""Lighting a supersampled frame and averaging it down to the picture (spec/drawing.md, Splats and Light)."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.compiling import kernel
from farfield.kernels.splat import LIGHT_STEPS, UNLIT_LIGHT

_F0, _F1 = np.float32(0.0), np.float32(1.0)
_LIGHT = (np.arange(256) / LIGHT_STEPS).astype(np.float32)
_UNLIT = np.uint32(UNLIT_LIGHT)
_NORMAL = np.float32(1.0 / 511.0)


@kernel(
    types.void(
        types.float32[:, ::1], types.uint32[:, ::1], types.Array(types.float32, 2, "C", readonly=True),
        types.Array(types.float32, 3, "C", readonly=True), types.int64,
        types.float32[:, :, ::1], types.float32[:, ::1], types.float32[:, ::1],
    )
)  # fmt: skip
def average_color(depth, surface, terms, veil, k, color, alpha, nearest):  # type: ignore[no-untyped-def]
    """Lights every sample and averages k x k of them.

    depth, surface: (k h, k w) as splat_layer leaves them. terms: (3, 3) float32, see Light.terms.
    veil: (h, w, 4) float32 colour of the haze and its share a metre of depth, see Light.veil; (0, 0, 4): none.
    color: (h, w, 3) float32 linear light, mean of the covered samples; alpha: (h, w) float32; nearest: (h, w) float32
    metres, inf = nothing. All three are written.
    """
    height, width = alpha.shape
    hazy = veil.shape[0] > 0
    for y in range(height):
        for x in range(width):
            red, green, blue, near = _F0, _F0, _F0, np.float32(np.inf)
            count = 0
            for j in range(y * k, (y + 1) * k):
                for i in range(x * k, (x + 1) * k):
                    if depth[j, i] == np.inf:
                        continue
                    near = min(near, depth[j, i])
                    count += 1
                    packed = surface[j, i]
                    light = packed >> np.uint32(24)
                    r = LINEAR_OF_BYTE[packed & np.uint32(255)]
                    g = LINEAR_OF_BYTE[(packed >> np.uint32(8)) & np.uint32(255)]
                    b = LINEAR_OF_BYTE[(packed >> np.uint32(16)) & np.uint32(255)]
                    if light != _UNLIT:
                        cosine = _LIGHT[light]
                        r *= terms[1, 0] + cosine * terms[2, 0]
                        g *= terms[1, 1] + cosine * terms[2, 1]
                        b *= terms[1, 2] + cosine * terms[2, 2]
                    r, g, b = min(r, _F1), min(g, _F1), min(b, _F1)
                    if hazy:
                        clear = math.exp(-veil[y, x, 3] * depth[j, i])
                        r = veil[y, x, 0] + clear * (r - veil[y, x, 0])
                        g = veil[y, x, 1] + clear * (g - veil[y, x, 1])
                        b = veil[y, x, 2] + clear * (b - veil[y, x, 2])
                    red += r
                    green += g
                    blue += b
            share = _F1 / np.float32(max(count, 1))
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = red * share, green * share, blue * share
            alpha[y, x] = np.float32(count) / np.float32(k * k)
            nearest[y, x] = near


@kernel(
    types.void(types.float32[:, ::1], types.uint32[:, ::1], types.int64, types.float32[:, :, ::1])
)  # fmt: skip
def average_normals(depth, packed, k, normal):  # type: ignore[no-untyped-def]
    """Mean normal of the covered samples, unit or 0.

    depth, packed: (k h, k w) as splat_layer leaves them. normal: (h, w, 3) float32, written.
    """
    height, width, _ = normal.shape
    for y in range(height):
        for x in range(width):
            a, b, c = _F0, _F0, _F0
            for j in range(y * k, (y + 1) * k):
                for i in range(x * k, (x + 1) * k):
                    if depth[j, i] < np.inf:
                        a += np.float32(packed[j, i] & np.uint32(1023)) * _NORMAL - _F1
                        b += np.float32((packed[j, i] >> np.uint32(10)) & np.uint32(1023)) * _NORMAL - _F1
                        c += np.float32((packed[j, i] >> np.uint32(20)) & np.uint32(1023)) * _NORMAL - _F1
            size = math.sqrt(a * a + b * b + c * c)
            inverse = _F1 / size if size > _F0 else _F0
            normal[y, x, 0], normal[y, x, 1], normal[y, x, 2] = a * inverse, b * inverse, c * inverse


@kernel(
    types.void(types.float32[:, ::1], types.uint32[:, ::1], types.int64, types.uint32[:, ::1])
)  # fmt: skip
def nearest_object(depth, objects, k, ids):  # type: ignore[no-untyped-def]
    """The object of the nearest sample of each pixel; ids: (h, w) uint32, written, 0 = none."""
    height, width = ids.shape
    for y in range(height):
        for x in range(width):
            near, name = np.float32(np.inf), np.uint32(0)
            for j in range(y * k, (y + 1) * k):
                for i in range(x * k, (x + 1) * k):
                    if depth[j, i] < near:
                        near, name = depth[j, i], objects[j, i]
            ids[y, x] = name
