"""The cells of a world as arrays, for looking at all that is near a viewer at once."""

from __future__ import annotations

from collections import deque

import numpy as np

from farfield.errors import CorruptTileError
from farfield.octree.grid import CellKey, Grid
from farfield.world.index import CellEntry
from farfield.world.world import World

NONE = -1


class CellTree:
    """Every cell of a world, parents before children and the children of each in a row, read from its index once.

    Shared by all viewers of one generation; takes about 3 kB a cell, nearly all of it the entries themselves.
    """

    def __init__(self, grid: Grid, entries: list[CellEntry], parents: list[int]) -> None:
        """entries: parents before children, children in a row. parents: number of each one's parent, NONE of roots."""
        self.grid = grid
        self.entries = entries
        self.parents = np.array(parents, np.int32)
        keys = [entry.cell for entry in entries]
        self.levels = np.array([key.level for key in keys], np.int32)
        self.boxes = np.array([grid.bounds(key).ravel() for key in keys], np.float64).reshape(-1, 6)
        """(n, 6) local metres: lower and upper corners of the cells."""
        self.bounds = np.array([np.ravel(entry.bounds) for entry in entries], np.float64).reshape(-1, 6)
        """(n, 6) the same of what is in them."""
        self.errors = np.array([entry.error for entry in entries], np.float64)
        """(n,) metres between the pixels of their pictures."""
        self.has_pictures = np.array([len(entry.tiles) > 0 for entry in entries], bool)
        self.has_geometry = np.array([entry.geometry is not None for entry in entries], bool)
        self.children = np.zeros((len(entries), 2), np.int32)
        """(n, 2) the first child and how many there are."""
        below = np.flatnonzero(self.parents >= 0)
        first = below[::-1]
        self.children[self.parents[first], 0] = first
        np.add.at(self.children[:, 1], self.parents[below], 1)
        self.roots = np.flatnonzero(self.parents == NONE).astype(np.int32)

    @classmethod
    def of(cls, world: World) -> CellTree:
        """All cells of a world; below an index tile that is damaged there are none."""
        entries: list[CellEntry] = []
        parents: list[int] = []
        pending: deque[tuple[CellKey, int]] = deque((key, NONE) for key in world.roots)
        while pending:
            key, parent = pending.popleft()
            try:
                entries.append(world.entry(key))
                parents.append(parent)
                pending.extend((child, len(entries) - 1) for child in world.children(key))
            except (CorruptTileError, KeyError):
                continue
        return cls(world.grid, entries, parents)
