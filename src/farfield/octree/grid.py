"""The world-anchored grid of cells and the octree above it (OV 4.1).

Level 0 are the leaves, cubes of the leaf size; indices are signed. Going up one level halves the index along
every axis that is still merging; an axis stops merging at its own level (`axis_levels`), so flat worlds have flat
upper cells. Cells never merge across index 0: the roots are those among {-1, 0}^3 that hold anything.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError

MAXIMUM_LEVEL = 40
"""Highest level of a cell: 2^40 leaves of a millimetre span a million kilometres."""
MAXIMUM_INDEX = 1 << MAXIMUM_LEVEL
"""Indices of cells lie within this on both sides of 0: all that merge up to the highest level."""
_INDEX = r"(0|-?[1-9][0-9]{0,12})"
_KEY = re.compile(rf"(0|[1-9][0-9]?)/{_INDEX}/{_INDEX}/{_INDEX}")


class CellKey(NamedTuple):
    """Name of a cell: level counted up from the leaves, signed indices along x, y, z."""

    level: int
    x: int
    y: int
    z: int

    def __str__(self) -> str:
        return f"{self.level}/{self.x}/{self.y}/{self.z}"

    @classmethod
    def parse(cls, text: str) -> CellKey:
        """From `level/x/y/z`, as `str` writes it.

        Raises OptionError when it is none, the level is beyond MAXIMUM_LEVEL or an index beyond MAXIMUM_INDEX.
        """
        found = _KEY.fullmatch(text)
        key = cls(*map(int, found.groups())) if found else None
        if key is None or key.level > MAXIMUM_LEVEL or max(map(abs, key[1:])) > MAXIMUM_INDEX:
            raise OptionError("not a cell key", text[:80], "a key is level/x/y/z")
        return key


@dataclass(frozen=True, slots=True)
class Grid:
    """Where cells lie. Immutable; written into the manifest of a world."""

    leaf_size: float
    """Edge of a leaf cube, metres."""
    resolution: int
    """Pixels of an orthoview across one leaf edge (q of OV 4.1)."""
    corner: tuple[float, float, float]
    """Local metres of the lower corner of cell 0/0/0/0: the zero of every pixel lattice."""
    axis_levels: tuple[int, int, int]
    """Level from which cells no longer merge along x, y, z."""

    @property
    def top_level(self) -> int:
        """Level of the roots."""
        return max(self.axis_levels)

    def merges(self, level: int) -> tuple[int, int, int]:
        """How often cells of that level have merged along each axis."""
        ax, ay, az = self.axis_levels
        return min(level, ax), min(level, ay), min(level, az)

    def pitch(self, level: int) -> float:
        """Metres between pixels of an orthoview at that level; also its geometric error."""
        return self.leaf_size / self.resolution * 2.0**level

    def cell_size(self, level: int) -> NDArray[np.float64]:
        """(3,) float64 metres."""
        return self.leaf_size * 2.0 ** np.array(self.merges(level), dtype=np.float64)

    def bounds(self, key: CellKey) -> NDArray[np.float64]:
        """(2, 3) float64: lower and upper corner in local metres; half-open."""
        size = self.cell_size(key.level)
        lower = np.array(self.corner) + np.array([key.x, key.y, key.z]) * size
        return np.stack([lower, lower + size])

    def parent(self, key: CellKey) -> CellKey:
        """The cell above. The top level has none: raises ValueError."""
        if key.level >= self.top_level:
            raise ValueError(f"{key} is a root")
        m, n = self.merges(key.level), self.merges(key.level + 1)
        return CellKey(key.level + 1, *(i >> (b - a) for i, a, b in zip(key[1:], m, n, strict=True)))

    def ancestor(self, key: CellKey, level: int) -> CellKey:
        """The cell of that level (at least the key's own) that holds this one."""
        m, n = self.merges(key.level), self.merges(level)
        return CellKey(level, *(i >> (b - a) for i, a, b in zip(key[1:], m, n, strict=True)))

    def children(self, key: CellKey) -> tuple[CellKey, ...]:
        """The up to 8 cells below, in ascending order; none for a leaf."""
        if key.level == 0:
            return ()
        m, n = self.merges(key.level - 1), self.merges(key.level)
        axes = [range(i << (b - a), ((i + 1) << (b - a))) for i, a, b in zip(key[1:], m, n, strict=True)]
        return tuple(CellKey(key.level - 1, x, y, z) for x in axes[0] for y in axes[1] for z in axes[2])

    def leaf_index(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """(..., 3) local metres -> (..., 3) int64 leaf indices (half-open, no rounding)."""
        return np.asarray(np.floor((points - np.array(self.corner)) / self.leaf_size), dtype=np.int64)


def axis_levels_of(first: NDArray[np.int64], last: NDArray[np.int64]) -> tuple[int, int, int]:
    """Levels after which leaf indices first..last (inclusive, (3,) int64) have all become -1 or 0."""
    reach = np.maximum(last + 1, -first)
    x, y, z = (int(max(0, int(r) - 1)).bit_length() for r in reach)
    return x, y, z
