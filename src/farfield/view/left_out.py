"""Leaf cells that a picture leaves out, because they are too near for orthoviews."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.octree.grid import Grid


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Leaves that are nearer to the eye than a radius: from the eye to the nearest point of the cell's box."""

    grid: Grid
    eye: tuple[float, float, float]
    """Local metres."""
    radius: float
    """Metres; a cell at exactly this distance is shown."""

    def keeps(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """(e, 3) leaf indices -> (e,) bool: whether the cell is shown."""
        gap = self._gaps(cells)
        return np.asarray((gap * gap).sum(-1) >= self.radius * self.radius)

    def sort(self, boxes: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(b, 2, 3) boxes, metres from the grid's corner -> (b,) bool, (b,) bool: shown whole; to be cut to cells.

        What is neither is left out whole.
        """
        room = self.grid.leaf_size / 65536
        first = np.floor((boxes[:, 0] - room) / self.grid.leaf_size).astype(np.int64)
        last = np.floor((boxes[:, 1] + room) / self.grid.leaf_size).astype(np.int64)
        lower, upper = self._gaps(first), self._gaps(last)
        eye = self._eye()
        astride = (first * self.grid.leaf_size <= eye) & (eye < (last + 1) * self.grid.leaf_size)
        least = np.where(astride, 0.0, np.minimum(lower, upper))
        most = np.maximum(lower, upper)
        squared = self.radius * self.radius
        shown = (least * least).sum(-1) >= squared
        hidden = (most * most).sum(-1) < squared
        return shown, ~shown & ~hidden

    def _eye(self) -> NDArray[np.float64]:
        return np.asarray(np.array(self.eye) - np.array(self.grid.corner), dtype=np.float64)

    def _gaps(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        lower = cells * self.grid.leaf_size
        eye = self._eye()
        gap: NDArray[np.float64] = np.maximum(np.maximum(lower - eye, eye - (lower + self.grid.leaf_size)), 0.0)
        return gap
