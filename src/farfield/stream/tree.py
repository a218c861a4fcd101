"""The cells of a world as arrays, for looking at all that is near a viewer at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from farfield.errors import CorruptTileError
from farfield.octree.grid import CellKey, Grid
from farfield.stream.offers import SHARES
from farfield.world.index import CellEntry
from farfield.world.keys import geometry_key, mesh_key, orthoview_key
from farfield.world.world import World

NONE = -1
LAYERS = 2
"""Depth layers that are drawn of a view."""
REMEMBERED = 20_000
"""Cells seen from a side whose tiles are kept listed: some 30 MB."""


@dataclass(frozen=True, slots=True)
class CellValues:
    """What shows a cell: its tiles, best first, or its geometry."""

    cell: str
    is_geometry: bool
    keys: tuple[str, ...]
    sizes: tuple[int, ...]
    """Bytes of each."""
    shares: tuple[float, ...]
    """Of what all of them show; the sum is 1. None of geometry, which is shown by all or nothing."""
    steps: tuple[int, ...]
    """How many of them are offered together, ascending."""
    leaves: int = 1
    """How many leaves' geometry it is, `cell` and those after it."""

    def shown_by(self, held: set[str]) -> float:
        """Share that the viewer has."""
        there = [key in held for key in self.keys]
        if self.is_geometry:
            return float(all(there))
        return sum(share for share, is_there in zip(self.shares, there, strict=True) if is_there)


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
        self.pictures = lru_cache(REMEMBERED)(self._pictures)
        """The tiles that a cell is drawn from; cell, view bin and least gain -> CellValues."""

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

    def _pictures(self, cell: int, from_bin: int, least_gain: float) -> CellValues:
        """The tiles that a cell is drawn from, best first (spec/drawing.md, Which tiles)."""
        entry = self.entries[cell]
        picks = [(number, gain) for number, gain in entry.picks_from(from_bin) if entry.tiles[number][1] < LAYERS]
        picks = [pick for n, pick in enumerate(picks) if n == 0 or pick[1] >= least_gain]
        tiles = [entry.tiles[number] for number, _ in picks] or list(entry.tiles)
        shows = [gain * entry.tiles[number][2] for number, gain in picks] or [1.0] * len(tiles)
        keys = tuple(orthoview_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in tiles)
        shares = tuple(part / sum(shows) for part in shows)
        sizes = tuple(size for _, _, size in tiles)
        return CellValues(entry.key, False, keys, sizes, shares, _steps(shares))

    def geometry(self, cell: int) -> CellValues:
        """What a leaf is drawn from as triangles: nothing less than all of it."""
        entry = self.entries[cell]
        near = entry.geometry
        assert near is not None
        keys = (geometry_key(entry.cell, near.hash), *(mesh_key(name) for name, _ in near.meshes))
        sizes = (near.bytes, *(size for _, size in near.meshes))
        return CellValues(entry.key, True, keys, sizes, (), (len(keys),))


def _steps(shares: Sequence[float]) -> tuple[int, ...]:
    """How many tiles, best first, show each of SHARES of the whole."""
    reached = np.cumsum(shares)
    return tuple(sorted({int(np.argmax(reached >= share - 1e-6)) + 1 for share in SHARES}))
