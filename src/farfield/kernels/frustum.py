"""Triangles cut at the near plane and at a guard band around the picture, before the division by depth.

Behind the near plane nothing projects; far outside the picture single precision no longer tells positions on the
screen apart. Most triangles need no cut and are passed on as they are.
"""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F64_2, F64_3, I32_1, U32_2

CORNERS = 9
"""Most corners of a triangle cut by five planes, and one to spare."""


@device
def _height(plane, x, y, w, near, low_x, high_x, low_y, high_y):  # type: ignore[no-untyped-def]
    """Positive inside: 0 near plane, 1 to 4 left, right, upper and lower edge of a rectangle of the screen."""
    if plane == 0:
        return w - near
    if plane == 1:
        return x - low_x * w
    if plane == 2:
        return high_x * w - x
    if plane == 3:
        return y - low_y * w
    return high_y * w - y


@device
def _before(p, i, j):  # type: ignore[no-untyped-def]
    for k in range(3):
        if p[i, k] != p[j, k]:
            return p[i, k] < p[j, k]
    return True


@kernel(
    types.UniTuple(types.int64, 2)(
        F64_2, U32_2, types.float64, types.float64, types.float64, I32_1, I32_1, F64_3, F64_3
    ),
    allocates=True,
)
def cut_to_frustum(  # type: ignore[no-untyped-def]
    clip, triangles, near, width, height, whole, source, piece_clip, piece_weights
):
    """Sorts triangles into those to draw as they are, those to draw in pieces and those not to be seen.

    clip: (n, 3) float64 rows (x w, y w, w), x and y in samples. triangles: (m, 3) uint32. near: least w, metres.
    width, height: of the picture in samples; the guard band is as wide again on each side.
    whole: (m,) int32 out: triangles to draw whole. source: (p,) int32 out: triangle of each piece.
    piece_clip, piece_weights: (p, 3, 3) float64 out: corners of the pieces like clip, and the weights of the triangle's
        corners in them; cuts of a shared edge are the same from both sides.
    Returns the number of whole triangles and of pieces needed; when the latter exceeds p, call again with more room.
    """
    polygon = np.zeros((CORNERS, 6))
    other = np.zeros((CORNERS, 6))
    kept = 0
    pieces = 0
    for t in range(triangles.shape[0]):
        outside = 31
        crosses = 0
        for k in range(3):
            i = np.uintp(triangles[t, k])
            x, y, w = clip[i, 0], clip[i, 1], clip[i, 2]
            for plane in range(5):
                if not _height(plane, x, y, w, near, 0.0, width, 0.0, height) < 0.0:
                    outside &= ~(1 << plane)
                if not _height(plane, x, y, w, near, -width, 2 * width, -height, 2 * height) >= 0.0:
                    crosses |= 1 << plane
        if outside:
            continue
        if not crosses:
            whole[kept] = t
            kept += 1
            continue
        for k in range(3):
            for axis in range(3):
                polygon[k, axis] = clip[np.uintp(triangles[t, k]), axis]
                polygon[k, 3 + axis] = 1.0 if k == axis else 0.0
        count = 3
        for plane in range(5):
            if not crosses & (1 << plane):
                continue
            found = 0
            for i in range(count):
                j = i + 1 if i + 1 < count else 0
                p, q = polygon[i], polygon[j]
                here = _height(plane, p[0], p[1], p[2], near, -width, 2 * width, -height, 2 * height)
                there = _height(plane, q[0], q[1], q[2], near, -width, 2 * width, -height, 2 * height)
                if here >= 0.0:
                    for k in range(6):
                        other[found, k] = polygon[i, k]
                    found += 1
                if (here >= 0.0) != (there >= 0.0):
                    forward = _before(polygon, i, j)
                    a, b = (i, j) if forward else (j, i)
                    share = here / (here - there) if forward else there / (there - here)
                    for k in range(6):
                        other[found, k] = polygon[a, k] + share * (polygon[b, k] - polygon[a, k])
                    if plane == 0:
                        other[found, 2] = near
                    found += 1
            polygon, other = other, polygon
            count = found
            if count < 3:
                break
        for k in range(1, count - 1):
            if pieces < source.shape[0]:
                source[pieces] = t
                for corner in range(3):
                    i = 0 if corner == 0 else k + corner - 1
                    for axis in range(3):
                        piece_clip[pieces, corner, axis] = polygon[i, axis]
                        piece_weights[pieces, corner, axis] = polygon[i, 3 + axis]
            pieces += 1
    return kept, pieces
