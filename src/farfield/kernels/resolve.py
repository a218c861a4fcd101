"""Samples to pixels of one depth layer of an orthoview (OV 4.1; depth as a mean, with coverage: spec/orthoview.md).

Of the s x s samples of a pixel, those within `separation` of the nearest belong to the layer. Their depth, colour and
normal are averaged; samples of one triangle are shaded once, at their mean position (the shortcut that halves the
time on large triangles: attributes are linear, and texture levels are chosen by the footprint of the pixel).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.surface import F32_2, F32_3, FAR, MATERIALS, NOTHING, SURFACE, U32_2
from farfield.kernels.texture import texture_color

PLANES = 9
"""Float planes of a resolved pixel: depth, coverage, unlit share, linear colour (3), mean normal (3)."""

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _shade(screen, surface, materials, toward, t, x, y, samples):  # type: ignore[no-untyped-def]
    """(depth, r, g, b, nx, ny, nz, unlit) of triangle t at screen position x, y: linear albedo, unit normal (world).

    The normal is on the side of the surface that faces `toward`, whatever the winding: open shells show their back.
    """
    ia = np.uintp(surface.triangles[t, 0])
    ib = np.uintp(surface.triangles[t, 1])
    ic = np.uintp(surface.triangles[t, 2])
    ax = screen[ia, 0]
    ay = screen[ia, 1]
    # In float64: the area of a long sliver is the difference of products that single precision cannot hold.
    dbx = np.float64(screen[ib, 0]) - ax
    dby = np.float64(screen[ib, 1]) - ay
    dcx = np.float64(screen[ic, 0]) - ax
    dcy = np.float64(screen[ic, 1]) - ay
    inverse = 1.0 / (dbx * dcy - dcx * dby)
    ox = np.float64(x) - ax
    oy = np.float64(y) - ay
    b = np.float32((ox * dcy - oy * dcx) * inverse)
    c = np.float32((dbx * oy - dby * ox) * inverse)
    a = _ONE - b - c
    depth = a * screen[ia, 2] + b * screen[ib, 2] + c * screen[ic, 2]
    material = surface.materials[t]
    red = materials.base_color[material, 0]
    green = materials.base_color[material, 1]
    blue = materials.base_color[material, 2]
    texture = materials.texture[material]
    if texture >= 0 and surface.uvs.shape[0] > 0:
        ub = surface.uvs[ib, 0] - surface.uvs[ia, 0]
        vb = surface.uvs[ib, 1] - surface.uvs[ia, 1]
        uc = surface.uvs[ic, 0] - surface.uvs[ia, 0]
        vc = surface.uvs[ic, 1] - surface.uvs[ia, 1]
        bx = np.float32(dbx)
        by = np.float32(dby)
        cx = np.float32(dcx)
        cy = np.float32(dcy)
        share = np.float32(inverse)
        across = share * samples * np.float32(materials.size[texture, 0])
        along = share * samples * np.float32(materials.size[texture, 1])
        ux = (ub * cy - uc * by) * across
        uy = (uc * bx - ub * cx) * across
        vx = (vb * cy - vc * by) * along
        vy = (vc * bx - vb * cx) * along
        footprint = max(ux * ux + vx * vx, uy * uy + vy * vy)
        u = surface.uvs[ia, 0] + b * ub + c * uc
        v = surface.uvs[ia, 1] + b * vb + c * vc
        tr, tg, tb = texture_color(materials, texture, u, v, footprint)
        red *= tr
        green *= tg
        blue *= tb
    if surface.colors.shape[0] > 0:
        k = surface.colors
        red *= a * LINEAR_OF_BYTE[k[ia, 0]] + b * LINEAR_OF_BYTE[k[ib, 0]] + c * LINEAR_OF_BYTE[k[ic, 0]]
        green *= a * LINEAR_OF_BYTE[k[ia, 1]] + b * LINEAR_OF_BYTE[k[ib, 1]] + c * LINEAR_OF_BYTE[k[ic, 1]]
        blue *= a * LINEAR_OF_BYTE[k[ia, 2]] + b * LINEAR_OF_BYTE[k[ib, 2]] + c * LINEAR_OF_BYTE[k[ic, 2]]
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
    facing = gx * toward[0] + gy * toward[1] + gz * toward[2]
    squared = nx * nx + ny * ny + nz * nz
    if squared > np.float32(1e-20):
        scale = _ONE / math.sqrt(squared)
        if facing * (gx * nx + gy * ny + gz * nz) < _ZERO:
            scale = -scale
    else:  # no shading normal: the surface's own
        nx = gx
        ny = gy
        nz = gz
        scale = math.copysign(_ONE / math.sqrt(max(gx * gx + gy * gy + gz * gz, np.float32(1e-35))), facing)
    unlit = np.float32(materials.unlit[material])
    return depth, red, green, blue, nx * scale, ny * scale, nz * scale, unlit


@njit(
    types.int64(F32_2, SURFACE, MATERIALS, F32_2, types.int64, types.float32, F32_2, U32_2, F32_2, F32_3, U32_2),
    cache=True,
    nogil=True,
    error_model="numpy",
)
def resolve(  # type: ignore[no-untyped-def]
    screen, surface, materials, axes, samples, separation, depth, ids, behind, pixels, objects
):
    """Averages samples x samples blocks of a visibility buffer; returns the number of pixels with a surface.

    screen, surface, materials: as drawn by `rasterise`; screen z in pixel pitches.
    axes: (3, 3) float32 rows u, v, w of the direction.
    separation: pixel pitches; farther samples of a pixel do not belong to the layer.
    depth, ids: (h samples, w samples) as left by `rasterise`.
    behind: (h samples, at least w samples) float32 out: nearest depth of the pixel + separation, FAR where it is empty:
        the limit for drawing the next layer; (0, 0): not wanted.
    pixels: (h, w, PLANES) float32 out: mean depth (FAR = empty), filled share, unlit share, mean linear colour, mean
        normal in the frame (u, v, -w), its length telling how much the normals agree.
    objects: (h, w) uint32 out: object of the nearest sample, 0 = none.
    """
    s = np.uintp(samples)
    inverse = _ONE / np.float32(samples)
    spread = np.float32(samples)
    toward = -axes[2]
    keep_limits = behind.shape[0] > 0
    valid = 0
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            y0 = np.uintp(row) * s
            x0 = np.uintp(column) * s
            nearest = FAR
            winner = NOTHING
            for j in range(s):
                for i in range(s):
                    z = depth[y0 + j, x0 + i]
                    if z < nearest:
                        nearest = z
                        winner = ids[y0 + j, x0 + i]
            out = pixels[np.uintp(row), np.uintp(column)]
            limit = nearest + separation if nearest < FAR else FAR
            if keep_limits:
                for j in range(s):
                    for i in range(s):
                        behind[y0 + j, x0 + i] = limit
            if nearest >= FAR:
                out[0] = FAR
                for k in range(1, PLANES):
                    out[k] = _ZERO
                objects[np.uintp(row), np.uintp(column)] = 0
                continue
            filled = 0
            done = np.uint64(0)
            z_sum = _ZERO
            red = _ZERO
            green = _ZERO
            blue = _ZERO
            nx = _ZERO
            ny = _ZERO
            nz = _ZERO
            unlit = _ZERO
            for j in range(s):
                for i in range(s):
                    here = np.uint64(j * s + i)
                    if (done >> here) & np.uint64(1) or depth[y0 + j, x0 + i] > limit:
                        continue
                    t = ids[y0 + j, x0 + i]
                    count = 0
                    sum_x = 0
                    sum_y = 0
                    for jj in range(j, s):
                        for ii in range(s):
                            if ids[y0 + jj, x0 + ii] == t and depth[y0 + jj, x0 + ii] <= limit:
                                done |= np.uint64(1) << np.uint64(jj * s + ii)
                                count += 1
                                sum_x += np.int64(ii)
                                sum_y += np.int64(jj)
                                z_sum += depth[y0 + jj, x0 + ii]
                    weight = np.float32(count)
                    x = np.float32(x0) + _HALF + np.float32(sum_x) / weight
                    y = np.float32(y0) + _HALF + np.float32(sum_y) / weight
                    z, r, g, b, mx, my, mz, shown = _shade(screen, surface, materials, toward, t, x, y, spread)
                    filled += count
                    red += weight * r
                    green += weight * g
                    blue += weight * b
                    nx += weight * mx
                    ny += weight * my
                    nz += weight * mz
                    unlit += weight * shown
            share = _ONE / np.float32(filled)
            out[0] = z_sum * share
            out[1] = np.float32(filled) * inverse * inverse
            out[2] = unlit * share
            out[3] = red * share
            out[4] = green * share
            out[5] = blue * share
            out[6] = (nx * axes[0, 0] + ny * axes[0, 1] + nz * axes[0, 2]) * share
            out[7] = (nx * axes[1, 0] + ny * axes[1, 1] + nz * axes[1, 2]) * share
            out[8] = (nx * toward[0] + ny * toward[1] + nz * toward[2]) * share
            objects[np.uintp(row), np.uintp(column)] = surface.objects[winner]
            valid += 1
    return valid
