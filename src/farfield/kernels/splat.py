"""Splatting one orthoview layer into a frame (OV 5.2; spec/drawing.md, Splats).

The frame keeps albedo and the mean cosine to the sun rather than colour: lighting then costs one pass over the frame
instead of one evaluation of the colours a splat, and the sky, unlit materials and other lights need no second kernel.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.geometry.normals import DECODED
from farfield.kernels.compiling import device, kernel

ORIGIN, TO_X, TO_Y, TO_W, SUN, LOWER, UPPER, WORLD_X, WORLD_Y, WORLD_Z = range(10)
"""Rows of a placement (10, 3) float32, all but the box in the layer's own frame (u, v, w), metres:

ORIGIN: from the eye to lattice column and row 0 of the arrays' corner at depth code 0.
TO_X, TO_Y, TO_W: rows of the linear part of the camera's matrix; TO_W is its forward vector.
SUN: unit vector towards the sun.
LOWER, UPPER: corners of the box to clip to, relative to the eye, along the world's axes; half-open.
WORLD_X, WORLD_Y, WORLD_Z: the world's axes, to turn points and normals into the world's frame.
"""

BY_FLAG, DISCS, WARPED_DISCS, ELLIPSES = range(4)
"""Shapes of footprints: ellipses of connected pixels and discs of the others, as viewers draw them. For comparison (OV
Figure 8, b to d): discs inscribed in the pixel, discs about the pixel warped by its normal, ellipses of all pixels."""

UNLIT_LIGHT = 255
"""Light byte of a surface that is shown as it is."""
LIGHT_STEPS = 254
"""Light byte of a surface that faces the sun squarely."""
STEEPEST = 4.0
"""A surface rising more than this many pixels a pixel is drawn as if it rose no more."""

FOOTPRINT = (
    0.0, 0.1995, 0.2821, 0.3455, 0.3989, 0.4460, 0.4886, 0.5278, 0.5642,
    0.5984, 0.6308, 0.6616, 0.6910, 0.7217, 0.7660, 0.8301, 1.0,
)  # fmt: skip
"""By coverage in sixteenths, how much smaller than that of a full pixel a footprint is along both axes: the ellipses of
a plane of equal pixels fill that share of it. Scaling areas by the coverage, though full pixels overlap by half their
area and thin ones not at all, showed a cover of 30 % as 47: worth 0.1 to 0.3 dB in a city and at statues, -0.1 in a
forest, and in FLIP everywhere."""

_FOOTPRINT = np.array(FOOTPRINT, dtype=np.float32)
_COVERAGE = (np.arange(17) / 16.0).astype(np.float32)
_OPEN_BITS = np.log2(np.maximum(1.0 - np.arange(17) / 16.0, 1e-30)).astype(np.float32)
_LENGTH = (np.arange(9) / 8.0).astype(np.float32)
_TWO_THIRDS = np.float32(2.0 / 3.0)
_F0, _F1, _HALF, _QUARTER = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(0.25)
_SLOPE = np.float32(STEEPEST)
_LEAST = np.float32(0.001)
_ROOT_HALF = np.float32(math.sqrt(0.5))
_HALF_PI = np.float32(math.pi / 2)
_FAR = np.float32(1e9)
_STEPS = np.float32(LIGHT_STEPS)
_HASH_UNIT = np.float32(1.0 / 4294967296.0)

_U8_2 = types.Array(types.uint8, 2, "C", readonly=True)
_U8_3 = types.Array(types.uint8, 3, "C", readonly=True)
_U16 = types.Array(types.uint16, 2, "C", readonly=True)
_U32 = types.Array(types.uint32, 2, "C", readonly=True)
_F32 = types.Array(types.float32, 2, "C", readonly=True)


@device
def _lattice_hash(row_hash, column):  # type: ignore[no-untyped-def]
    """32-bit hash of a lattice position (Wang-style mixing); row_hash is row * 0x85EBCA77 modulo 2^32."""
    mask = np.uint64(0xFFFFFFFF)
    h = ((np.uint64(column) * np.uint64(0x9E3779B1)) & mask) ^ row_hash
    h = ((h ^ (h >> np.uint64(15))) * np.uint64(0x2C1B3C6D)) & mask
    h = ((h ^ (h >> np.uint64(12))) * np.uint64(0x297A2D39)) & mask
    return h ^ (h >> np.uint64(15))


@device
def _lambert(cosine, length):  # type: ignore[no-untyped-def]
    """Mean of max(0, cos) to the sun over normals whose mean has this direction's cosine and this length."""
    mu = length * cosine
    if length <= _HALF:
        return _QUARTER + _HALF * mu
    spread = (_F1 - length) * (np.float32(0.36) + np.float32(0.28) * length)
    return _HALF * (mu + math.sqrt(mu * mu + spread * max(_F0, _F1 - cosine * cosine)))


