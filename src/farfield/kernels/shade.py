"""Colour and normal of a point on a triangle, shared by the kernels that turn visibility into pictures."""

from __future__ import annotations

import math

import numpy as np

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.compiling import device
from farfield.kernels.texture import texture_color

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@device
def is_textured(surface, materials, material):  # type: ignore[no-untyped-def]
    """Whether `albedo` will look at texture coordinates."""
    return materials.texture[material] >= 0 and surface.uvs.shape[0] > 0


@device
def albedo(surface, materials, material, ia, ib, ic, a, b, c, ux, vx, uy, vy):  # type: ignore[no-untyped-def]
    """Linear (r, g, b) at weights a, b, c of corners ia, ib, ic.

    ux, vx, uy, vy: change of the texture coordinates across the footprint to the right and down.
    """
    red = materials.base_color[material, 0]
    green = materials.base_color[material, 1]
    blue = materials.base_color[material, 2]
    if is_textured(surface, materials, material):
        texture = materials.texture[material]
        width = np.float32(materials.size[texture, 0])
        height = np.float32(materials.size[texture, 1])
        right = ux * ux * width * width + vx * vx * height * height
        down = uy * uy * width * width + vy * vy * height * height
        u = a * surface.uvs[ia, 0] + b * surface.uvs[ib, 0] + c * surface.uvs[ic, 0]
        v = a * surface.uvs[ia, 1] + b * surface.uvs[ib, 1] + c * surface.uvs[ic, 1]
        r, g, t = texture_color(materials, texture, u, v, max(right, down))
        red *= r
        green *= g
        blue *= t
    if surface.colors.shape[0] > 0:
        k = surface.colors
        red *= a * LINEAR_OF_BYTE[k[ia, 0]] + b * LINEAR_OF_BYTE[k[ib, 0]] + c * LINEAR_OF_BYTE[k[ic, 0]]
        green *= a * LINEAR_OF_BYTE[k[ia, 1]] + b * LINEAR_OF_BYTE[k[ib, 1]] + c * LINEAR_OF_BYTE[k[ic, 1]]
        blue *= a * LINEAR_OF_BYTE[k[ia, 2]] + b * LINEAR_OF_BYTE[k[ib, 2]] + c * LINEAR_OF_BYTE[k[ic, 2]]
    return red, green, blue


@device
def facing_normal(surface, ia, ib, ic, a, b, c, ex, ey, ez):  # type: ignore[no-untyped-def]
    """Unit shading normal on the side of the surface that faces the eye at (ex, ey, ez) from the point.

    Which side that is, the surface itself decides, not its winding: open shells show their back. Where there is no
    shading normal, that of the surface is taken.
    """
    n = surface.normals
    nx = a * n[ia, 0] + b * n[ib, 0] + c * n[ic, 0]
    ny = a * n[ia, 1] + b * n[ib, 1] + c * n[ic, 1]
    nz = a * n[ia, 2] + b * n[ib, 2] + c * n[ic, 2]
    p = surface.positions
    px = p[ib, 0] - p[ia, 0]
    py = p[ib, 1] - p[ia, 1]
    pz = p[ib, 2] - p[ia, 2]
    qx = p[ic, 0] - p[ia, 0]
    qy = p[ic, 1] - p[ia, 1]
    qz = p[ic, 2] - p[ia, 2]
    gx = py * qz - pz * qy
    gy = pz * qx - px * qz
    gz = px * qy - py * qx
    facing = gx * ex + gy * ey + gz * ez
    squared = nx * nx + ny * ny + nz * nz
    if squared > np.float32(1e-20):
        scale = _ONE / math.sqrt(squared)
        if facing * (gx * nx + gy * ny + gz * nz) < _ZERO:
            scale = -scale
    else:
        nx = gx
        ny = gy
        nz = gz
        scale = _ONE / math.sqrt(max(gx * gx + gy * gy + gz * gz, np.float32(1e-35)))
        if facing < _ZERO:
            scale = -scale
    return nx * scale, ny * scale, nz * scale
