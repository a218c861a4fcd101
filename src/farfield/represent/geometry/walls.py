"""What cells of a level share at their walls, made coarser so that neighbours still share it.

Each cell is simplified by itself. Where each chose by itself what to keep of the lines along which the walls cut it,
cracks would open, wide ones in coarse forms. So it is chosen by place alone: the corners on a wall are gathered in
squares (or what is flatter), one of each is kept, and stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.represent.chunk import Chunk

FLATTER = 4.0
"""Times that squares are longer than high: ground is not to be pulled up to the houses on it, nor they down."""
ALIKE = 0.7
"""Cosine between normals, 45 degrees, up to which a corner takes the normal that its neighbour gives it too."""


@dataclass(frozen=True, slots=True)
class Walls:
    """Of a cell."""

    size: NDArray[np.float64]
    """(3,) metres along its sides."""
    step: float
    """Metres that positions are rounded to in the end."""

    def gathered(self, chunk: Chunk, square: float) -> Gathered:
        """A chunk with fewer corners on the walls. square: metres along a level side of what one is kept of."""
        positions = chunk.positions.astype(np.float64)
        side = self._side(positions)
        on_wall: NDArray[np.bool_] = np.asarray(side.any(axis=1))
        rows = np.flatnonzero(on_wall)
        if not len(rows):
            return Gathered(chunk, on_wall, np.empty((0, 3), np.int64), np.empty((0, 3), np.float32))
        steps = self._steps(positions[rows], side[rows])
        at = positions[rows] / (square * np.array([1.0, 1.0, 1 / FLATTER]))
        cell = np.where(side[rows] > 0, -side[rows].astype(np.int64), np.floor(at).astype(np.int64))
        # What is nearest to the middle of its square; neighbours see the same numbers.
        off = np.where(side[rows] > 0, 0.0, np.abs(at - np.floor(at) - 0.5)).max(axis=1).round(6)
        order = np.lexsort((*steps.T, off, *cell.T))
        first = np.append(True, (cell[order[1:]] != cell[order[:-1]]).any(axis=1))
        number = np.cumsum(first) - 1
        kept = steps[order[first]][number]
        is_kept = (steps[order] == kept).all(axis=1)
        moved = positions.copy()
        moved[rows[order]] = kept * self.step
        # On the far walls to the bit, whatever a whole number of steps comes to.
        moved = np.where(side == 2, self.size, moved)
        chunk = replace(chunk, positions=moved.astype(np.float32))
        names = rows[order[is_kept]]
        gathered = Gathered(chunk, on_wall, kept[is_kept], chunk.normals[names])
        return replace(gathered, chunk=self.with_normals(chunk, gathered))

    def with_normals(self, chunk: Chunk, gathered: Gathered) -> Chunk:
        """A chunk with, at its corners on the walls, the normals that these had before it was simplified."""
        positions = chunk.positions.astype(np.float64)
        side = self._side(positions)
        rows = np.flatnonzero(side.any(axis=1))
        if not len(rows) or not len(gathered.places):
            return chunk
        known, which = np.unique(gathered.places, axis=0, return_inverse=True)
        own = _found(known, self._steps(positions[rows], side[rows]))
        rows, own = rows[own >= 0], own[own >= 0]
        by_place = np.argsort(which.ravel(), kind="stable")
        start = np.searchsorted(which.ravel()[by_place], np.arange(len(known) + 1))
        counts = np.diff(start)[own]
        pair = np.repeat(np.arange(len(own)), counts)
        candidate = by_place[
            np.repeat(start[own], counts) + np.arange(len(pair)) - np.repeat(np.cumsum(counts) - counts, counts)
        ]
        cosine = np.einsum("ij,ij->i", chunk.normals[rows[pair]], gathered.normals[candidate])
        best = np.lexsort((cosine, pair))[np.cumsum(counts) - 1]
        near = cosine[best] >= ALIKE
        normals = chunk.normals.copy()
        normals[rows[near]] = gathered.normals[candidate[best[near]]]
        return replace(chunk, normals=normals)

    def _side(self, positions: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(n, 3) for each axis 0: on neither wall, 1: on the lower, 2: on the upper."""
        room = self.step / 4
        return (1 * (positions <= room) + 2 * (positions >= self.size - room)).astype(np.uint8)

    def _steps(self, positions: NDArray[np.float64], side: NDArray[np.uint8]) -> NDArray[np.int64]:
        """(n, 3) whole numbers that name places on the walls."""
        far = np.round(self.size / self.step).astype(np.int64)
        return np.where(side == 0, np.round(positions / self.step).astype(np.int64), np.where(side == 1, 0, far))


@dataclass(frozen=True, slots=True)
class Gathered:
    """A chunk and what of it is to stay."""

    chunk: Chunk
    fixed: NDArray[np.bool_]
    """(n,) corners on walls."""
    places: NDArray[np.int64]
    """(k, 3) steps, of those that were kept, and of others at the same place."""
    normals: NDArray[np.float32]
    """(k, 3) that they had."""


def _found(known: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) row of `known`, distinct and ascending, that each of (n, 3) is; -1: none."""
    both, which = np.unique(np.concatenate([known, wanted]), axis=0, return_inverse=True)
    row = np.full(len(both), -1)
    row[which.ravel()[: len(known)]] = np.arange(len(known))
    return np.asarray(row[which.ravel()[len(known) :]])
