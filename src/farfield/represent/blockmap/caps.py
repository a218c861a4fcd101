"""Buildings that go on above a cell: from above one looks into them, so what is inside is told by their walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.caps import fill_inside
from farfield.represent.chunk import Chunk

CLOSE = 2.0**-12
"""Of the cell's height, from its upper side: what is nearer is cut by it."""
_RIM = 2.0**-10
"""Of a cell of the grid."""
NO_OBJECT = 0xFFFFFFFF
"""In place of an object id of 0."""


def inside_at_top(
    chunk: Chunk, height: float, cells: tuple[int, int], extent: tuple[float, float]
) -> NDArray[np.uint32]:
    """(rows, columns) object ids of what goes on above a cell, NO_OBJECT where it has none; 0: nothing does.

    chunk: metres from the cell's lower corner; its walls face outwards. height: of the cell. cells: columns and rows of
    a grid over it. extent: (2,) metres along x and y.
    """
    size = cells[0]
    inside = np.zeros((size, size), np.uint32)
    walls, objects = _cut_walls(chunk, height, np.array(cells) / extent)
    if not len(walls):
        return inside
    lines = np.zeros(size, np.int64)
    bodies, goes_on = _bodies_of(walls, objects, size)
    along = np.concatenate([walls[:, :4], walls[:, 4:5]], axis=1)
    fill_inside(along, objects, bodies, goes_on, size, False, inside, lines)
    # Lines that meet no wall may lie inside all along: those across tell.
    unknown = np.flatnonzero(lines == 0)
    if len(unknown):
        other = np.zeros_like(inside)
        across = np.concatenate([walls[:, :4], walls[:, 5:6]], axis=1)
        fill_inside(across, objects, bodies, goes_on, size, True, other, np.zeros(size, np.int64))
        inside[unknown] = other[unknown]
    return inside


def _bodies_of(
    walls: NDArray[np.float64], objects: NDArray[np.uint32], size: int
) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """(k,) of which body each wall is, and whether that goes on beyond the grid.

    An object is one where its walls close, or end on the rim. All others are one together: of some houses each wall is
    an object, and a sign that has but one is none at all.
    """
    _, body = np.unique(objects, return_inverse=True)
    ends, normals = walls[:, :4], walls[:, 4:6]
    vectors = ends[:, 2:] - ends[:, :2]
    # Along each wall with the inside on the left.
    sense = np.sign(vectors[:, 1] * normals[:, 0] - vectors[:, 0] * normals[:, 1])
    gap = np.stack([np.bincount(body, sense * vectors[:, axis]) for axis in range(2)], axis=1)
    on_rim = ((ends < _RIM) | (ends > size - _RIM)).any(axis=1)
    goes_on = np.bincount(body, on_rim) > 0
    is_body = goes_on | (np.abs(gap).max(axis=1) < 1 / 2)
    bodies = np.where(is_body[body], body + 1, 0).astype(np.uint32)
    return bodies, (goes_on & (np.abs(gap).max(axis=1) >= _RIM))[body].astype(np.uint8)


def _cut_walls(
    chunk: Chunk, height: float, scale: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """(k, 6) ends of the cuts of walls with the upper side, in cells of the grid, and their normals; (k,) objects."""
    near = chunk.positions[:, 2] > height * (1 - CLOSE)
    rows = np.flatnonzero(near[chunk.triangles].sum(axis=1) == 2)
    triangles = chunk.triangles[rows]
    corners = chunk.positions[triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, :2]
    # The two corners that lie in the plane.
    ends = corners[near[triangles]].reshape(-1, 2, 3)[:, :, :2] * scale
    walls = np.concatenate([ends.reshape(-1, 4), normals], axis=1)
    objects = chunk.objects[rows].copy()
    objects[objects == 0] = NO_OBJECT
    return np.ascontiguousarray(walls), objects