@device
def _loose_light(nu, nv, nw, length, cu, cv, cw, sun):  # type: ignore[no-untyped-def]
    """Mean of max(0, cos) to the sun for loose surfaces, which show the eye another side than the view's camera.

    The mean normal (nu, nv, nw) * length is taken apart into leaves that face everywhere, whose mean as seen is two
    thirds long and faces whoever looks, and a flat rest. The one turns to the eye, at -c; the other shows its side.
    """
    inverse = -_F1 / math.sqrt(cu * cu + cv * cv + cw * cw)
    eu, ev, ew = cu * inverse, cv * inverse, cw * inverse
    mu, mv, mw = length * nu, length * nv, length * nw
    half = _F1 + _TWO_THIRDS * mw
    root = math.sqrt(max(_F0, half * half - np.float32(5.0 / 9.0) * (_F1 - length * length)))
    around = min(_TWO_THIRDS * min(_F1, np.float32(1.8) * (half - root)), -mw)
    mw += around
    side = -_F1 if mu * eu + mv * ev + mw * ew < _F0 else _F1
    mu, mv, mw = side * mu + around * eu, side * mv + around * ev, side * mw + around * ew
    seen = min(_F1, math.sqrt(mu * mu + mv * mv + mw * mw))
    cosine = (mu * sun[0] + mv * sun[1] + mw * sun[2]) / max(seen, np.float32(1e-6))
    return _lambert(cosine, seen)


@device
def _thin_chance(whole, coverage):  # type: ignore[no-untyped-def]
    """Chance that a splat of less than a sample is drawn. whole: samples that the pixel would cover if it were full."""
    if whole >= _F1:
        return whole * _COVERAGE[coverage]
    return _F1 - np.float32(2.0) ** (whole * _OPEN_BITS[coverage])


@device
def _pack_normal(placement, nu, nv, nw):  # type: ignore[no-untyped-def]
    """World normal in ten bits an axis, 0..1022 for -1..1, x lowest."""
    packed = np.uint32(0)
    for axis in range(3):
        row = placement[WORLD_X + axis]
        n = row[0] * nu + row[1] * nv + row[2] * nw
        packed |= np.uint32((min(max(n, -_F1), _F1) + _F1) * np.float32(511.0) + _HALF) << np.uint32(10 * axis)
    return packed


