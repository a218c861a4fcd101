"""Exact partition of triangles among the cells of a grid.

Where a vertex lies is decided in fixed point, 2^16 steps a leaf edge, so that every decision about it is the same in
every triangle and for every cell; its position itself stays as it is. Cells are half-open: what lies on a cell plane
belongs to the upper cell, a face in the plane as a whole. Cuts are computed from the ends of an edge in the order of
their coordinates and get the coordinate of the plane exactly, so two triangles that share an edge are cut at the same
points and no crack opens. A triangle is cut along x, each slab along y, each bar along z.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F64_2, F64_3, I32_1, I32_2, I64_1, U32_2

STEPS = 65536
"""Fixed-point steps along a leaf edge; a power of two."""
SHIFT = 16
CORNERS = 10
"""Most corners of a triangle cut by six planes, and one to spare."""


@device
def fixed(value, scale):  # type: ignore[no-untyped-def]
    """Metres from the grid's corner -> int64 steps, rounded to nearest; scale = STEPS / leaf size."""
    return np.int64(math.floor(value * scale + 0.5))


@device
def _cell_range(polygon, count, axis, scale, first, last):  # type: ignore[no-untyped-def]
    """Cells (inclusive) that a polygon reaches along an axis, within first..last."""
    low = fixed(polygon[0, axis], scale)
    high = low
    for i in range(1, count):
        step = fixed(polygon[i, axis], scale)
        low = min(low, step)
        high = max(high, step)
    upper = (high - 1) >> SHIFT if high > low else low >> SHIFT
    return max(low >> SHIFT, first), min(upper, last)


@device
def _before(polygon, i, j):  # type: ignore[no-untyped-def]
    for axis in range(3):
        if polygon[i, axis] != polygon[j, axis]:
            return polygon[i, axis] < polygon[j, axis]
    return True


@device
def _cut(source, count, axis, plane, side, leaf_size, scale, target):  # type: ignore[no-untyped-def]
    """Keeps the part of a polygon above (side 1) or below (side -1) a cell plane; returns its number of corners.

    Rows of source and target: position (3), weights of the triangle's corners (3). A polygon that only touches the
    plane is kept whole or not at all; one that lies in the plane is above it.
    """
    level = plane * STEPS
    beyond = False
    flat = True
    for i in range(count):
        offset = side * (fixed(source[i, axis], scale) - level)
        beyond = beyond or offset > 0
        flat = flat and offset == 0
    if not beyond and not (flat and side == 1):
        return 0
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = side * (fixed(source[i, axis], scale) - level)
        there = side * (fixed(source[j, axis], scale) - level)
        if here >= 0:
            for k in range(6):
                target[kept, k] = source[i, k]
            kept += 1
        if (here < 0 and there > 0) or (here > 0 and there < 0):
            a = i if _before(source, i, j) else j
            b = j if a == i else i
            height = plane * leaf_size
            t = (height - source[a, axis]) / (source[b, axis] - source[a, axis])
            for k in range(6):
                target[kept, k] = source[a, k] + t * (source[b, k] - source[a, k])
            target[kept, axis] = height
            kept += 1
    return kept


@device
def _slab(source, count, axis, cell, leaf_size, scale, between, target):  # type: ignore[no-untyped-def]
    """The part of a polygon in one cell's range along an axis."""
    count = _cut(source, count, axis, cell, 1, leaf_size, scale, between)
    if count < 3:
        return 0
    return _cut(between, count, axis, cell + 1, -1, leaf_size, scale, target)


@device
def _has_area(p, i, j):  # type: ignore[no-untyped-def]
    ux, uy, uz = p[i, 0] - p[0, 0], p[i, 1] - p[0, 1], p[i, 2] - p[0, 2]
    vx, vy, vz = p[j, 0] - p[0, 0], p[j, 1] - p[0, 1], p[j, 2] - p[0, 2]
    return uy * vz != uz * vy or uz * vx != ux * vz or ux * vy != uy * vx


