"""Prediction residuals of depth and normals over valid pixels.

The median edge detector of LOCO-I (Weinberger, Seroussi, Sapiro 2000), restricted to pixels with a surface: an
empty neighbour would put a jump of thousands of steps into every silhouette. spec/orthoview.md, Planes.
"""

from __future__ import annotations

from numba import njit, types

_MASK = types.Array(types.uint8, 2, "C", readonly=True)
_DEPTH = types.Array(types.uint16, 2, "C", readonly=True)
_NORMAL = types.Array(types.uint8, 3, "C", readonly=True)
_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_OUT = types.uint8[::1]

FIRST_DEPTH = 0
"""What the first valid depth is predicted from when it has no neighbour."""
FIRST_NORMAL = 32
"""The same for normals: nearly the middle of 0..63, the normal that faces the camera."""


@njit(inline="always")
def _predict(west, north, a, b, d, has_d, last):  # type: ignore[no-untyped-def]
    """Prediction from west a, north b, north-west d and the previous value in valid order."""
    if west and north:
        if has_d:
            low = min(a, b)
            high = max(a, b)
            if d >= high:
                return low
            if d <= low:
                return high
            return a + b - d
        return (a + b) >> 1
    if west:
        return a
    if north:
        return b
    return last


@njit(types.int64(_DEPTH, _OUT, _OUT), cache=True, nogil=True, boundscheck=False)
def depth_residuals(depth, high, low):  # type: ignore[no-untyped-def]
    """Residuals of valid depths, zigzag, split into their bytes; returns how many.

    depth: (h, w) uint16, 0 = nothing there. high, low: (valid,) uint8, written in valid order.
    """
    rows, columns = depth.shape
    n = 0
    last = FIRST_DEPTH
    for y in range(rows):
        for x in range(columns):
            value = types.int32(depth[y, x])
            if value == 0:
                continue
            a = types.int32(depth[y, x - 1]) if x > 0 else types.int32(0)
            b = types.int32(depth[y - 1, x]) if y > 0 else types.int32(0)
            d = types.int32(depth[y - 1, x - 1]) if x > 0 and y > 0 else types.int32(0)
            r = value - _predict(a > 0, b > 0, a, b, d, d > 0, last)
            r = ((r + 32768) & 65535) - 32768
            z = 2 * r if r >= 0 else -2 * r - 1
            high[n] = z >> 8
            low[n] = z & 255
            last = value
            n += 1
    return n


@njit(types.int64(_MASK, _BYTES, _BYTES, types.uint16[:, ::1]), cache=True, nogil=True, boundscheck=False)
def restore_depth(mask, high, low, depth):  # type: ignore[no-untyped-def]
    """Undo depth_residuals; returns how many valid depths came out as 0, which no writer makes.

    mask: (h, w) uint8, 1 = valid. high, low: (valid,) uint8. depth: (h, w) uint16, all zero, written.
    """
    rows, columns = mask.shape
    n = 0
    zeros = 0
    last = FIRST_DEPTH
    for y in range(rows):
        for x in range(columns):
            if mask[y, x] == 0:
                continue
            a = types.int32(depth[y, x - 1]) if x > 0 else types.int32(0)
            b = types.int32(depth[y - 1, x]) if y > 0 else types.int32(0)
            d = types.int32(depth[y - 1, x - 1]) if x > 0 and y > 0 else types.int32(0)
            z = (types.int32(high[n]) << 8) | types.int32(low[n])
            r = z >> 1 if z & 1 == 0 else -(z >> 1) - 1
            value = (r + _predict(a > 0, b > 0, a, b, d, d > 0, last)) & 65535
            if value == 0:
                zeros += 1
            depth[y, x] = value
            last = value
            n += 1
    return zeros


@njit(types.int64(_DEPTH, _NORMAL, _OUT, _OUT), cache=True, nogil=True, boundscheck=False)
def normal_residuals(depth, normal, first, second):  # type: ignore[no-untyped-def]
    """Residuals of both normal coordinates modulo 64, in valid order; returns how many.

    depth: (h, w) uint16, 0 = nothing there. normal: (h, w, 2) uint8, 0..63. first, second: (valid,) uint8, written.
    """
    rows, columns = depth.shape
    n = 0
    last0 = FIRST_NORMAL
    last1 = FIRST_NORMAL
    for y in range(rows):
        for x in range(columns):
            if depth[y, x] == 0:
                continue
            west = x > 0 and depth[y, x - 1] > 0
            north = y > 0 and depth[y - 1, x] > 0
            corner = x > 0 and y > 0 and depth[y - 1, x - 1] > 0
            wx = x - 1 if west else x
            ny = y - 1 if north else y
            dx, dy = (x - 1, y - 1) if corner else (x, y)
            v0 = types.int32(normal[y, x, 0])
            v1 = types.int32(normal[y, x, 1])
            p0 = _predict(
                west, north, types.int32(normal[y, wx, 0]), types.int32(normal[ny, x, 0]),
                types.int32(normal[dy, dx, 0]), corner, last0,
            )  # fmt: skip
            p1 = _predict(
                west, north, types.int32(normal[y, wx, 1]), types.int32(normal[ny, x, 1]),
                types.int32(normal[dy, dx, 1]), corner, last1,
            )  # fmt: skip
            first[n] = (v0 - p0) & 63
            second[n] = (v1 - p1) & 63
            last0 = v0
            last1 = v1
            n += 1
    return n


@njit(types.int64(_DEPTH, _BYTES, _BYTES, types.uint8[:, :, ::1]), cache=True, nogil=True, boundscheck=False)
def restore_normals(depth, first, second, normal):  # type: ignore[no-untyped-def]
    """Undo normal_residuals; returns how many.

    depth: (h, w) uint16, 0 = nothing there. first, second: (valid,) uint8. normal: (h, w, 2) uint8, written.
    """
    rows, columns = depth.shape
    n = 0
    last0 = FIRST_NORMAL
    last1 = FIRST_NORMAL
    for y in range(rows):
        for x in range(columns):
            if depth[y, x] == 0:
                continue
            west = x > 0 and depth[y, x - 1] > 0
            north = y > 0 and depth[y - 1, x] > 0
            corner = x > 0 and y > 0 and depth[y - 1, x - 1] > 0
            wx = x - 1 if west else x
            ny = y - 1 if north else y
            dx, dy = (x - 1, y - 1) if corner else (x, y)
            p0 = _predict(
                west, north, types.int32(normal[y, wx, 0]), types.int32(normal[ny, x, 0]),
                types.int32(normal[dy, dx, 0]), corner, last0,
            )  # fmt: skip
            p1 = _predict(
                west, north, types.int32(normal[y, wx, 1]), types.int32(normal[ny, x, 1]),
                types.int32(normal[dy, dx, 1]), corner, last1,
            )  # fmt: skip
            last0 = (types.int32(first[n]) + p0) & 63
            last1 = (types.int32(second[n]) + p1) & 63
            normal[y, x, 0] = last0
            normal[y, x, 1] = last1
            n += 1
    return n
