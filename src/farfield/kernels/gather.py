"""Lists of the child pixels under every parent pixel, the first half of compositing (OV 4.1).

Linked lists in order of arrival: what one layer adds lies together, so writing is sequential and reading follows a few
streams; a fixed number of places for every parent pixel was half as fast.
"""

from __future__ import annotations

import numpy as np
from numba import from_dtype, types

from farfield.kernels.compiling import kernel

CANDIDATE = np.dtype(
    [
        ("depth", np.int32),
        ("following", np.int32),
        ("objects", np.uint32),
        ("normal", np.uint16),
        ("r", np.uint8),
        ("g", np.uint8),
        ("b", np.uint8),
        ("length", np.uint8),
        ("coverage", np.uint8),
        ("unlit", np.uint8),
        ("column", np.uint8),
        ("cell", np.uint8),
        ("layer", np.uint8),
    ],
    align=True,
)
"""One child pixel: depth in child steps of the grid, normal = a * 64 + b, column = which of the 4 pixels of a block.
following: place of the next candidate of the same parent pixel, one that came before it; -1 = none."""

PLACE = np.dtype([("x", np.int64), ("y", np.int64), ("depth_base", np.int64), ("cell", np.int64), ("layer", np.int64)])
"""A child layer: lattice column and row of its first pixel *from the first child pixel of the band*; which it is."""

_U8 = types.Array(types.uint8, 2, "C", readonly=True)
_U8x3 = types.Array(types.uint8, 3, "C", readonly=True)
_U16 = types.Array(types.uint16, 2, "C", readonly=True)
_U32 = types.Array(types.uint32, 2, "C", readonly=True)
CANDIDATES = from_dtype(CANDIDATE)[::1]
HEADS = types.int32[:, ::1]


@kernel(
    types.int64(_U16, _U8x3, _U8x3, _U8, _U8, _U8, _U32, from_dtype(PLACE)[::1], CANDIDATES, types.int64, HEADS),
)  # fmt: skip
def gather(  # type: ignore[no-untyped-def]
    depth, color, normal, length, coverage, connected, objects, place, candidates, used, heads
):
    """Append the valid pixels of one child layer to the candidates of a band of parent pixels; returns the new `used`.

    depth .. connected: arrays of an OrthoLayer, (h, w); objects may be (0, 0). place: (1,) PLACE.
    candidates: (capacity,) CANDIDATE, `used` of them taken, with room for all pixels of the layer that are in the band.
    heads: (rows, columns) int32: the candidate that came last for each parent pixel, -1 = none; changed.
    """
    x0 = place[0].x
    y0 = place[0].y
    cell = place[0].cell
    layer = place[0].layer
    base = place[0].depth_base
    keeps = objects.size > 0
    for y in range(max(0, -y0), min(depth.shape[0], 2 * heads.shape[0] - y0)):
        j = (y0 + y) >> 1
        row_bit = ((y0 + y) & 1) << 1
        for x in range(depth.shape[1]):
            if depth[y, x] == 0:
                continue
            i = (x0 + x) >> 1
            c = candidates[used]
            c.depth = base + depth[y, x]
            c.following = heads[j, i]
            heads[j, i] = used
            used += 1
            c.objects = objects[y, x] if keeps else 0
            c.normal = (types.uint16(normal[y, x, 0]) << 6) | normal[y, x, 1]
            c.r = color[y, x, 0]
            c.g = color[y, x, 1]
            c.b = color[y, x, 2]
            c.length = length[y, x]
            c.coverage = coverage[y, x]
            c.unlit = (connected[y, x] >> 1) & 1
            c.column = row_bit | ((x0 + x) & 1)
            c.cell = cell
            c.layer = layer
    return used
