"""Rays through a BlockMap (BLK 3.2): the twin of viewer/src/three/shaders/blockmap.frag.glsl, pixel by pixel.

A ray goes from texel to texel, and leaps where its distances tell that nothing is as high as it for some way. In a
texel it meets the top, a plane, or has met the side that it came in by.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.leaps import LEAPS
from farfield.kernels.splat import LIGHT_STEPS
from farfield.kernels.surface import F32_1, F32_2, F32_3, F64_1, F64_2, U8_3, U32_2

IN_AIR = -1
"""In place of the side by which a ray came into a texel: it was there already, above the top."""
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_LIGHT = np.float32(LIGHT_STEPS)
_FAR = 3.0e38
_CLOSE = 1e-6
"""Texels, by which a ray is taken beyond a wall of texels to tell which one it is in."""


@device
def _exit(position, direction, low, high):  # type: ignore[no-untyped-def]
    """Where a ray leaves a range of texels, in units of the ray."""
    if direction > 0.0:
        return (high - position) / direction
    if direction < 0.0:
        return (low - position) / direction
    return _FAR


@device
def _onward(texel, position, direction):  # type: ignore[no-untyped-def]
    """The texel of a position, not behind that in which the ray was: rounding at corners would lead it to and fro."""
    found = np.int64(math.floor(position))
    return max(texel, found) if direction > 0.0 else min(texel, found)


@device
def _ten(component):  # type: ignore[no-untyped-def]
    return np.uint32((min(max(component, -_ONE), _ONE) + _ONE) * np.float32(511.0) + _HALF)


@kernel(
    types.int64(
        F32_2, F32_2, F32_3, U8_3, F32_1, types.int32[:, :, :, ::1], F32_3, U8_3, U32_2,
        F64_2, F64_2, F64_1, F32_1, types.int64, types.int64, types.int64, types.boolean,
        types.float64, types.float64, F32_2, U32_2, U32_2, U32_2,
    )
)  # fmt: skip
def cast_rays(  # type: ignore[no-untyped-def]
    heights, floors, slopes, distances, thresholds, places, azimuths, colors, objects,
    box, to_ray, eye_texels, sun, x0, y0, across, by_area,
    lowest, highest, frame_depth, frame_surface, frame_normal, frame_object,
):  # fmt: skip
    """Draws a BlockMap into a frame; returns how many samples it is seen in.

    heights: (n, n) metres in the middle of texels, from the cell's lower corner; NaN = nothing. floors: (n, n) metres
    down to which what stands there goes. slopes: (n, n, 4)
    metres that the top rises from side to side of a texel along x and y, and for each metre. distances: (LEAPS, n, n),
    thresholds: (LEAPS,) of kernels.leaps. places: (n, n, 4, 3) of Unfolded.
    azimuths: (n, n, 4) radians; colors: (n, n + m, 3) sRGB; objects: (n, n) or (0, 0).
    box: (2, 3) texels along x and y and metres up from the cell's lower corner, to which rays are cut.
    to_ray: (3, 3) from samples (x, y, 1) to the ray's direction, texels along x and y and metres up, 1 along the view
    axis. eye_texels: (3,) the eye in these. sun: (3,). x0, y0: first sample of the frame's part, which frame_* are.
    across: columns of a wall. by_area: see BlockMap. lowest, highest: metres, ends of the range of codes.
    """
    n = heights.shape[0]
    height, width = frame_depth.shape
    with_normals = frame_normal.size > 0
    with_objects = frame_object.size > 0
    ex, ey, ez = eye_texels[0], eye_texels[1], eye_texels[2]
    drawn = 0
    for sample_y in range(height):
        for sample_x in range(width):
            sx = sample_x + x0 + 0.5
            sy = sample_y + y0 + 0.5
            dx = to_ray[0, 0] * sx + to_ray[0, 1] * sy + to_ray[0, 2]
            dy = to_ray[1, 0] * sx + to_ray[1, 1] * sy + to_ray[1, 2]
            dz = to_ray[2, 0] * sx + to_ray[2, 1] * sy + to_ray[2, 2]
            # Into the box.
            enter = 0.0
            leave = np.float64(frame_depth[sample_y, sample_x])
            side = IN_AIR
            ax = _exit(ex, -dx, box[0, 0], box[1, 0])
            bx = _exit(ex, dx, box[0, 0], box[1, 0])
            ay = _exit(ey, -dy, box[0, 1], box[1, 1])
            by = _exit(ey, dy, box[0, 1], box[1, 1])
            az = _exit(ez, -dz, box[0, 2], box[1, 2])
            bz = _exit(ez, dz, box[0, 2], box[1, 2])
            if dx == 0.0:
                if ex < box[0, 0] or ex >= box[1, 0]:
                    continue
            else:
                if -ax > enter:
                    enter = -ax
                    side = 0 if dx > 0.0 else 1
                leave = min(leave, bx)
            if dy == 0.0:
                if ey < box[0, 1] or ey >= box[1, 1]:
                    continue
            else:
                if -ay > enter:
                    enter = -ay
                    side = 2 if dy > 0.0 else 3
                leave = min(leave, by)
            below = False
            if dz == 0.0:
                if ez < box[0, 2] or ez > box[1, 2]:
                    continue
            else:
                if -az > enter:
                    enter = -az
                    side = IN_AIR
                    below = dz > 0.0
                leave = min(leave, bz)
            if enter >= leave:
                continue
            t = enter
            i = min(max(np.int64(math.floor(ex + t * dx + (_CLOSE if dx > 0.0 else -_CLOSE))), 0), n - 1)
            j = min(max(np.int64(math.floor(ey + t * dy + (_CLOSE if dy > 0.0 else -_CLOSE))), 0), n - 1)
            hit = 0
            for _ in range(4 * n):
                out_x = _exit(ex, dx, np.float64(i), i + 1.0)
                out_y = _exit(ey, dy, np.float64(j), j + 1.0)
                out = min(min(out_x, out_y), leave)
                z = ez + t * dz
                top = np.float64(heights[j, i])
                if top == top:
                    gx, gy = np.float64(slopes[j, i, 0]), np.float64(slopes[j, i, 1])
                    above = z - top - gx * (ex + t * dx - i - 0.5) - gy * (ey + t * dy - j - 0.5)
                    then = ez + out * dz - top - gx * (ex + out * dx - i - 0.5) - gy * (ey + out * dy - j - 0.5)
                    floor = np.float64(floors[j, i])
                    if above < 0.0 and z < floor:
                        # Below what stands there, and perhaps on the way up to it.
                        if ez + out * dz > floor:
                            t = (floor - ez) / dz
                            hit = 2
                            break
                    elif above < 0.0:
                        if side != IN_AIR or below:
                            hit = 1
                            break
                        if t > 0.0:
                            # It was in the air: by as little as it takes to tell, it is beyond the top.
                            hit = 2
                            break
                    elif then < 0.0:
                        t += (out - t) * above / (above - then)
                        hit = 2
                        break
                if out >= leave:
                    break
                below = False
                # As far as nothing is as high as the ray.
                best = out
                best_x, best_y, up_to = out_x, out_y, 0
                for k in range(LEAPS):
                    reach = np.int64(distances[k, j, i])
                    if reach < 2 or z < thresholds[k]:
                        continue
                    lx = _exit(ex, dx, i - reach + 1.0, np.float64(i + reach))
                    ly = _exit(ey, dy, j - reach + 1.0, np.float64(j + reach))
                    far = min(lx, ly)
                    limited = 0
                    if dz < 0.0:
                        down = (thresholds[k] - ez) / dz
                        if down < far:
                            far = down
                            limited = 1
                    if far > best:
                        best = far
                        best_x, best_y, up_to = lx, ly, limited
                if best >= leave:
                    break
                t = best
                if up_to:
                    i = min(max(_onward(i, ex + t * dx, dx), 0), n - 1)
                    j = min(max(_onward(j, ey + t * dy, dy), 0), n - 1)
                    side = IN_AIR
                elif best_x <= best_y:
                    i = np.int64(math.floor(ex + t * dx + 0.5)) - (0 if dx > 0.0 else 1)
                    j = _onward(j, ey + t * dy, dy)
                    side = 0 if dx > 0.0 else 1
                else:
                    i = _onward(i, ex + t * dx, dx)
                    j = np.int64(math.floor(ey + t * dy + 0.5)) - (0 if dy > 0.0 else 1)
                    side = 2 if dy > 0.0 else 3
                if i < 0 or j < 0 or i >= n or j >= n:
                    break
            if hit == 0 or t >= np.float64(frame_depth[sample_y, sample_x]):
                continue
            drawn += 1
            row, column = j, i
            nx = -slopes[j, i, 2]
            ny = -slopes[j, i, 3]
            nz = _ONE
            if hit == 1 and side != IN_AIR and places[j, i, side, 2] > 0:
                rows = np.int64(places[j, i, side, 2])
                z = ez + t * dz
                upper, lower = np.float64(heights[j, i]), lowest
                if by_area:
                    x, y = i, j
                    if side == 0:
                        x -= 1
                    elif side == 1:
                        x += 1
                    elif side == 2:
                        y -= 1
                    else:
                        y += 1
                    if x >= 0 and y >= 0 and x < n and y < n and heights[y, x] == heights[y, x]:
                        lower = np.float64(heights[y, x])
                    lower = max(lower, np.float64(floors[j, i]))
                else:
                    upper = highest
                along = ey + t * dy - j if side < 2 else ex + t * dx - i
                down = (upper - z) / max(upper - lower, 1e-9)
                row = np.int64(places[j, i, side, 1]) + min(max(np.int64(math.floor(down * rows)), 0), rows - 1)
                within = min(max(np.int64(math.floor(along * across)), 0), across - 1)
                column = n + np.int64(places[j, i, side, 0]) + within
                nx = np.float32(math.cos(azimuths[j, i, side]))
                ny = np.float32(math.sin(azimuths[j, i, side]))
                nz = _ZERO
            scale = _ONE / math.sqrt(nx * nx + ny * ny + nz * nz)
            cosine = (nx * sun[0] + ny * sun[1] + nz * sun[2]) * scale
            shown = np.uint32(min(max(cosine, _ZERO), _ONE) * _LIGHT + _HALF)
            packed = np.uint32(shown << np.uint32(24)) | (np.uint32(colors[row, column, 2]) << np.uint32(16))
            packed |= (np.uint32(colors[row, column, 1]) << np.uint32(8)) | np.uint32(colors[row, column, 0])
            frame_surface[sample_y, sample_x] = packed
            frame_depth[sample_y, sample_x] = np.float32(t)
            if with_normals:
                frame_normal[sample_y, sample_x] = (
                    _ten(nx * scale) | (_ten(ny * scale) << np.uint32(10)) | (_ten(nz * scale) << np.uint32(20))
                )
            if with_objects:
                frame_object[sample_y, sample_x] = objects[j, i] if objects.size > 0 else np.uint32(0)
    return drawn
