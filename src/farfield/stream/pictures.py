"""Cells of a world, by their pictures and as geometry, as things to send (OV 4.2 as a kind of BEN 4)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.regions import find_regions
from farfield.octree.cut import view_bin
from farfield.stream.accuracy import picture_accuracy
from farfield.stream.motion import Prediction
from farfield.stream.offers import Offers
from farfield.stream.outlook import Outlook
from farfield.stream.tree import CellTree
from farfield.world.keys import geometry_key, mesh_key, orthoview_key

Floats = NDArray[np.float64]
AHEAD = 8.0
"""Seconds for which cells are made out fine enough for where the viewer will be."""
STEPS = 4
"""Places on that way."""
DEFAULT_LEAST_GAIN = 10.0
LAYERS = 2


@dataclass(frozen=True, slots=True)
class SentCell:
    """What is to be sent: values of a cell, in this order."""

    cell: str
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


class Pictures:
    """Pictures of cells and of those above them, and geometry of near leaves, for one viewer.

    A cell is shown once all the tiles that are picked for where it is seen from are there, as viewers do.
    """

    def __init__(self, regions: Regions) -> None:
        self.held: set[str] = set()
        """Keys of what the viewer has."""
        self._regions = regions
        self._items: list[SentCell] = []
        self._there = Offers.none(0)
        self._picked: dict[tuple[int, int], tuple[tuple[str, int], ...]] = {}

    def offers(self, outlook: Outlook) -> Offers:
        """What is not there yet of the cells that will be seen, and of all above them."""
        regions, tree = self._regions, self._regions.tree
        away = _distances(tree.bounds[regions.cells], outlook.eyes)
        focal = outlook.focal
        cells, objects = self._chains(outlook)
        order = np.argsort(cells, kind="stable")
        cells, objects = cells[order], objects[order]
        sharp = focal * tree.errors[cells, None] / np.maximum(away[objects], 1e-9)
        leaves = np.flatnonzero(tree.has_geometry[regions.cells] & (away < regions.near).any(axis=1))
        leaves = leaves[outlook.visible[leaves].any(axis=1)]
        near = (away[leaves] < regions.near).astype(np.float32)
        first, ends = np.unique(cells, return_index=True)
        pictures = [self._pictures(int(cell), outlook.eyes[0]) for cell in first]
        found = [SentCell(tree.entries[cell].key, False, ()) for cell in first]
        lists = pictures + [self._geometry(int(regions.cells[leaf])) for leaf in leaves]
        found += [SentCell(tree.entries[int(regions.cells[leaf])].key, True, ()) for leaf in leaves]
        return self._split(
            found,
            lists,
            np.concatenate([ends, len(cells) + np.arange(len(leaves) + 1)]),
            np.concatenate([objects, leaves]).astype(np.int32),
            np.concatenate([picture_accuracy(sharp).astype(np.float32), near]),
        )

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """By the best that is there, as of the last offers."""
        np.maximum.at(best, self._there.objects, self._there.accuracy)

    def take(self, item: int) -> SentCell:
        """What to send."""
        found = self._items[item]
        self.held.update(found.keys)
        return found

    def keep(self, keys: Collection[str]) -> None:
        """The viewer has these and nothing else."""
        self.held = set(keys)

    def drop(self, keys: Collection[str]) -> None:
        """The viewer has these no longer."""
        self.held.difference_update(keys)

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

    def _split(
        self,
        items: list[SentCell],
        lists: list[tuple[tuple[str, int], ...]],
        firsts: NDArray[np.int64],
        objects: NDArray[np.int32],
        accuracy: NDArray[np.float32],
    ) -> Offers:
        """Offers what is not complete; the others are what the viewer shows."""
        absent = [[(key, size) for key, size in values if key not in self.held] for values in lists]
        lacks = np.array([len(values) > 0 for values in absent], bool)
        every = Offers(np.zeros(len(items), np.int64), firsts, objects, accuracy)
        self._there = every.only(np.flatnonzero(~lacks))
        self._items = [
            SentCell(item.cell, item.is_geometry, tuple(key for key, _ in values))
            for item, values in zip(items, absent, strict=True)
            if values
        ]
        sizes = [sum(size for _, size in values) for values in absent if values]
        chosen = every.only(np.flatnonzero(lacks))
        return Offers(np.array(sizes, np.int64), chosen.firsts, chosen.objects, chosen.accuracy)

    def _pictures(self, cell: int, eye: Floats) -> tuple[tuple[str, int], ...]:
        """Keys and bytes of the tiles that a cell is drawn from, best first (spec/drawing.md, Which tiles)."""
        entry = self._regions.tree.entries[cell]
        place = cell, view_bin(self._regions.tree.bounds[cell].reshape(2, 3).mean(0), eye)
        if place not in self._picked:
            numbers = (
                [
                    number
                    for number, gain in entry.picks_from(place[1])
                    if gain >= self._regions.shape.least_gain and entry.tiles[number][1] < LAYERS
                ]
                or [number for number, _ in entry.picks_from(place[1])[:1]]
                or list(range(len(entry.tiles)))
            )
            tiles = [entry.tiles[number] for number in numbers]
            self._picked[place] = tuple(
                (orthoview_key(entry.cell, direction, layer, entry.hash), size) for direction, layer, size in tiles
            )
        return self._picked[place]

    def _geometry(self, cell: int) -> tuple[tuple[str, int], ...]:
        """Keys and bytes of what a leaf is drawn from as triangles."""
        entry = self._regions.tree.entries[cell]
        near = entry.geometry
        assert near is not None
        own = (geometry_key(entry.cell, near.hash), near.bytes)
        return (own, *((mesh_key(name), size) for name, size in near.meshes))


def _distances(boxes: Floats, eyes: Floats) -> Floats:
    """(n, k) metres from boxes, (n, 6), to eyes, (k, 3); 0 inside."""
    lower, upper = boxes[:, None, :3], boxes[:, None, 3:]
    gaps = np.maximum(np.maximum(lower - eyes, eyes - upper), 0.0)
    return np.asarray(np.sqrt((gaps * gaps).sum(axis=2)))
