"""Samples to pixels of one depth layer of an orthoview (OV 4.1; depth as a mean, with coverage: spec/orthoview.md).

Of the s x s samples of a pixel, those within `separation` of the nearest belong to the layer. Their depth, colour and
normal are averaged; samples of one triangle are shaded once, at their mean position (the shortcut that halves the
time on large triangles: attributes are linear, and texture levels are chosen by the footprint of the pixel).
"""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.shade import albedo, facing_normal, is_textured
from farfield.kernels.surface import F32_2, F32_3, FAR, MATERIALS, NOTHING, SURFACE, U32_2

PLANES = 9
"""Float planes of a resolved pixel: depth, coverage, unlit share, linear colour (3), mean normal (3)."""

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)


@device
def _shade(screen, surface, materials, toward, t, x, y, samples):  # type: ignore[no-untyped-def]
    """(r, g, b, nx, ny, nz, unlit) of triangle t at screen position x, y: linear albedo, unit normal (world axes)."""
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
    material = surface.materials[t]
    ux = _ZERO
    vx = _ZERO
    uy = _ZERO
    vy = _ZERO
    if is_textured(surface, materials, material):
        uvs = surface.uvs
        ub = uvs[ib, 0] - uvs[ia, 0]
        vb = uvs[ib, 1] - uvs[ia, 1]
        uc = uvs[ic, 0] - uvs[ia, 0]
        vc = uvs[ic, 1] - uvs[ia, 1]
        pixel = np.float32(inverse) * samples
        ux = (ub * np.float32(dcy) - uc * np.float32(dby)) * pixel
        vx = (vb * np.float32(dcy) - vc * np.float32(dby)) * pixel
        uy = (uc * np.float32(dbx) - ub * np.float32(dcx)) * pixel
        vy = (vc * np.float32(dbx) - vb * np.float32(dcx)) * pixel
    red, green, blue = albedo(surface, materials, material, ia, ib, ic, a, b, c, ux, vx, uy, vy)
    nx, ny, nz = facing_normal(surface, ia, ib, ic, a, b, c, toward[0], toward[1], toward[2])
    return red, green, blue, nx, ny, nz, np.float32(materials.unlit[material])


@kernel(
    types.int64(F32_2, SURFACE, MATERIALS, F32_2, types.int64, types.float32, F32_2, U32_2, F32_2, F32_3, U32_2),
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
    toward = (-axes[2, 0], -axes[2, 1], -axes[2, 2])
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
                    r, g, b, mx, my, mz, shown = _shade(screen, surface, materials, toward, t, x, y, spread)
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
