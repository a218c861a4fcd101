"""Faces with any number of corners, as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fan(polygons: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """(m, 3): every polygon as a fan round its first corner; those with fewer than three corners vanish."""
    if not polygons:
        return np.zeros((0, 3), np.int64)
    sizes = np.array([len(polygon) for polygon in polygons])
    flat = np.concatenate(polygons)
    return flat[fan_corners(sizes)]


def fan_corners(sizes: NDArray[np.integer]) -> NDArray[np.int64]:
    """(m, 3) places in the concatenated corners of polygons of these sizes."""
    starts = np.cumsum(sizes) - sizes
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(starts, counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.stack([first, first + step + 1, first + step + 2], -1)
