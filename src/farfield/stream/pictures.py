"""Cells of a world, by their pictures and as geometry, as things to send (OV 4.2 as a kind of BEN 4)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.octree.cut import view_bins
from farfield.stream.accuracy import loss_from, picture_accuracy
from farfield.stream.forms import CellValues
from farfield.stream.geometry import GeometryKind
from farfield.stream.offers import SHARES, Offers, parts_of
from farfield.stream.outlook import Outlook
from farfield.stream.regions import Regions, pixel_width

Floats = NDArray[np.float64]
SHARP = 1.0
"""Pixels of the screen for one of a picture, up to which instances are seen in it as well as all else is. In a coarser
one they are seen the less, in proportion (BEN 4.1): what is lost of a cell by it (CellEntry.losses) is mostly that of
the ground around them. With 2 the thesis' quality in the garden at 20 kB/s is .86 instead of .90. Were the error that
is told of pictures to count half, as that of meshes and boards does, a forest from 16 r would be at 21.6 dB after 8 MB
instead of 24.2, and a city of unique facades from r at 24.8 after 2 MB instead of 21.6."""


@dataclass(frozen=True, slots=True)
class SentCell:
    """What is to be sent: values of a cell, in this order."""

    cell: str
    """The first, of several leaves whose geometry shares meshes; of instances their mesh."""
    is_geometry: bool
    keys: tuple[str, ...]


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
        self._steps: dict[tuple[str, bool, int, int], _Steps] = {}
        """Of the cells of the last offers, as long as nothing of them is taken or dropped."""
        self._useful: set[tuple[str, bool]] = set()
        """The cells of the last offers, by pictures and as geometry."""

    def offers(self, outlook: Outlook) -> Offers:
        """What is not there yet of the cells that will be seen, and of all above them."""
        bounds = self._regions.bounds
        away = _distances(bounds, outlook.eyes)
        widths = pixel_width(bounds[:, None], away, outlook.focal)
        cells, objects, accuracy = self._chains(outlook, widths)
        order = np.argsort(cells, kind="stable")
        cells, objects, accuracy = cells[order], objects[order], accuracy[order]
        first, begins = np.unique(cells, return_index=True)
        values = self._values(first, outlook.eyes[0])
        counts = np.diff(np.append(begins, len(cells)))
        whole, costs = self._pictured(outlook, away, dict(zip(first.tolist(), values, strict=True)))
        found = GeometryKind(self._regions, outlook, away, widths, whole, costs, self.held).offers()
        uses = np.array([use for own in found.uses for use in own], np.int32)
        near_accuracy = np.concatenate([np.zeros((0, len(outlook.eyes))), *found.accuracy])
        return self._split(
            values + found.values,
            np.cumsum([0, *counts, *map(len, found.uses)], dtype=np.int64),
            np.concatenate([objects.astype(np.int32), uses]),
            np.concatenate([accuracy, near_accuracy]).astype(np.float32),
        )

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
        # Listed anew by the next look: a mesh that a thousand leaves place would take 20 ms of this decision.
        for name in self._changed_by(found):
            del self._steps[name]
        return found

    def _changed_by(self, sent: SentCell) -> list[tuple[str, bool, int, int]]:
        """Names of the steps that have less to send now: of geometry also those that need the same meshes or images."""
        if not sent.is_geometry:
            return [name for name in ((sent.cell, False, 1, 0),) if name in self._steps]
        own = [key for key in sent.keys if key.startswith(("geometry/", "blockmap/"))]
        shared = set(sent.keys).difference(own)
        cells = {key.partition("/")[2].rpartition("-")[0] for key in own}
        return [
            name
            for name, steps in self._steps.items()
            if name[1] and (name[2] > 1 or name[0] in cells or name[0] == sent.cell or shared & steps.of.refers)
        ]

    def is_useful(self, item: SentCell) -> bool:
        """Whether it would still show something, as of the last offers."""
        return (item.cell, item.is_geometry) in self._useful

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

    def _chains(self, outlook: Outlook, widths: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """Pairs of a cell with pictures and an object that it would show, and (pairs, k) how well it would.

        That is the object's own cell, or that which it lies in, or one above it: from link to link something is lost.
        """
        regions, tree = self._regions, self._regions.tree
        objects = np.flatnonzero(outlook.visible.any(axis=1))
        cells = np.concatenate([regions.cells, regions.cells[regions.homes]])[objects].astype(np.int64)
        found = picture_accuracy(tree.told[cells, None], tree.errors[cells, None] / widths[objects])
        pairs = []
        while len(cells):
            shows = tree.has_pictures[cells]
            sharp = np.minimum(SHARP * widths[objects] / tree.errors[cells, None], 1.0)
            shown = np.where((objects < len(regions.cells))[:, None], found, found * sharp)
            pairs.append((cells[shows], objects[shows], shown[shows]))
            has_above = tree.parents[cells] >= 0
            losses = tree.losses[cells[has_above], None]
            cells = tree.parents[cells[has_above]].astype(np.int64)
            objects, found = objects[has_above], found[has_above]
            found = found * (1 - loss_from(losses, tree.errors[cells, None] / widths[objects]))
        if not pairs:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, len(outlook.eyes)))
        one, other, accuracy = (np.concatenate(part) for part in zip(*pairs, strict=True))
        return one, other, accuracy

    def _pictured(
        self, outlook: Outlook, away: Floats, pictures: dict[int, CellValues]
    ) -> tuple[NDArray[np.bool_], Floats]:
        """(n,) cells that are not near, and all of whose pictures are there; (n,) bytes of all of them, inf of none."""
        regions = self._regions
        whole, costs = np.zeros(len(regions.cells), bool), np.full(len(regions.cells), np.inf)
        for row in np.flatnonzero(
            outlook.visible[: len(whole)].any(axis=1) & ~regions.is_near(away).any(axis=1)
        ).tolist():
            value = pictures.get(int(regions.cells[row]))
            whole[row] = self._is_whole(value)
            costs[row] = sum(value.sizes) if value else np.inf
        return whole, costs

    def _is_whole(self, value: CellValues | None) -> bool:
        """Whether all of a cell's pictures are there."""
        if value is None:
            return False
        known = self._steps.get((value.cell, False, 1, 0))
        shown = known.shown if known and known.of is value else parts_of(value.shown_by(self.held))
        return shown == len(SHARES)

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
            name = one.cell, one.is_geometry, one.leaves, one.level
            known = before.get(name)
            # Most cells are as they were: without this a look at 161 cells took 3 ms.
            self._steps[name] = known if known and known.of is one else self._steps_of(one)
        self._useful = {(one.cell, one.is_geometry) for one in values}
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
        count, size, adds = 0, 0, shown
        for end in one.steps:
            before = count
            while count < len(lacks) and lacks[count] < end:
                size += one.sizes[lacks[count]]
                adds += 0.0 if one.is_geometry else one.shares[lacks[count]]
                count += 1
            if count == before:
                continue
            found.items.append(SentCell(one.cell, one.is_geometry, tuple(one.keys[n] for n in lacks[:count])))
            found.sizes.append(size)
            found.parts.append(len(SHARES) if count == len(lacks) else parts_of(adds))
        return found

    def _values(self, cells: NDArray[np.int64], eye: Floats) -> list[CellValues]:
        """What each cell is drawn from, seen from there."""
        tree, least_gain = self._regions.tree, self._regions.shape.least_gain
        bins = view_bins(tree.bounds[cells].reshape(-1, 2, 3).mean(axis=1), eye)
        return [tree.pictures(*one, least_gain) for one in zip(cells.tolist(), bins.tolist(), strict=True)]


def _distances(boxes: Floats, eyes: Floats) -> Floats:
    """(n, k) metres from boxes, (n, 6), to eyes, (k, 3); 0 inside."""
    lower, upper = boxes[:, None, :3], boxes[:, None, 3:]
    gaps = np.maximum(np.maximum(lower - eyes, eyes - upper), 0.0)
    return np.asarray(np.sqrt((gaps * gaps).sum(axis=2)))
