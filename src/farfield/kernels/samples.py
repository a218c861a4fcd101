"""Visible samples of a perspective picture into the frame that pictures come out of (spec/drawing.md)."""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.geometry.color import BYTE_OF_LINEAR
from farfield.kernels.compiling import device, kernel
from farfield.kernels.shade import albedo, facing_normal, is_textured
from farfield.kernels.splat import LIGHT_STEPS, UNLIT_LIGHT
from farfield.kernels.surface import F32_1, F32_2, MATERIALS, NOTHING, SURFACE, U32_2

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_LIGHT_STEPS = np.float32(LIGHT_STEPS)


@device
def _byte(linear):  # type: ignore[no-untyped-def]
    return np.uint32(BYTE_OF_LINEAR[np.int64(min(max(linear, _ZERO), _ONE) * np.float32(4095.0) + _HALF)])


@device
def _ten(component):  # type: ignore[no-untyped-def]
    """A component of a unit vector in ten bits, 0..1022 for -1..1."""
    return np.uint32((min(max(component, -_ONE), _ONE) + _ONE) * np.float32(511.0) + _HALF)


@device
def _weights(b, c, wa, wb, wc):  # type: ignore[no-untyped-def]
    """Weights in space from weights on the screen and 1/w of the corners."""
    pa = (1.0 - b - c) * wa
    pb = b * wb
    pc = c * wc
    share = 1.0 / (pa + pb + pc)
    return np.float32(pa * share), np.float32(pb * share), np.float32(pc * share)


@kernel(types.void(F32_2, SURFACE, MATERIALS, F32_1, F32_2, U32_2, F32_2, U32_2, U32_2, U32_2))
def fill_frame(  # type: ignore[no-untyped-def]
    screen, surface, materials, sun, z, ids, frame_depth, frame_surface, frame_normal, frame_object
):
    """Writes every sample that `ids` says was drawn.

    screen: (n, 4) float32 as for `rasterise`, perspective. surface: positions relative to the eye.
    sun: (3,) float32 unit vector towards the sun. z: (h, w) float32, -1/w. ids: (h, w) uint32; NOTHING: the sample
    stays as it is.
    frame_depth, frame_surface, frame_normal, frame_object: of a Frame, as `splat.splat_layer` describes them; the last
    two may be (0, 0).
    """
    with_normals = frame_normal.size > 0
    with_objects = frame_object.size > 0
    positions = surface.positions
    for y in range(ids.shape[0]):
        for x in range(ids.shape[1]):
            row = np.uintp(y)
            column = np.uintp(x)
            t = ids[row, column]
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
            ox = x + 0.5 - ax
            oy = y + 0.5 - ay
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
            cosine = nx * sun[0] + ny * sun[1] + nz * sun[2]
            shown = np.uint32(UNLIT_LIGHT)
            if materials.unlit[material] == 0:
                shown = np.uint32(min(max(cosine, _ZERO), _ONE) * _LIGHT_STEPS + _HALF)
            packed = np.uint32(shown << np.uint32(24)) | (_byte(blue) << np.uint32(16))
            frame_surface[row, column] = packed | (_byte(green) << np.uint32(8)) | _byte(red)
            frame_depth[row, column] = -_ONE / z[row, column]
            if with_normals:
                frame_normal[row, column] = _ten(nx) | (_ten(ny) << np.uint32(10)) | (_ten(nz) << np.uint32(20))
            if with_objects:
                frame_object[row, column] = surface.objects[np.uintp(t)]