@device
def _contained(triangle, scale):  # type: ignore[no-untyped-def]
    """Whether a triangle lies in one cell."""
    huge = np.int64(1) << 40
    for axis in range(3):
        low, high = _cell_range(triangle, 3, axis, scale, -huge, huge)
        if low != high:
            return False
    return True


@kernel(
    types.UniTuple(types.int64, 2)(F64_2, U32_2, types.float64, I64_1, I64_1, I32_1, I32_2, I32_1, F64_3, F64_3),
    allocates=True,
)
def clip(  # type: ignore[no-untyped-def]
    positions, triangles, leaf_size, first, last, source, cell, piece, piece_positions, piece_weights
):
    """Lists which triangles, whole or cut to pieces, lie in which of the cells first..last (inclusive).

    positions: (n, 3) float64 metres from the grid's corner. triangles: (m, 3) uint32.
    first, last: (3,) int64 leaf indices.
    source: (e,) int32 out: triangle of each entry, ascending. cell: (e, 3) int32 out: its cell.
    piece: (e,) int32 out: number of the piece, or -1: the triangle lies in the cell whole.
    piece_positions: (p, 3, 3) float64 out: corners. piece_weights: (p, 3, 3) float64 out: weights of the triangle's
        corners in each. Both keep the winding.
    Returns (entries, pieces) needed; when either exceeds e or p, call again with larger arrays.
    Triangles with a coordinate that is not finite, and pieces without area, are left out.
    """
    scale = STEPS / leaf_size
    whole = np.zeros((CORNERS, 6))
    between = np.empty((CORNERS, 6))
    slab = np.empty((CORNERS, 6))
    bar = np.empty((CORNERS, 6))
    block = np.empty((CORNERS, 6))
    for k in range(3):
        whole[k, 3 + k] = 1.0
    entries = 0
    pieces = 0
    for t in range(triangles.shape[0]):
        total = 0.0
        for k in range(3):
            for axis in range(3):
                whole[k, axis] = positions[np.uintp(triangles[t, k]), axis]
                total += whole[k, axis]
        if not math.isfinite(total):
            continue
        x0, x1 = _cell_range(whole, 3, 0, scale, first[0], last[0])
        if x0 > x1:
            continue
        y0, y1 = _cell_range(whole, 3, 1, scale, first[1], last[1])
        if y0 > y1:
            continue
        z0, z1 = _cell_range(whole, 3, 2, scale, first[2], last[2])
        if z0 > z1:
            continue
        if _contained(whole, scale):
            if entries < source.shape[0]:
                source[entries] = t
                cell[entries, 0] = x0
                cell[entries, 1] = y0
                cell[entries, 2] = z0
                piece[entries] = -1
            entries += 1
            continue
        for x in range(x0, x1 + 1):
            in_slab = _slab(whole, 3, 0, x, leaf_size, scale, between, slab)
            if in_slab < 3:
                continue
            y0, y1 = _cell_range(slab, in_slab, 1, scale, first[1], last[1])
            for y in range(y0, y1 + 1):
                in_bar = _slab(slab, in_slab, 1, y, leaf_size, scale, between, bar)
                if in_bar < 3:
                    continue
                z0, z1 = _cell_range(bar, in_bar, 2, scale, first[2], last[2])
                for z in range(z0, z1 + 1):
                    corners = _slab(bar, in_bar, 2, z, leaf_size, scale, between, block)
                    for k in range(1, corners - 1):
                        if not _has_area(block, k, k + 1):
                            continue
                        if entries < source.shape[0] and pieces < piece_positions.shape[0]:
                            source[entries] = t
                            cell[entries, 0] = x
                            cell[entries, 1] = y
                            cell[entries, 2] = z
                            piece[entries] = pieces
                            for corner in range(3):
                                i = 0 if corner == 0 else k + corner - 1
                                for axis in range(3):
                                    piece_positions[pieces, corner, axis] = block[i, axis]
                                    piece_weights[pieces, corner, axis] = block[i, 3 + axis]
                        entries += 1
                        pieces += 1
    return entries, pieces
