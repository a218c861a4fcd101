"""The cut: which cells are shown from pictures and which leaves as geometry (OV 4.2; spec/world.md, Cut).

The viewer computes the same cut in TypeScript; shared vectors in tests/vectors hold the two together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.directions import PRINCIPAL
from farfield.octree.grid import CellKey, Grid

_BINS = np.array(PRINCIPAL, dtype=np.float64)
_BINS /= np.sqrt((_BINS * _BINS).sum(-1, keepdims=True))


class Tree(Protocol):
    """What the cut needs to know of a world."""

    @property
    def roots(self) -> Iterable[CellKey]:
        """Root cells that hold something."""
        ...

    def children(self, key: CellKey) -> Iterable[CellKey]:
        """Cells below that hold something."""
        ...


@dataclass(frozen=True, slots=True)
class Cut:
    """Result of `cut`, both in order of discovery (depth first, children ascending)."""

    pictures: list[CellKey] = field(default_factory=list)
    """Cells drawn from orthoviews."""
    geometry: list[CellKey] = field(default_factory=list)
    """Leaves nearer than the near radius."""


def near_radius(grid: Grid, width: int, horizontal_fov: float) -> float:
    """r of OV 4.2: the distance at which a leaf pixel projects to one picture pixel, metres.

    width: picture width in pixels; horizontal_fov: radians.
    """
    return grid.leaf_size * width / (2 * grid.resolution * math.tan(horizontal_fov / 2))


def distance(grid: Grid, key: CellKey, eye: NDArray[np.float64]) -> float:
    """Metres from the eye to the nearest point of the cell's box; 0 inside."""
    lower, upper = grid.bounds(key)
    gap = np.maximum(np.maximum(lower - eye, eye - upper), 0.0)
    return math.sqrt(float(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]))


def cut(tree: Tree, grid: Grid, eye: NDArray[np.float64], radius: float, near: float | None = None) -> Cut:
    """Cells to draw from `eye` (local metres).

    radius: distance from which a leaf is fine enough, metres (near_radius / 2^bias); a cell of level L is taken from
    radius * 2^L on. near: leaves nearer than this are geometry; default radius; 0 shows everything from pictures.
    """
    near = radius if near is None else near
    result = Cut()
    pending = list(reversed(list(tree.roots)))
    while pending:
        key = pending.pop()
        away = distance(grid, key, eye)
        if key.level == 0:
            (result.geometry if away < near else result.pictures).append(key)
        elif away >= radius * 2.0**key.level and away >= near:
            result.pictures.append(key)
        else:
            pending.extend(reversed(list(tree.children(key))))
    return result


def view_bin(middle: NDArray[np.float64], eye: NDArray[np.float64]) -> int:
    """Number of the principal direction nearest by angle to the vector middle -> eye; ties to the lower number."""
    return int(view_bins(middle[None], eye)[0])


def view_bins(middles: NDArray[np.float64], eye: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) the same of each of (n, 3) middles."""
    x, y, z = (np.asarray(eye, dtype=np.float64) - middles).T[..., None]
    return np.asarray(np.argmax(_BINS[:, 0] * x + _BINS[:, 1] * y + _BINS[:, 2] * z, axis=1))
