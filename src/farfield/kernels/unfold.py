"""The walls of a BlockMap unfolded: which sides of its texels are walls, in the order in which one walks along them,
and where in the image of walls each has its place (BLK 3.1, 3.3).

Integers throughout: a reader finds the same order and the same places from the heights alone, so neither is stored.
"""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import I32_1, U8_2

WEST, EAST, SOUTH, NORTH = 0, 1, 2, 3
"""Sides of a texel, in the order in which they are numbered: side 4 (n j + i) + k of texel (i, j)."""
ROWS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64], np.int32)
"""How many rows of the image of walls a side may have."""

# Walking with the building on the left: along the south side eastwards, the east northwards, and so on.
_ALONG_X = np.array([0, 0, 1, -1], np.int64)
_ALONG_Y = np.array([-1, 1, 0, 0], np.int64)
_OUT_X = np.array([-1, 1, 0, 0], np.int64)
_OUT_Y = np.array([0, 0, -1, 1], np.int64)
_LEFT = np.array([SOUTH, NORTH, EAST, WEST], np.int64)
"""The next side of the same texel."""
_RIGHT = np.array([NORTH, SOUTH, WEST, EAST], np.int64)
"""The side of the texel diagonally ahead, where the wall turns inwards."""


@device
def drop_of(codes, floors, border, least, i, j, k):  # type: ignore[no-untyped-def]
    """How many steps of height a side of texel (i, j) goes down; 0: it is no wall."""
    n = codes.shape[0]
    code = types.int64(codes[j, i])
    if code == 0:
        return types.int64(0)
    base = max(types.int64(floors[j, i]), 1)
    x = i + _OUT_X[k]
    y = j + _OUT_Y[k]
    if x < 0 or y < 0 or x >= n or y >= n:
        along = j if k < SOUTH else i
        return max(code - base, 1) if border[k, along] else types.int64(0)
    other = types.int64(codes[y, x])
    drop = code - max(other, base)
    if other == 0 and drop < 1:
        drop = types.int64(1)
    return drop if drop >= least or (other == 0 and code > base) else types.int64(0)


@device
def _is_open(codes, floors, border, least, taken, i, j, k):  # type: ignore[no-untyped-def]
    n = codes.shape[0]
    if i < 0 or j < 0 or i >= n or j >= n or taken[4 * (n * j + i) + k] != 0:
        return False
    return drop_of(codes, floors, border, least, i, j, k) > 0


@kernel(types.int64(U8_2, U8_2, U8_2, types.int64, I32_1, I32_1))
def trace_walls(codes, floors, border, least, taken, order):  # type: ignore[no-untyped-def]
    """Lists the sides that are walls, those of a wall in a row; returns how many there are.

    codes: (n, n) heights by row (y) and column (x), 0 = nothing. floors: (n, n) where bodies end below, 0 = at code 1.
    border: (4, n) which sides on the rim of the map are
    walls. least: steps of height that a wall has at least. taken: (4 n n,) zeros; 1 where there is a wall afterwards.
    order: (4 n n,) out.
    """
    n = codes.shape[0]
    count = 0
    for j in range(n):
        for i in range(n):
            for first in range(4):
                if not _is_open(codes, floors, border, least, taken, i, j, first):
                    continue
                x, y, k = types.int64(i), types.int64(j), types.int64(first)
                going = True
                while going:
                    side = 4 * (n * y + x) + k
                    taken[side] = 1
                    order[count] = side
                    count += 1
                    ahead_x = x + _ALONG_X[k]
                    ahead_y = y + _ALONG_Y[k]
                    out_x = ahead_x + _OUT_X[k]
                    out_y = ahead_y + _OUT_Y[k]
                    if _is_open(codes, floors, border, least, taken, x, y, _LEFT[k]):
                        k = _LEFT[k]
                    elif _is_open(codes, floors, border, least, taken, ahead_x, ahead_y, k):
                        x, y = ahead_x, ahead_y
                    elif _is_open(codes, floors, border, least, taken, out_x, out_y, _RIGHT[k]):
                        x, y, k = out_x, out_y, _RIGHT[k]
                    else:
                        going = False
    return count


@device
def rows_of(drop, scale, most):  # type: ignore[no-untyped-def]
    """Rows of a side that goes down so many steps. scale: rows for 256 of them. most: of the image."""
    wanted = (drop * scale + 255) >> 8
    for n in range(ROWS.shape[0]):
        if ROWS[n] >= wanted and ROWS[n] <= most:
            return types.int64(ROWS[n])
    found = types.int64(1)
    for n in range(ROWS.shape[0]):
        if ROWS[n] <= most:
            found = types.int64(ROWS[n])
    return found


_COUNT = types.int64


@kernel(
    types.int64(
        U8_2, U8_2, U8_2, _COUNT, I32_1, _COUNT, _COUNT, _COUNT, _COUNT, _COUNT, types.int32[:, ::1]
    )
)  # fmt: skip
def place_walls(  # type: ignore[no-untyped-def]
    codes, floors, border, least, order, count, columns, across, sharing, scale, places
):
    """Where each side lies in the image of walls: the highest first, row beside row; returns the rows that all take.

    order, count: of `trace_walls`. columns: of the image. across: of a side; or, where `sharing` is above 1, one column
    for so many sides. scale: see `rows_of`. places: (4 n n, 3) out: column, first row, rows.
    """
    n = codes.shape[0]
    top = types.int64(0)
    height = types.int64(0)
    column = types.int64(columns)
    placed = 0
    for c in range(ROWS.shape[0] - 1, -1, -1):
        for at in range(count):
            side = types.int64(order[at])
            k = side & 3
            texel = side >> 2
            drop = drop_of(codes, floors, border, least, texel % n, texel // n, k)
            rows = rows_of(drop, scale, n)
            if rows != ROWS[c]:
                continue
            if placed % sharing == 0:
                column += across
                if column + across > columns:
                    top += height
                    height = rows
                    column = types.int64(0)
            placed += 1
            places[side, 0] = column
            places[side, 1] = top
            places[side, 2] = rows
    return top + height
