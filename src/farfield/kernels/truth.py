"""Visible samples of a perspective picture to light, and samples to pixels."""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.shade import albedo, facing_normal, is_textured
from farfield.kernels.surface import F32_2, F32_3, FAR, MATERIALS, NOTHING, SURFACE, U32_2

U16_3 = types.Array(types.uint16, 3, "C")

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)


@device
def _weights(b, c, wa, wb, wc):  # type: ignore[no-untyped-def]
    """Weights in space from weights on the screen and 1/w of the corners."""
    pa = (1.0 - b - c) * wa
    pb = b * wb
    pc = c * wc
    share = 1.0 / (pa + pb + pc)
    return np.float32(pa * share), np.float32(pb * share), np.float32(pc * share)


@kernel(
    types.void(F32_2, SURFACE, MATERIALS, F32_2, types.int64, U32_2, U16_3, F32_3, U32_2),
)
def light_samples(  # type: ignore[no-untyped-def]
    screen, surface, materials, light, samples, ids, radiance, normals, objects
):
    """Lights every sample that `ids` says was drawn.

    screen: (n, 4) float32 as for `rasterise`, perspective. surface: positions relative to the eye.
    light: (3, 3) float32 rows sun vector, ambient and sun radiance (`view.shading.Light.terms`).
    samples: along each side of a pixel. ids: (h samples, w samples) uint32; NOTHING: the sample stays as it is.
    radiance: (h samples, w samples, 3) uint16 in and out, linear, 65535 = 1, limited to 1.
    normals: (h, w, 3) float32, objects: (h, w) uint32 in and out: of the sample next to the pixel's centre.
    """
    middle = samples // 2
    positions = surface.positions
    for row in range(ids.shape[0]):
        for column in range(ids.shape[1]):
            t = ids[np.uintp(row), np.uintp(column)]
            if t == NOTHING:
                continue
            ia = np.uintp(surface.triangles[np.uintp(t), 0])
            ib = np.uintp(surface.triangles[np.uintp(t), 1])
            ic = np.uintp(surface.triangles[np.uintp(t), 2])
            ax = np.float64(screen[ia, 0])
            ay = np.float64(screen[ia, 1])
            bx = screen[ib, 0] - ax
            by = screen[ib, 1] - ay
            cx = screen[ic, 0] - ax
            cy = screen[ic, 1] - ay
            inverse = 1.0 / (bx * cy - cx * by)
            ox = column + 0.5 - ax
            oy = row + 0.5 - ay
            sb = (ox * cy - oy * cx) * inverse
            sc = (bx * oy - by * ox) * inverse
            wa, wb, wc = screen[ia, 3], screen[ib, 3], screen[ic, 3]
            a, b, c = _weights(sb, sc, wa, wb, wc)
            material = surface.materials[np.uintp(t)]
            ux = _ZERO
            vx = _ZERO
            uy = _ZERO
            vy = _ZERO
            if is_textured(surface, materials, material):
                uvs = surface.uvs
                ra, rb, rc = _weights(sb + cy * inverse, sc - by * inverse, wa, wb, wc)
                da, db, dc = _weights(sb - cx * inverse, sc + bx * inverse, wa, wb, wc)
                ux = (ra - a) * uvs[ia, 0] + (rb - b) * uvs[ib, 0] + (rc - c) * uvs[ic, 0]
                vx = (ra - a) * uvs[ia, 1] + (rb - b) * uvs[ib, 1] + (rc - c) * uvs[ic, 1]
                uy = (da - a) * uvs[ia, 0] + (db - b) * uvs[ib, 0] + (dc - c) * uvs[ic, 0]
                vy = (da - a) * uvs[ia, 1] + (db - b) * uvs[ib, 1] + (dc - c) * uvs[ic, 1]
            red, green, blue = albedo(surface, materials, material, ia, ib, ic, a, b, c, ux, vx, uy, vy)
            ex = -(a * positions[ia, 0] + b * positions[ib, 0] + c * positions[ic, 0])
            ey = -(a * positions[ia, 1] + b * positions[ib, 1] + c * positions[ic, 1])
            ez = -(a * positions[ia, 2] + b * positions[ib, 2] + c * positions[ic, 2])
            nx, ny, nz = facing_normal(surface, ia, ib, ic, a, b, c, ex, ey, ez)
            if materials.unlit[material] == 0:
                sun = max(nx * light[0, 0] + ny * light[0, 1] + nz * light[0, 2], _ZERO)
                red *= light[1, 0] + light[2, 0] * sun
                green *= light[1, 1] + light[2, 1] * sun
                blue *= light[1, 2] + light[2, 2] * sun
            out = radiance[np.uintp(row), np.uintp(column)]
            out[0] = np.uint16(min(max(red, _ZERO), _ONE) * np.float32(65535.0) + _HALF)
            out[1] = np.uint16(min(max(green, _ZERO), _ONE) * np.float32(65535.0) + _HALF)
            out[2] = np.uint16(min(max(blue, _ZERO), _ONE) * np.float32(65535.0) + _HALF)
            if row % samples == middle and column % samples == middle:
                normals[row // samples, column // samples, 0] = nx
                normals[row // samples, column // samples, 1] = ny
                normals[row // samples, column // samples, 2] = nz
                objects[row // samples, column // samples] = surface.objects[np.uintp(t)]


@kernel(types.void(U16_3, F32_2, types.int64, F32_3, F32_2, F32_2))
def average_samples(radiance, z, samples, color, alpha, depth):  # type: ignore[no-untyped-def]
    """Pixels of a picture.

    radiance: (h samples, w samples, 3) uint16; z: (h samples, w samples) float32, -1/w, FAR where nothing is.
    color: (h, w, 3) float32 out: mean linear radiance of the covered samples, 0 where none is.
    alpha: (h, w) float32 out: share of covered samples.
    depth: (h, w) float32 out: metres along the view axis at the sample next to the centre, infinite where nothing is.
    """
    middle = samples // 2
    for row in range(alpha.shape[0]):
        for column in range(alpha.shape[1]):
            red = 0.0
            green = 0.0
            blue = 0.0
            hits = 0
            for j in range(samples):
                for i in range(samples):
                    y = np.uintp(row * samples + j)
                    x = np.uintp(column * samples + i)
                    if z[y, x] < FAR:
                        hits += 1
                        red += radiance[y, x, 0]
                        green += radiance[y, x, 1]
                        blue += radiance[y, x, 2]
            share = 1.0 / (65535.0 * max(hits, 1))
            color[row, column, 0] = red * share
            color[row, column, 1] = green * share
            color[row, column, 2] = blue * share
            alpha[row, column] = hits / np.float64(samples * samples)
            centre = z[np.uintp(row * samples + middle), np.uintp(column * samples + middle)]
            depth[row, column] = -_ONE / centre if centre < FAR else np.inf
