"""Texture coordinates of façades: walls of several faces as one, with whole bays along them and whole floors up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.facades import BAY, BAYS, FLOOR, FLOORS, PIER, SHORTEST_WINDOW_WALL

STEEPEST = 0.3
"""Vertical share of a normal up to which a face is a wall."""
LOWEST = 2.0
"""Metres; lower walls have no windows."""
_SAME_DIRECTION = 0.0035
"""Radians: corners rounded to millimetres turn the normal of a wall of a metre by a third of it."""
_SAME_PLANE = 0.05
_NEAR = 0.1
"""Metres: faces of a plane no further apart are one wall."""
_SEAM = 0.0123
"""Radians that the circle of directions is cut beside an axis, where few walls are."""


def facade_uvs(
    points: NDArray[np.float64],
    size: NDArray[np.int64],
    normal: NDArray[np.float64],
    owner: NDArray[np.int64],
    seed: NDArray[np.uint32],
) -> NDArray[np.float32]:
    """(c, 2) for the corners of walls; v grows downwards. Where in the texture a wall begins is drawn from the seed.

    points: (c, 3) face after face. size: (w,) corners of each face. normal: (w, 3) unit. owner: (w,) building.
    seed: (w,) of the building.
    """
    if not len(size):
        return np.zeros((0, 2), np.float32)
    face = np.repeat(np.arange(len(size)), size)
    starts = np.cumsum(size) - size
    direction, along = _directions(normal, owner)
    distance = np.add.reduceat((points * along[face]).sum(1), starts) / size
    plane = _clusters(direction, distance, _SAME_PLANE)
    side = np.stack([-along[:, 1], along[:, 0]], -1)
    run = (points[:, :2] * side[face]).sum(1)
    wall = _stretches(plane, np.minimum.reduceat(run, starts), np.maximum.reduceat(run, starts))
    low_run, high_run = _extents(run, wall[face])
    low, high = _extents(points[:, 2], wall[face])
    length, height = (high_run - low_run)[wall], (high - low)[wall]
    bays = np.maximum(np.round(length / BAY), 1)
    bare = (length < SHORTEST_WINDOW_WALL) | (height < LOWEST)
    bays = np.where(bare, PIER, bays)
    floors = np.maximum(np.round(height / FLOOR), 1)
    left = ((seed >> np.uint32(8)) % np.uint32(BAYS))[face]
    base = ((seed >> np.uint32(16)) % np.uint32(FLOORS))[face]
    share = np.stack([(run - low_run[wall][face]) / length[face], (points[:, 2] - low[wall][face]) / height[face]], -1)
    share = np.nan_to_num(share)
    u = (left + bays[face] * share[:, 0]) / BAYS
    v = -(base + floors[face] * share[:, 1]) / FLOORS
    return np.stack([u, v], -1).astype(np.float32)


def _directions(normal: NDArray[np.float64], owner: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """(w,) number of the direction that walls of a building share, and (w, 3) that direction, horizontal and unit."""
    angle = (np.arctan2(normal[:, 1], normal[:, 0]) + _SEAM) % (2 * np.pi)
    number = _clusters(owner, angle, _SAME_DIRECTION)
    x, y = (np.bincount(number, normal[:, axis]) for axis in (0, 1))
    length = np.hypot(x, y)
    shared = np.stack([x / length, y / length, np.zeros(len(x))], -1)
    return number, shared[number]


def _clusters(group: NDArray[np.int64], value: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """(w,) numbers: the same for those of a group whose values, in order, follow each other without a larger gap."""
    order = np.lexsort((value, group))
    new = (np.diff(group[order]) != 0) | (np.diff(value[order]) > gap)
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.concatenate([[0], np.cumsum(new)])
    return numbers


def _stretches(plane: NDArray[np.int64], low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.int64]:
    """(w,) numbers of walls: the same for faces of a plane that touch, or are joined by others that do."""
    order = np.lexsort((low, plane))
    # One plane after the other on one long line, so that they can all be swept at once.
    shift = plane[order] * (float(np.ptp([low.min(), high.max()])) + 1.0)
    reached = np.maximum.accumulate(high[order] + shift)
    new = (low[order] + shift)[1:] > reached[:-1] + _NEAR
    new |= np.diff(plane[order]) != 0
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.concatenate([[0], np.cumsum(new)])
    return numbers


def _extents(value: NDArray[np.float64], wall: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Lowest and highest value of each wall."""
    count = int(wall.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, wall, value)
    np.maximum.at(high, wall, value)
    return low, high
