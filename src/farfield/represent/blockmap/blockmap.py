"""What a BlockMap holds (BLK 3.1): heights, slopes, tops and walls of what stands on a square (spec/blockmap.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.represent.blockmap.unfolding import Unfolded, unfolded

CODES = 255
"""Heights that there are, from code 1 on."""
STEEP = 32
"""Steps of a slope for a rise of 1."""
STEEPEST = 127
"""Of them, at most: a rise of 4."""
TURNS = 64
"""Directions that normals of walls may have."""
_OUTWARD = np.array([32, 0, 48, 16])
"""Of the sides of a texel, TURNS-ths of a turn, counter-clockwise from x."""


@dataclass(frozen=True, slots=True)
class BlockMapSize:
    """n:m of the paper: n x n texels, and m columns of n texels for walls."""

    side: int
    columns: int

    @classmethod
    def parse(cls, text: str) -> BlockMapSize:
        """ "64:256" and the like. Raises OptionError for any other than SIZES."""
        try:
            found = cls(*map(int, text.split(":")))
        except (ValueError, TypeError):
            found = None
        if found not in SIZES:
            raise OptionError(
                f"{text!r} is not a size of BlockMaps", "--blockmap", f"one of {', '.join(map(str, SIZES))}"
            )
        return found

    def __str__(self) -> str:
        return f"{self.side}:{self.columns}"


SIZES = (BlockMapSize(16, 64), BlockMapSize(32, 192), BlockMapSize(64, 256))
"""Those of the paper (BLK 5)."""


@dataclass(frozen=True, eq=False)
class BlockMap:
    """A height field over the square of a cell, with the colours of its tops and walls. Texel (i, j): column i along x,
    row j along y, counted from the cell's lower corner."""

    size: BlockMapSize
    low: float
    """Metres from the cell's lower corner up to where code 1 is."""
    step: float
    """Metres from code to code."""
    codes: NDArray[np.uint8]
    """(n, n) rows along y; height in the middle of a texel is low + (code - 1) step; 0 = nothing there."""
    slopes: NDArray[np.int8] | None
    """(n, n, 2) rise of the top along x and y in 32nds; None: all are flat."""
    border: NDArray[np.uint8]
    """(4, n) 0 or 1: sides on the rim of the map that are walls: west and east by row, south and north by column."""
    least: int
    """Steps from top to top from which there is a wall; what is lower looks as the top does."""
    density: int
    """Of texels on walls, see unfolding.DENSITIES."""
    scale: int
    """Rows of the image of walls for 256 steps of height."""
    by_area: bool
    """Whether walls have texels by their area; else a column for each texel, as in the paper."""
    colors: NDArray[np.uint8]
    """(n, n + m, 3) sRGB: tops by row and column, then the image of walls."""
    turns: NDArray[np.uint8]
    """(count,) how far the normals of walls, in the order of `Unfolded`, are turned from straight out of their sides,
    TURNS-ths of a turn, counter-clockwise seen from above."""
    objects: NDArray[np.uint32] | None = None
    """(n, n) object ids of the tops; None: not known."""
    floors: NDArray[np.uint8] | None = None
    """(n, n) code of where what stands in a texel ends below; 0, 1: nowhere. None: nowhere, as far as is seen."""

    @cached_property
    def unfolded(self) -> Unfolded:
        """Where walls are in the image of walls."""
        walls = self.size.columns, self.density, self.scale, self.by_area
        return unfolded(self.codes, self.floors, self.border, self.least, *walls)

    @property
    def azimuths(self) -> NDArray[np.float32]:
        """(n, n, 4) radians of the normals of sides, counter-clockwise from x; of those that are no walls 0."""
        own = self.unfolded
        steps = np.append(_OUTWARD[own.sides & 3] + self.turns, 0)
        return (steps[own.normal] * (2 * np.pi / TURNS)).astype(np.float32)

    def with_turns(self, turns: NDArray[np.uint8]) -> BlockMap:
        """The same with normals of its walls."""
        return replace(self, turns=turns)

    @property
    def heights(self) -> NDArray[np.float32]:
        """(n, n) metres from the cell's lower corner in the middle of each texel; NaN: nothing there."""
        metres = self.low + (self.codes.astype(np.float32) - 1) * np.float32(self.step)
        return np.where(self.codes > 0, metres, np.nan).astype(np.float32)

    @property
    def undersides(self) -> NDArray[np.float32]:
        """(n, n) metres from the cell's lower corner down to which what stands in a texel goes."""
        floors = np.ones_like(self.codes) if self.floors is None else np.maximum(self.floors, 1)
        return (self.low + (floors.astype(np.float32) - 1) * np.float32(self.step)).astype(np.float32)


def turns_of(own: Unfolded, normals: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(count,) as BlockMap has them. normals: (4 n n, 3) of each side, any length; without any: straight out."""
    flat = own.normal.ravel()
    walls = np.flatnonzero(flat >= 0)
    angles = _OUTWARD[walls & 3] * (2 * np.pi / TURNS)
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    known = normals[walls, :2].astype(np.float64)
    known = np.where(np.abs(known).sum(axis=1, keepdims=True) > 1e-6, known, outward)
    sums = np.stack([np.bincount(flat[walls], known[:, axis], len(own.sides)) for axis in range(2)], axis=1)
    steps = np.round(np.arctan2(sums[:, 1], sums[:, 0]) * (TURNS / (2 * np.pi))).astype(np.int64)
    return np.asarray((steps - _OUTWARD[own.sides & 3]) % TURNS, np.uint8)
