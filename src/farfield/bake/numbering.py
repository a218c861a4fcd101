"""Ids of objects: told by place, so that a change renumbers its neighbours and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.octree.grid import Grid
from farfield.scene.model import Instances

_BITS = 10
"""The plane of a grid is parted into 2^10 x 2^10 squares,"""
_ROOM = 1 << 12
"""and each has 2^12 of the 2^32 ids."""
MOST_OBJECTS = (1 << 32) - 1


def object_ids(instances: Instances, contents: Sequence[str], grid: Grid) -> NDArray[np.int64]:
    """(k,) int64: id of each instance's object 0; the others of its objects follow. 0 is no object.

    contents: hash of each mesh, which orders what stands in the same place. Instances with the same `first_object`
    (pieces of a large mesh) are the same objects.

    Instances take the ids of the square that they stand in, in an order of their own places; what finds no room there
    takes the next. Squares are in Morton order: ids of neighbours are near each other, and pictures of ids small. The
    ids depend on the grid and the instances alone, not on their order.

    Raises InputError for more than 2^32 - 1 objects.
    """
    rank = np.unique(np.array(contents), return_inverse=True)[1][instances.mesh]
    # Pieces of one mesh are instances of the same objects: the first of them stands for all.
    by_number = np.lexsort((rank, instances.first_object))
    _, at, which = np.unique(instances.first_object[by_number], return_index=True, return_inverse=True)
    group = np.empty(len(rank), np.int64)
    group[by_number] = which
    return _ids(instances.transform[by_number[at]], instances.objects[by_number[at]], rank[by_number[at]], grid)[group]


def _ids(
    transform: NDArray[np.float64], objects: NDArray[np.int64], rank: NDArray[np.int64], grid: Grid
) -> NDArray[np.int64]:
    if int(objects.sum()) > MOST_OBJECTS:
        raise InputError(f"the scene has {int(objects.sum()):,} objects", "", f"at most {MOST_OBJECTS:,} have ids")
    code = _squares(transform[:, :, 3], grid)
    order = np.lexsort((objects, rank, *transform.reshape(len(code), 12).T, code))
    first = np.empty(len(code), np.int64)
    before = np.cumsum(objects[order]) - objects[order]
    # The furthest that any instance up to this one is pushed on, beyond what precedes it.
    first[order] = np.maximum.accumulate(code[order] * _ROOM + 1 - before) + before
    if len(first) and int((first + objects).max()) - 1 > MOST_OBJECTS:
        first[order] = before + 1
    return first


def _squares(places: NDArray[np.float64], grid: Grid) -> NDArray[np.int64]:
    """(k,) int64 Morton code of the square that each place is in; beyond the grid they begin anew."""
    side = grid.leaf_size * 2.0 ** max(grid.axis_levels[:2]) / (1 << _BITS)
    steps = np.floor((places[:, :2] - np.array(grid.corner[:2])) / side).astype(np.int64) & ((1 << _BITS) - 1)
    code = np.zeros(len(places), np.int64)
    for bit in range(_BITS):
        code |= (steps[:, 0] >> bit & 1) << 2 * bit | (steps[:, 1] >> bit & 1) << (2 * bit + 1)
    return code
