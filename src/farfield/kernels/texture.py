"""Texture look-ups shared by the drawing kernels: repeat in both axes, nearest mip level, bilinear in linear light."""

from __future__ import annotations

import numpy as np

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.compiling import device

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_WALKED = np.float32(256.0)
"""Repetitions of a texture from its origin, up to which texels are told apart well enough in steps."""


@device
def fraction(value):  # type: ignore[no-untyped-def]
    """value - floor(value), without a call to a library; 0 for what is not finite or too large to have a fraction."""
    if not abs(value) < np.float32(1e9):
        return np.float32(0.0)
    part = value - np.float32(np.int64(value))
    return part + np.float32(1.0) if part < np.float32(0.0) else part


@device
def whole_below(value):  # type: ignore[no-untyped-def]
    """floor(value) of what is less than 1e9 in size."""
    part = np.float32(np.int64(value))
    return part - np.float32(1.0) if part > value else part


@device
def nearest_texel(materials, texture, u, v):  # type: ignore[no-untyped-def]
    """(row, column) in the full-resolution level."""
    width = materials.size[texture, 0]
    height = materials.size[texture, 1]
    column = min(np.int64(fraction(u) * np.float32(width)), width - 1)
    row = min(np.int64(fraction(v) * np.float32(height)), height - 1)
    return row, column


@device
def texture_color(materials, texture, u, v, footprint):  # type: ignore[no-untyped-def]
    """Linear (r, g, b) at u, v. footprint: squared length in full-resolution texels of what is averaged."""
    levels = materials.size[texture, 2]
    level = 0
    while footprint > 2.0 and level + 1 < levels:
        footprint *= np.float32(0.25)
        level += 1
    width = max(materials.size[texture, 0] >> level, 1)
    height = max(materials.size[texture, 1] >> level, 1)
    x = fraction(u) * np.float32(width) + _HALF
    y = fraction(v) * np.float32(height) + _HALF
    x0 = min(np.int64(x), width) - 1
    y0 = min(np.int64(y), height) - 1
    fx = x - np.float32(x0 + 1)
    fy = y - np.float32(y0 + 1)
    x1 = x0 + 1 if x0 + 1 < width else 0
    y1 = y0 + 1 if y0 + 1 < height else 0
    x0 = x0 if x0 >= 0 else width - 1
    y0 = y0 if y0 >= 0 else height - 1
    base = materials.level[texture, level]
    a = base + y0 * width
    b = base + y1 * width
    w00 = (np.float32(1.0) - fx) * (np.float32(1.0) - fy)
    w10 = fx * (np.float32(1.0) - fy)
    w01 = (np.float32(1.0) - fx) * fy
    w11 = fx * fy
    p = materials.pixels
    linear = LINEAR_OF_BYTE
    a0 = a + x0
    a1 = a + x1
    b0 = b + x0
    b1 = b + x1
    red = w00 * linear[p[a0, 0]] + w10 * linear[p[a1, 0]] + w01 * linear[p[b0, 0]] + w11 * linear[p[b1, 0]]
    green = w00 * linear[p[a0, 1]] + w10 * linear[p[a1, 1]] + w01 * linear[p[b0, 1]] + w11 * linear[p[b1, 1]]
    blue = w00 * linear[p[a0, 2]] + w10 * linear[p[a1, 2]] + w01 * linear[p[b0, 2]] + w11 * linear[p[b1, 2]]
    return red, green, blue


@device
def mask_steps(surface, materials, material, i, j, k, share):  # type: ignore[no-untyped-def]
    """How an alpha mask runs across a triangle of an orthographic view, for `is_masked_out`.

    share: 1 / (ea + eb + ec) of the edge functions.
    Returns (usable, byte, stride, width, height, x, y, right_b, down_b, right_c, down_c): whether there is a mask that
    alone decides; its first byte and bytes a row; its size; and the texel, x + eb right_b + ec right_c and
    y + eb down_b + ec down_c, not negative but for rounding.
    """
    texture = materials.texture[material]
    if texture < 0 or materials.mask[material] < 0 or surface.uvs.shape[0] == 0 or surface.colors.shape[0] > 0:
        return False, np.int64(0), np.int32(0), np.int32(0), np.int32(0), _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    width = materials.size[texture, 0]
    height = materials.size[texture, 1]
    uvs = surface.uvs
    u = uvs[i, 0]
    v = uvs[i, 1]
    left = whole_below(min(u, min(uvs[j, 0], uvs[k, 0])))
    top = whole_below(min(v, min(uvs[j, 1], uvs[k, 1])))
    wide = np.float32(width)
    high = np.float32(height)
    return (
        max(abs(u), max(abs(uvs[j, 0]), abs(uvs[k, 0]))) + max(abs(v), max(abs(uvs[j, 1]), abs(uvs[k, 1]))) < _WALKED,
        materials.mask[material],
        np.int32((width + 7) >> 3),
        width,
        height,
        (u - left) * wide,
        (v - top) * high,
        (uvs[j, 0] - u) * wide * share,
        (uvs[j, 1] - v) * high * share,
        (uvs[k, 0] - u) * wide * share,
        (uvs[k, 1] - v) * high * share,
    )


@device
def is_masked_out(materials, byte, stride, width, height, x, y):  # type: ignore[no-untyped-def]
    """Whether the mask that begins at `byte` cuts out the texel at x, y, which repeats; see `mask_steps`."""
    column = np.int32(max(x, _ZERO))
    row = np.int32(max(y, _ZERO))
    if column >= width:
        column %= width
    if row >= height:
        row %= height
    bits = materials.mask_bits[np.uintp(byte + np.int64(row * stride + (column >> 3)))]
    return (bits >> np.uint8(column & 7)) & 1 == 0


@device
def is_hole(surface, materials, material, i, j, k, a, b, c):  # type: ignore[no-untyped-def]
    """Whether an alpha-masked surface is cut out at weights a, b, c (summing to 1) of corners i, j, k.

    The nearest texel of the full-resolution level decides: over many samples that is the cover of the surface.
    """
    alpha = materials.base_color[material, 3]
    texture = materials.texture[material]
    if texture >= 0 and surface.uvs.shape[0] > 0:
        u = a * surface.uvs[i, 0] + b * surface.uvs[j, 0] + c * surface.uvs[k, 0]
        v = a * surface.uvs[i, 1] + b * surface.uvs[j, 1] + c * surface.uvs[k, 1]
        row, column = nearest_texel(materials, texture, u, v)
        width = np.int64(materials.size[texture, 0])
        if materials.mask[material] >= 0 and surface.colors.shape[0] == 0:
            byte = materials.mask_bits[np.uintp(materials.mask[material] + row * ((width + 7) >> 3) + (column >> 3))]
            return (byte >> np.uint8(column & 7)) & 1 == 0
        texel = materials.level[texture, 0] + row * width + column
        alpha *= materials.pixels[texel, 3] * np.float32(1.0 / 255.0)
    if surface.colors.shape[0] > 0:
        corner = a * surface.colors[i, 3] + b * surface.colors[j, 3] + c * surface.colors[k, 3]
        alpha *= corner * np.float32(1.0 / 255.0)
    return alpha < materials.cutoff[material]
