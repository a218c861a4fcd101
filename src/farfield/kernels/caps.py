"""What is inside of bodies that are open above, told by the cuts of their walls with a plane."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import kernel
from farfield.kernels.surface import F64_2, I64_1, U8_1, U32_1, U32_2

_NUDGE = 1e-4


@kernel(types.void(F64_2, U32_1, U32_1, U8_1, types.int64, types.boolean, U32_2, I64_1), allocates=True)
def fill_inside(walls, objects, bodies, goes_on, size, along_y, inside, known):  # type: ignore[no-untyped-def]
    """Marks what lies inside of walls on the lines of a grid.

    Inside of a body is what lies between two of its walls, and, where it goes on beyond the
    grid, what lies behind one.

    walls: (k, 5) x and y of both ends, in cells of the grid, and the sign of the normal's part along the line. objects:
    (k,) of each, not 0. bodies: (k,) number of that which each is a wall of. goes_on: (k,) whether that reaches the rim
    of the grid. along_y: whether lines run along y. inside: (size, size) rows along y, out: object where it is,
    0 = outside. known: (size,) out: lines with any wall; of others nothing can be told.
    """
    first = np.zeros(size + 1, np.int64)
    across = 0 if along_y else 1
    for k in range(walls.shape[0]):
        low = max(math.ceil(min(walls[k, across], walls[k, 2 + across]) - 0.5), 0)
        high = min(math.ceil(max(walls[k, across], walls[k, 2 + across]) - 0.5), size)
        for line in range(low, high):
            first[line + 1] += 1
    for line in range(size):
        first[line + 1] += first[line]
    count = first.copy()
    where = np.empty(first[size], np.float64)
    which = np.empty(first[size], np.int64)
    for k in range(walls.shape[0]):
        a, b = walls[k, across], walls[k, 2 + across]
        low = max(math.ceil(min(a, b) - 0.5), 0)
        high = min(math.ceil(max(a, b) - 0.5), size)
        for line in range(low, high):
            share = (line + 0.5 - a) / (b - a)
            # Where two walls meet on a line one goes in before one comes out.
            nudge = -_NUDGE if walls[k, 4] < 0.0 else _NUDGE
            where[count[line]] = nudge + walls[k, 1 - across] + share * (walls[k, 3 - across] - walls[k, 1 - across])
            which[count[line]] = k
            count[line] += 1
    for line in range(size):
        begin, end = first[line], first[line + 1]
        known[line] = end - begin
        order = np.argsort(where[begin:end])
        for own in range(end - begin):
            body = bodies[which[begin + own]]
            seen = False
            for before in range(own):
                seen = seen or bodies[which[begin + before]] == body
            if seen:
                continue
            # One that comes out first was inside from the beginning.
            depth = 0
            least = 0
            for n in range(end - begin):
                k = which[begin + order[n]]
                if bodies[k] == body:
                    depth += 1 if walls[k, 4] < 0.0 else -1
                    least = min(least, depth)
            is_open = goes_on[which[begin + own]] != 0
            depth = -least if is_open else 0
            owner = objects[which[begin + own]]
            at = 0
            for n in range(end - begin + 1):
                to = size
                if n < end - begin:
                    k = which[begin + order[n]]
                    if bodies[k] != body:
                        continue
                    to = min(max(math.ceil(where[begin + order[n]] - 0.5), at), size)
                if depth > 0 and (n < end - begin or is_open):
                    for cell in range(at, to):
                        row, column = (cell, line) if along_y else (line, cell)
                        if inside[row, column] == 0:
                            inside[row, column] = owner
                at = to
                if n < end - begin:
                    owner = objects[k]
                    depth = max(depth + (1 if walls[k, 4] < 0.0 else -1), 0)
