"""Between images and valid order, row by row over the pixels with a surface (spec/orthoview.md, Planes)."""

from __future__ import annotations

from numba import types

from farfield.kernels.compiling import kernel

_MASK = types.Array(types.boolean, 2, "C", readonly=True)
_DEPTH = types.Array(types.uint16, 1, "C", readonly=True)
_PLACES = types.Array(types.int32, 2, "C", readonly=True)
_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_IMAGE = types.uint8[:, ::1]

FAR = 32
"""Depth steps, 4 pitches: neighbours farther apart are taken for different surfaces."""


@kernel(types.int64(_MASK, types.int32[:, ::1]))
def list_neighbours(mask, places):  # type: ignore[no-untyped-def]
    """Neighbours west, north, north-west and north-east of each valid pixel; returns how many pixels there are.

    mask: (h, w) bool. places: (valid, 4) int32, written: numbers in valid order, -1 where nothing is.
    """
    rows, columns = mask.shape
    n = 0
    for y in range(rows):
        above = n  # The pixels of the row before end here; `north` walks over them beside x.
        if y > 0:
            for x in range(columns):
                above -= mask[y - 1, x]
        north = above
        for x in range(columns):
            over = y > 0 and mask[y - 1, x]
            if mask[y, x]:
                west = x > 0 and mask[y, x - 1]
                corner = x > 0 and y > 0 and mask[y - 1, x - 1]
                east = y > 0 and x + 1 < columns and mask[y - 1, x + 1]
                places[n, 0] = n - 1 if west else -1
                places[n, 1] = north if over else -1
                places[n, 2] = north - 1 if corner else -1
                places[n, 3] = north + over if east else -1
                n += 1
            north += over
    return n


@kernel(types.void(_DEPTH, _PLACES, types.uint8[::1], types.uint8[::1]))
def count_near(depth, places, beside, around):  # type: ignore[no-untyped-def]
    """How many of the four and of the eight neighbours of each pixel hide nothing behind it and lie near it.

    depth: (valid,) uint16, all at least 1. places: of list_neighbours. beside: (valid,) uint8, all 0, written: of the
    four, those at most FAR steps farther away (nearer ones count). around: the same of the eight, less than FAR
    steps nearer or farther.
    """
    for k in range(len(depth)):
        here = types.int32(depth[k])
        for side in range(4):
            other = places[k, side]
            if other < 0:
                continue
            step = types.int32(depth[other]) - here
            if abs(step) < FAR:
                around[k] += 1
                around[other] += 1
            if side < 2:
                beside[k] += step <= FAR
                beside[other] += -step <= FAR


@kernel(types.void(_MASK, _BYTES, _BYTES, _IMAGE, _IMAGE, _IMAGE, types.uint8[:, :, ::1]))
def place(mask, codes, flags, coverage, length, connected, color):  # type: ignore[no-untyped-def]
    """Puts what a tile says of valid pixels into images, and clears their colour elsewhere.

    mask: (h, w) bool. codes: (valid,) uint8 coverage and length as in the format. flags: (valid,) uint8. coverage,
    length, connected: (h, w) uint8, written: 0, 8 and 0 where nothing is. color: (h, w, 3) uint8, changed.
    """
    n = 0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                coverage[y, x] = (codes[n] >> 3) + 1
                length[y, x] = (codes[n] & 7) + 1
                connected[y, x] = flags[n]
                n += 1
            else:
                coverage[y, x] = 0
                length[y, x] = 8
                connected[y, x] = 0
                for c in range(3):
                    color[y, x, c] = 0
