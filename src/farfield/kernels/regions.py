"""Cells of a tree that are fine enough for a viewer on its way: the cut, from all of it at once (OV 4.2, 6.2)."""

from __future__ import annotations

from numba import types

from farfield.kernels.compiling import device, kernel

_I32 = types.Array(types.int32, 1, "C", readonly=True)
_I32_2 = types.Array(types.int32, 2, "C", readonly=True)
_F64_2 = types.Array(types.float64, 2, "C", readonly=True)


@device
def _away(box, eyes):  # type: ignore[no-untyped-def]
    """Metres from a box to the nearest of the eyes; 0 inside."""
    least = 1e300
    for n in range(eyes.shape[0]):
        square = 0.0
        for axis in range(3):
            gap = max(box[axis] - eyes[n, axis], eyes[n, axis] - box[axis + 3], 0.0)
            square += gap * gap
        least = min(least, square)
    return least**0.5


@kernel(
    types.int64(
        _I32, _I32_2, _I32, _F64_2, _F64_2, types.float64, types.float64,
        types.Array(types.int32, 1, "C"), types.Array(types.int32, 1, "C"),
    )
)  # fmt: skip
def find_regions(roots, children, levels, boxes, eyes, radius, near, pending, found):  # type: ignore[no-untyped-def]
    """The coarsest cells that are fine enough from every eye; together they cover the world once.

    roots: (r,) int32. children: (n, 2) int32, the first child of each cell and how many follow each other from it on.
    levels: (n,) int32. boxes: (n, 6) float64, local metres, lower and upper corners. eyes: (k, 3) float64. radius:
    metres from which a leaf is fine enough, doubled at each level; near: leaves nearer than that are geometry, so no
    cell above a leaf is. pending: (n,) int32, room for the walk. found: (n,) int32 out. Returns how many there are.
    """
    count = 0
    waiting = 0
    for n in range(roots.shape[0] - 1, -1, -1):
        pending[waiting] = roots[n]
        waiting += 1
    while waiting > 0:
        waiting -= 1
        cell = pending[waiting]
        level = levels[cell]
        is_fine = level == 0 or children[cell, 1] == 0
        if not is_fine:
            away = _away(boxes[cell], eyes)
            is_fine = away >= radius * 2.0**level and away >= near
        if is_fine:
            found[count] = cell
            count += 1
            continue
        for n in range(children[cell, 1] - 1, -1, -1):
            pending[waiting] = children[cell, 0] + n
            waiting += 1
    return count