@kernel(
    types.int64(
        _U16, _U8_3, _U8_3, _U8_2, _U8_2, _U8_2, _U32,
        types.int64, types.int64, _F32, types.float32, types.float32, types.float32, types.boolean, types.int64,
        types.float32[:, ::1], types.uint32[:, ::1], types.uint32[:, ::1], types.uint32[:, ::1],
    )
)  # fmt: skip
def splat_layer(  # type: ignore[no-untyped-def]
    depth, color, normal, length, coverage, flags, objects,
    lattice_x, lattice_y, placement, pitch, near, widest, clip, shape,
    frame_depth, frame_surface, frame_normal, frame_object,
):  # fmt: skip
    """Draws the splats of one layer; returns how many touched or could have touched the frame.

    depth .. objects: the arrays of an OrthoLayer; objects may be (0, 0). lattice_x, lattice_y: its x and y, which the
    hash of thin splats needs. placement: (10, 3) float32, see ORIGIN. pitch, near: metres. widest: samples from
    the middle to the edge of splats that are not connected, wider ones are left out. clip: whether LOWER and UPPER
    apply. shape: of footprints, BY_FLAG to ELLIPSES.
    frame_depth: (H, W) float32 metres along the view axis, up to a pitch behind what is drawn; inf = nothing.
    frame_surface: (H, W) uint32, sRGB albedo in the low three bytes (red lowest) and the light byte. frame_normal:
    (H, W) uint32 or (0, 0), world normal, ten bits an axis (x lowest). frame_object: (H, W) uint32 or (0, 0).
    """
    rows, columns = depth.shape
    height, width = frame_depth.shape
    with_normals = frame_normal.size > 0
    with_objects = frame_object.size > 0
    own_objects = objects.size > 0
    xu, xv, xw = placement[TO_X, 0], placement[TO_X, 1], placement[TO_X, 2]
    yu, yv, yw = placement[TO_Y, 0], placement[TO_Y, 1], placement[TO_Y, 2]
    wu, wv, ww = placement[TO_W, 0], placement[TO_W, 1], placement[TO_W, 2]
    step = pitch * np.float32(0.125)
    # x = focal * right + width / 2 * forward with right orthogonal to forward: what forward adds is taken off.
    along = xu * wu + xv * wv + xw * ww
    focal = math.sqrt(xu * xu + xv * xv + xw * xw - along * along)
    drawn = 0
    for j in range(rows):
        cv = placement[ORIGIN, 1] + (np.float32(j) + _HALF) * pitch
        row_hash = (np.uint64((lattice_y + j) & 0xFFFFFFFF) * np.uint64(0x85EBCA77)) & np.uint64(0xFFFFFFFF)
        for i in range(columns):
            code = depth[j, i]
            if code == 0:
                continue
            cu = placement[ORIGIN, 0] + (np.float32(i) + _HALF) * pitch
            cw = placement[ORIGIN, 2] + np.float32(code) * step
            d = wu * cu + wv * cv + ww * cw
            if d <= near:
                continue
            if clip:
                px = placement[WORLD_X, 0] * cu + placement[WORLD_X, 1] * cv + placement[WORLD_X, 2] * cw
                py = placement[WORLD_Y, 0] * cu + placement[WORLD_Y, 1] * cv + placement[WORLD_Y, 2] * cw
                pz = placement[WORLD_Z, 0] * cu + placement[WORLD_Z, 1] * cv + placement[WORLD_Z, 2] * cw
                if (
                    px < placement[LOWER, 0] or px >= placement[UPPER, 0]
                    or py < placement[LOWER, 1] or py >= placement[UPPER, 1]
                    or pz < placement[LOWER, 2] or pz >= placement[UPPER, 2]
                ):  # fmt: skip
                    continue
            at = np.intp(normal[j, i, 0]) * 64 + np.intp(normal[j, i, 1])
            nu, nv, nw = DECODED[at, 0], DECODED[at, 1], -DECODED[at, 2]
            facing = nu * cu + nv * cv + nw * cw
            connected = flags[j, i] & 1 != 0
            if connected and facing >= _F0:
                continue
            # Of two views of the same surface the one that looks at it squarely shows more of it.
            front = d + pitch * (_F1 - abs(nw))
            inverse = _F1 / d
            sx = (xu * cu + xv * cv + xw * cw) * inverse
            sy = (yu * cu + yv * cv + yw * cw) * inverse
            if not (-_FAR < sx < _FAR and -_FAR < sy < _FAR):
                continue
            shrunk = _FOOTPRINT[coverage[j, i]]
            warped = shape >= WARPED_DISCS or (shape == BY_FLAG and connected)
            if warped:
                below = nw if abs(nw) >= _LEAST else -_LEAST
                a = min(max(-nu / below, -_SLOPE), _SLOPE)
                b = min(max(-nv / below, -_SLOPE), _SLOPE)
                scale = pitch * shrunk
                ud = scale * (wu + a * ww)
                vd = scale * (wv + b * ww)
                ux = (scale * (xu + a * xw) - sx * ud) * inverse
                uy = (scale * (yu + a * yw) - sy * ud) * inverse
                vx = (scale * (xv + b * xw) - sx * vd) * inverse
                vy = (scale * (yv + b * yw) - sy * vd) * inverse
            else:
                ux = vy = pitch * shrunk * focal * inverse * (_ROOT_HALF if shape == DISCS else _F1)
                uy = vx = ud = vd = _F0
                if ux > widest:
                    continue
            if shape == WARPED_DISCS:
                ux, uy, vx, vy = ux + vx, uy + vy, ux - vx, uy - vy
                ux = vy = _ROOT_HALF * math.sqrt(max(ux * ux + uy * uy, vx * vx + vy * vy))
                uy = vx = ud = vd = _F0
            determinant = ux * vy - vx * uy
            area = _HALF_PI * abs(determinant)
            ex = _ROOT_HALF * math.sqrt(ux * ux + vx * vx)
            ey = _ROOT_HALF * math.sqrt(uy * uy + vy * vy)
            if sx + ex < _F0 or sy + ey < _F0 or sx - ex > np.float32(width) or sy - ey > np.float32(height):
                continue
            # One splat of a cell that holds the eye would paint the whole frame.
            if area >= _F1 and np.float32(2.0) * max(ex, ey) > np.float32(height):
                continue
            drawn += 1

            mean = _LENGTH[length[j, i]]
            if connected:
                cosine = nu * placement[SUN, 0] + nv * placement[SUN, 1] + nw * placement[SUN, 2]
                light = _lambert(cosine, mean)
            else:
                light = _loose_light(nu, nv, nw, mean, cu, cv, cw, placement[SUN])
            byte = np.uint32(UNLIT_LIGHT) if flags[j, i] & 2 else np.uint32(light * _STEPS + _HALF)
            surface = np.uint32(
                np.uint32(color[j, i, 0]) | (np.uint32(color[j, i, 1]) << np.uint32(8))
                | (np.uint32(color[j, i, 2]) << np.uint32(16)) | (byte << np.uint32(24))
            )  # fmt: skip
            packed = np.uint32(0)
            if with_normals:
                turned = -_F1 if facing > _F0 else _F1
                packed = _pack_normal(placement, turned * nu, turned * nv, turned * nw)
            name = objects[j, i] if own_objects else np.uint32(0)

            x0 = math.floor(sx)
            y0 = math.floor(sy)
            if area < _F1:
                whole = abs(determinant) / (shrunk * shrunk)
                chance = _thin_chance(whole + whole if shape == DISCS else whole, coverage[j, i])
                if (
                    0 <= x0 < width and 0 <= y0 < height and front < frame_depth[y0, x0]
                    and np.float32(_lattice_hash(row_hash, (lattice_x + i) & 0xFFFFFFFF)) * _HASH_UNIT < chance
                ):  # fmt: skip
                    frame_depth[y0, x0] = front
                    frame_surface[y0, x0] = surface
                    if with_normals:
                        frame_normal[y0, x0] = packed
                    if with_objects:
                        frame_object[y0, x0] = name
                continue
            inverse_determinant = _F1 / determinant
            left = max(0, min(x0, math.ceil(sx - ex - _HALF)))
            right = min(width - 1, max(x0, math.floor(sx + ex - _HALF)))
            top = max(0, min(y0, math.ceil(sy - ey - _HALF)))
            bottom = min(height - 1, max(y0, math.floor(sy + ey - _HALF)))
            for y in range(top, bottom + 1):
                dy = np.float32(y) + _HALF - sy
                for x in range(left, right + 1):
                    dx = np.float32(x) + _HALF - sx
                    alpha = (vy * dx - vx * dy) * inverse_determinant
                    beta = (ux * dy - uy * dx) * inverse_determinant
                    outside = alpha * alpha + beta * beta > _HALF
                    if outside and (x != x0 or y != y0):
                        continue
                    z = front if outside else max(front + alpha * ud + beta * vd, _HALF * front)
                    if z < frame_depth[y, x]:
                        frame_depth[y, x] = z
                        frame_surface[y, x] = surface
                        if with_normals:
                            frame_normal[y, x] = packed
                        if with_objects:
                            frame_object[y, x] = name
    return drawn
