"""The plain twin of kernels.regather: each sample of a wall looks at every finer wall in its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.regather import FACING, SAMPLES

OUT = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)], np.float32)
"""Out of sides 0 to 3."""


class FineMaps(NamedTuple):
    """What kernels.regather takes of the finer maps, in its order."""

    source: NDArray[np.int32]
    places: NDArray[np.int32]
    ends: NDArray[np.float32]
    colors: NDArray[np.uint8]
    azimuths: NDArray[np.float32]
    across: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class FineWall:
    """A finer wall in the place of a coarser texel."""

    side: int
    x: int
    """Which of the finer texels in one of the coarser map, from the west."""
    y: int
    """From the south."""
    upper: np.float32
    lower: np.float32
    texels: NDArray[np.float32]
    """(rows, columns, 3) linear light, from above."""
    normal: NDArray[np.float32]
    """(2,)"""

    def is_at(self, z: np.float32) -> bool:
        """Whether it is as high."""
        return bool(self.lower <= z <= self.upper)

    def color(self, z: np.float32) -> NDArray[np.float64]:
        """(3,) of its row at a height, or of its row nearest to that."""
        share = (self.upper - z) / max(self.upper - self.lower, np.float32(1e-9))
        row = math.floor(float(share) * len(self.texels))
        return np.asarray(self.texels[min(max(row, 0), len(self.texels) - 1)].mean(axis=0, dtype=np.float64))


def finer_walls(fine: FineMaps, i: int, j: int, wide: int, deep: int) -> list[FineWall]:
    """All in the place of texel (i, j)."""
    n, found = fine.colors.shape[1], []
    for layer in fine.source:
        for y, x in np.ndindex(deep, wide):
            (row, fine_j), (column, fine_i) = divmod(j * deep + y, n), divmod(i * wide + x, n)
            child = int(layer[row, column])
            for side in range(4):
                at = child, 4 * (n * fine_j + fine_i) + side
                first, top, rows = fine.places[at].tolist()
                if child >= 0 and rows > 0:
                    columns = slice(n + first, n + first + int(fine.across[child]))
                    texels = LINEAR_OF_BYTE[fine.colors[child, top : top + rows, columns]]
                    found.append(FineWall(side, x, y, *fine.ends[at], texels, fine.azimuths[at]))
    return found


def shown(walls: list[FineWall], side: int, z: np.float32, half: int | None) -> list[FineWall]:
    """Of them those that a sample of a coarser side shows. half: of the side that it is in; None: in both."""
    same = [wall for wall in walls if wall.side == side]
    if half is not None:
        same = [wall for wall in same if (wall.y if side < 2 else wall.x) == half]
    return [wall for wall in same if wall.is_at(z)] or same or walls


def gathered(
    fine: FineMaps, wide: int, deep: int,
    sides: NDArray[np.int32], places: NDArray[np.int32], ends: NDArray[np.float32], across: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """(n, m, 4) sums of colours and their number, and (4 n n, 2) of normals, as kernels.regather gives them."""
    n = fine.colors.shape[1]
    sums = np.zeros((n, fine.colors.shape[2] - n, 4))
    normals = np.zeros((4 * n * n, 2))
    for at in sides.tolist():
        (j, i), side = divmod(at // 4, n), at % 4
        walls, is_parted = finer_walls(fine, i, j, wide, deep), across > 1 and (deep if side < 2 else wide) == 2
        first, top, rows = places[at].tolist()
        each = (ends[at, 0] - ends[at, 1]) / np.float32(rows * SAMPLES)
        for row, column in np.ndindex(rows * SAMPLES, across):
            z = ends[at, 0] - np.float32(row + 0.5) * each
            seen = shown(walls, side, z, column * 2 // across if is_parted else None)
            if seen:
                color = np.mean([wall.color(z) for wall in seen], axis=0)
                sums[top + row // SAMPLES, first + column] += [*color, 1.0]
            for wall in seen:
                # One that faces elsewhere tells nothing of how this one is turned.
                if wall.normal @ OUT[side] > FACING:
                    normals[at] += wall.normal
    return sums, normals
