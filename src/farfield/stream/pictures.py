"""Cells of a world, by their pictures and as geometry, as things to send (OV 4.2 as a kind of BEN 4)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.regions import find_regions
from farfield.octree.cut import view_bin
from farfield.stream.accuracy import picture_accuracy
from farfield.stream.motion import Prediction
from farfield.stream.offers import SHARES, Offers, parts_of
from farfield.stream.outlook import Outlook
from farfield.stream.tree import CellTree, CellValues

Floats = NDArray[np.float64]
AHEAD = 8.0
"""Seconds for which cells are made out fine enough for where the viewer will be."""
STEPS = 4
"""Places on that way."""
INSIDE = 1 / 16
"""Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it."""
DEFAULT_LEAST_GAIN = 10.0


@dataclass(frozen=True, slots=True)
class SentCell:
    """What is to be sent: values of a cell, in this order."""

    cell: str
    """The first, of several leaves whose geometry shares meshes."""
    is_geometry: bool
    keys: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Shape:
    """How a viewer draws cells."""

    near: float | None = None
    """Metres within which leaves are geometry; None: r, as the cut defines it; 0: none are."""
    bias: float = 0.0
    """Cells are taken from r * 2^(level - bias) on."""
    least_gain: float = DEFAULT_LEAST_GAIN
    """Pixels of a view that a kilobyte of a picked tile must add."""


class Regions:
    """What the objects of a world are for one viewer: the cells that are fine enough for it, on the way before it."""

    def __init__(self, tree: CellTree, shape: Shape | None = None) -> None:
        self.tree = tree
        self.shape = shape or Shape()
        self.cells = np.zeros(0, np.int32)
        """(n,) numbers of the cells, after the last look."""
        self.radius = self.near = 0.0
        self._room = np.zeros((2, max(len(tree.entries), 1)), np.int32)

    def boxes(self, prediction: Prediction, seconds: float) -> Floats:
        """(n, 6) bounds of what will be seen, local metres; seconds: for which the prediction is believed."""
        tree, viewing = self.tree, prediction.viewing
        self.radius = viewing.focal * tree.grid.pitch(0)
        self.near = self.radius if self.shape.near is None else self.shape.near
        eyes = prediction.eyes(np.linspace(0.0, min(seconds, AHEAD), STEPS))
        count = find_regions(
            tree.roots, tree.children, tree.levels, tree.boxes, np.ascontiguousarray(eyes),
            self.radius / 2**self.shape.bias, self.near, self._room[0], self._room[1],
        )  # fmt: skip
        self.cells = self._room[1, :count].copy()
        return np.asarray(tree.bounds[self.cells])


@dataclass(frozen=True, slots=True)
class _Steps:
    """What a viewer lacks of a cell, as far as each step."""

    of: CellValues
    items: list[SentCell]
    sizes: list[int]
    parts: list[int]
    """That are shown with each."""
    shown: int
    """Parts that are shown now."""


class Pictures:
    """Pictures of cells and of those above them, and geometry of near leaves, for one viewer.

    A cell is offered by the first of the tiles that are picked for where it is seen from, as far as some shares of what
    all of them show; a viewer draws of it what is there, before what is above it.
    """

    def __init__(self, regions: Regions) -> None:
        self.held: set[str] = set()
        """Keys of what the viewer has."""
        self._regions = regions
        self._items: list[SentCell] = []
        self._there = Offers.none(0)
        self._steps: dict[tuple[str, bool, int], _Steps] = {}
        """Of the cells of the last offers, as long as nothing of them is taken or dropped."""

    def offers(self, outlook: Outlook) -> Offers:
        """What is not there yet of the cells that will be seen, and of all above them."""
        regions, tree = self._regions, self._regions.tree
        away = _distances(tree.bounds[regions.cells], outlook.eyes)
        cells, objects = self._chains(outlook)
        order = np.argsort(cells, kind="stable")
        cells, objects = cells[order], objects[order]
        inner = INSIDE * np.linalg.norm(tree.bounds[regions.cells, 3:] - tree.bounds[regions.cells, :3], axis=1)
        apart = outlook.focal * tree.errors[cells, None] / np.maximum(away, inner[:, None] + 1e-9)[objects]
        leaves = np.flatnonzero(tree.has_geometry[regions.cells] & (away < regions.near).any(axis=1))
        leaves = leaves[outlook.visible[leaves].any(axis=1)]
        near = (away[leaves] < regions.near).astype(np.float32)
        first, begins = np.unique(cells, return_index=True)
        values = [self._pictures(int(cell), outlook.eyes[0]) for cell in first]
        geometry = [tree.geometry(int(regions.cells[leaf])) for leaf in leaves]
        firsts = np.concatenate([begins, len(cells) + np.arange(len(leaves) + 1)])
        uses, accuracy = [objects, leaves], [picture_accuracy(apart).astype(np.float32), near]
        if together := self._together(geometry):
            geometry.append(together)
            firsts = np.append(firsts, len(cells) + 2 * len(leaves))
            uses.append(leaves)
            accuracy.append(near)
        return self._split(values + geometry, firsts, np.concatenate(uses).astype(np.int32), np.concatenate(accuracy))

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """By the best that is there, as of the last offers."""
        there = self._there
        assert there.parts is not None
        parts = np.repeat(there.parts, np.diff(there.firsts))
        for part in range(len(SHARES)):
            own = parts > part
            np.maximum.at(best[:, :, part], there.objects[own], there.accuracy[own])

    def take(self, item: int) -> SentCell:
        """What to send."""
        found = self._items[item]
        found = replace(found, keys=tuple(key for key in found.keys if key not in self.held))
        self.held.update(found.keys)
        # Meshes are shared by leaves.
        stale = [known for known in self._steps if known[:2] == (found.cell, found.is_geometry) or known[1]]
        for known in stale:
            self._steps[known] = self._steps_of(self._steps[known].of)
        return found

    def is_useful(self, item: SentCell) -> bool:
        """Whether it would still show something, as of the last offers."""
        return any(known[:2] == (item.cell, item.is_geometry) for known in self._steps)

    def keep(self, keys: Collection[str]) -> None:
        """The viewer has these and nothing else."""
        self.held = set(keys)
        self._steps = {}

    def hold(self, keys: Collection[str]) -> None:
        """The viewer has these as well."""
        self.held.update(keys)
        self._steps = {}

    def drop(self, keys: Collection[str]) -> None:
        """The viewer has these no longer."""
        self.held.difference_update(keys)
        self._steps = {}

    def _chains(self, outlook: Outlook) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs of a cell with pictures and an object that it would show: the object's own cell, or one above it."""
        tree = self._regions.tree
        objects = np.flatnonzero(outlook.visible.any(axis=1))
        cells = self._regions.cells[objects].astype(np.int64)
        pairs = []
        while len(cells):
            shows = tree.has_pictures[cells]
            pairs.append((cells[shows], objects[shows]))
            above = tree.parents[cells]
            objects, cells = objects[above >= 0], above[above >= 0].astype(np.int64)
        if not pairs:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        return np.concatenate([one for one, _ in pairs]), np.concatenate([other for _, other in pairs])

    def _together(self, geometry: list[CellValues]) -> CellValues | None:
        """Geometry of all near leaves as one, where they lack the same meshes: each would pay for those alone."""
        lacks = [
            (key, size)
            for one in geometry
            for key, size in zip(one.keys, one.sizes, strict=True)
            if key not in self.held
        ]
        once = dict(lacks)
        if len(once) == len(lacks):
            return None
        return CellValues(
            geometry[0].cell, True, tuple(once), tuple(once.values()), (), (len(once),), leaves=len(geometry)
        )

    def _split(
        self,
        values: list[CellValues],
        firsts: NDArray[np.int64],
        objects: NDArray[np.int32],
        accuracy: NDArray[np.float32],
    ) -> Offers:
        """Offers what is not complete, in steps; and takes note of what the viewer shows by what it has."""
        whole = Offers(np.zeros(len(values), np.int64), firsts, objects, accuracy)
        before, self._steps = self._steps, {}
        for one in values:
            name = one.cell, one.is_geometry, one.leaves
            known = before.get(name)
            # Most cells are as they were: without this a look at 161 cells took 3 ms.
            self._steps[name] = known if known and known.of is one else self._steps_of(one)
        steps = list(self._steps.values())
        self._items = [item for one in steps for item in one.items]
        there = np.array([one.shown for one in steps], np.int32)
        held = np.flatnonzero(there)
        self._there = whole.split(held, there[held])
        of = np.repeat(np.arange(len(steps)), [len(one.items) for one in steps])
        offers = whole.split(of, np.array([part for one in steps for part in one.parts], np.int32))
        return replace(offers, sizes=np.array([size for one in steps for size in one.sizes], np.int64))

    def _steps_of(self, one: CellValues) -> _Steps:
        lacks = [n for n, key in enumerate(one.keys) if key not in self.held]
        shown = one.shown_by(self.held)
        found = _Steps(one, [], [], [], parts_of(shown))
        for end in one.steps:
            own = [n for n in lacks if n < end]
            if not own or (found.items and len(own) == len(found.items[-1].keys)):
                continue
            found.items.append(SentCell(one.cell, one.is_geometry, tuple(one.keys[n] for n in own)))
            found.sizes.append(sum(one.sizes[n] for n in own))
            adds = 1.0 if len(own) == len(lacks) else sum(one.shares[n] for n in own)
            found.parts.append(parts_of(shown + adds))
        return found

    def _pictures(self, cell: int, eye: Floats) -> CellValues:
        tree = self._regions.tree
        return tree.pictures(
            cell, view_bin(tree.bounds[cell].reshape(2, 3).mean(0), eye), self._regions.shape.least_gain
        )


def _distances(boxes: Floats, eyes: Floats) -> Floats:
    """(n, k) metres from boxes, (n, 6), to eyes, (k, 3); 0 inside."""
    lower, upper = boxes[:, None, :3], boxes[:, None, 3:]
    gaps = np.maximum(np.maximum(lower - eyes, eyes - upper), 0.0)
    return np.asarray(np.sqrt((gaps * gaps).sum(axis=2)))
