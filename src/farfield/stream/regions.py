"""What the objects of a world are for one viewer: cells, and instances in them (BEN 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.regions import find_regions
from farfield.stream.motion import Prediction
from farfield.stream.outlook import Outlook
from farfield.stream.tree import CellTree

Floats = NDArray[np.float64]
AHEAD = 8.0
"""Seconds for which cells are made out fine enough for where the viewer will be."""
STEPS = 4
"""Places on that way."""
INSIDE = 1 / 16
"""Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it."""
OBJECTS = 4.0
"""Importance of an instance beside that of a cell (BEN 4.3). More is better by the thesis' quality and worse by FLIP,
as the ground comes later. At 2 kB/s in the terrain: .44 and .29 with 1, .59 and .32 with 2, .65 and .39 with 4, .68 and
.46 with 8; in the garden .63 and .16 with 4, .68 and .17 with 8, and at 20 kB/s .953 and .034, .969 and .035."""
DEFAULT_LEAST_GAIN = 10.0


@dataclass(frozen=True, slots=True)
class Shape:
    """How a viewer draws cells."""

    near: float | None = None
    """Metres within which leaves are geometry; None: r, as the cut defines it; 0: none are."""
    bias: float = 0.0
    """Cells are taken from r * 2^(level - bias) on."""
    least_gain: float = DEFAULT_LEAST_GAIN
    """Pixels of a view that a kilobyte of a picked tile must add."""
    far_geometry: bool = True
    """Cells farther away are geometry too, in place of their pictures, where that shows more for its bytes."""
    dynamic_impostors: bool = False
    """Images of instances may be made on demand, for where it is going to be."""


def pixel_width(bounds: Floats, away: Floats, focal: float) -> Floats:
    """Metres that a pixel is wide on what is in a cell. bounds: (..., 6) of it. away: (...) metres to it, 0 inside.

    From nearer than INSIDE nothing is told of, and who stands in a cell sees all of it.
    """
    inner = INSIDE * np.linalg.norm(bounds[..., 3:] - bounds[..., :3], axis=-1)
    return np.asarray(np.maximum(away, inner + 1e-9) / focal)


class Regions:
    """What the objects of a world are for one viewer: the cells that are fine enough for it, on the way before it.

    And the instances in them that the index lists, each an object of its own.
    """

    def __init__(self, tree: CellTree, shape: Shape | None = None) -> None:
        self.tree = tree
        self.shape = shape or Shape()
        self.cells = np.zeros(0, np.int32)
        """(n,) numbers of the cells, after the last look."""
        self.instances = np.zeros(0, np.int64)
        """(m,) rows of the tree's instances."""
        self.homes = np.zeros(0, np.int64)
        """(m,) rows of `cells` that they lie in."""
        self.radius = self.near = 0.0
        self._room = np.zeros((2, max(len(tree.entries), 1)), np.int32)

    def boxes(self, prediction: Prediction, seconds: float) -> Floats:
        """(n + m, 6) bounds of what will be seen, local metres: cells, then instances.

        seconds: for which the prediction is believed.
        """
        tree, viewing = self.tree, prediction.viewing
        self.radius = viewing.focal * tree.grid.pitch(0)
        self.near = self.radius if self.shape.near is None else self.shape.near
        eyes = prediction.eyes(np.linspace(0.0, min(seconds, AHEAD), STEPS))
        count = find_regions(
            tree.roots, tree.children, tree.levels, tree.boxes, np.ascontiguousarray(eyes),
            self.radius / 2**self.shape.bias, self.near, self._room[0], self._room[1],
        )  # fmt: skip
        self.cells = self._room[1, :count].copy()
        self._place()
        return self.bounds

    @property
    def bounds(self) -> Floats:
        """(n + m, 6) of the last look."""
        return np.concatenate([self.tree.bounds[self.cells], self.tree.instances.bounds[self.instances]])

    def importance(self, outlook: Outlook) -> NDArray[np.float32]:
        """(n + m,) see Objects. Rectangles of cells overlap: they may add up to several pictures, unlike instances'."""
        count = len(self.cells)
        overlap = float(outlook.visible[:count].sum()) / (outlook.pixels * outlook.visible.shape[1])
        factors = np.array([1.0, OBJECTS * max(overlap, 1.0)], np.float32)
        return np.repeat(factors, [count, len(self.instances)])

    def _place(self) -> None:
        """Finds the instances."""
        tree, is_seen = self.tree, self.near > 0
        if not is_seen or not len(tree.instances.leaf):
            self.instances = self.homes = np.zeros(0, np.int64)
            return
        each = [
            tree.instances_below(cell) if self.shape.far_geometry or tree.levels[cell] == 0 else np.zeros(0, np.int64)
            for cell in self.cells.tolist()
        ]
        self.instances = np.concatenate([np.zeros(0, np.int64), *each])
        self.homes = np.repeat(np.arange(len(each)), [len(own) for own in each])

    def is_near(self, away: Floats) -> NDArray[np.bool_]:
        """(n, k) whether a cell is a near leaf in an interval. away: (n + m, k) metres to each object."""
        is_near = away[: len(self.cells)] < self.near
        return np.asarray(is_near & self.tree.has_geometry[self.cells, None])
