"""The plain twin of kernels.unfold, word by word from spec/blockmap.md, Walls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Side = tuple[int, int, str]
"""Column and row of a texel, and which of its sides."""
NAMES = "west", "east", "south", "north"
OUT = {"west": (-1, 0), "east": (1, 0), "south": (0, -1), "north": (0, 1)}
AHEAD = {"south": (1, 0), "east": (0, 1), "north": (-1, 0), "west": (0, -1)}
NEXT = {"south": "east", "east": "north", "north": "west", "west": "south"}
PREVIOUS = {after: before for before, after in NEXT.items()}
ROWS = 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64


def number_of(side: Side, n: int) -> int:
    """As kernels number sides."""
    i, j, name = side
    return 4 * (n * j + i) + NAMES.index(name)


class PlainWalls:
    """The walls of a map."""

    def __init__(
        self, codes: NDArray[np.uint8], floors: NDArray[np.uint8], border: NDArray[np.uint8], least: int
    ) -> None:
        self.codes, self.floors, self.border, self.least = codes.astype(int), floors.astype(int), border, least
        self.n = len(codes)

    def drop(self, side: Side) -> int:
        """Steps that a side goes down; 0: it is no wall."""
        i, j, name = side
        if not (0 <= i < self.n and 0 <= j < self.n) or self.codes[j, i] == 0:
            return 0
        c, f = int(self.codes[j, i]), max(1, int(self.floors[j, i]))
        x, y = i + OUT[name][0], j + OUT[name][1]
        if not (0 <= x < self.n and 0 <= y < self.n):
            along = j if name in ("west", "east") else i
            return max(c - f, 1) if self.border[NAMES.index(name), along] else 0
        b = int(self.codes[y, x])
        drop = c - max(b, f)
        if b == 0:
            drop = max(drop, 1)
        return drop if drop >= self.least or (b == 0 and c > f) else 0

    def listed(self) -> list[Side]:
        """All walls, as one walks along them with the body on the left."""
        found: list[Side] = []
        for j in range(self.n):
            for i in range(self.n):
                for name in NAMES:
                    step: Side | None = (i, j, name)
                    while step is not None and self.drop(step) and step not in found:
                        found.append(step)
                        step = self._after(step, found)
        return found

    def _after(self, side: Side, found: list[Side]) -> Side | None:
        i, j, name = side
        x, y = i + AHEAD[name][0], j + AHEAD[name][1]
        right = x + OUT[name][0], y + OUT[name][1]
        for step in ((i, j, NEXT[name]), (x, y, name), (*right, PREVIOUS[name])):
            if self.drop(step) and step not in found:
                return step
        return None

    def rows(self, side: Side, scale: int) -> int:
        """Of the image of walls that a side takes."""
        possible = [rows for rows in ROWS if rows <= self.n]
        enough = [rows for rows in possible if rows >= math.ceil(self.drop(side) * scale / 256)]
        return min(enough, default=possible[-1])

    def placed(self, columns: int, across: int, sharing: int, scale: int) -> tuple[dict[Side, tuple[int, ...]], int]:
        """Column, first row and rows of each wall; and the rows that all take."""
        highest_first = sorted(self.listed(), key=lambda side: -self.rows(side, scale))
        places: dict[Side, tuple[int, ...]] = {}
        top, height, column = 0, 0, columns
        for placed, side in enumerate(highest_first):
            rows = self.rows(side, scale)
            if placed % sharing == 0:
                column += across
                if column + across > columns:
                    top, height, column = top + height, rows, 0
            places[side] = column, top, rows
        return places, top + height
