"""Cells of a world, by their pictures and as geometry, as things to send (OV 4.2 as a kind of BEN 4)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.regions import find_regions
from farfield.octree.cut import view_bins
from farfield.stream.accuracy import level_accuracy, loss_from, picture_accuracy
from farfield.stream.boards import board_offers
from farfield.stream.motion import Prediction
from farfield.stream.offers import SHARES, Offers, parts_of
from farfield.stream.outlook import Outlook
from farfield.stream.tree import NO_FORMS, NONE, REACH, CellTree, CellValues
from farfield.world.index import MESH_FARTHEST

Floats = NDArray[np.float64]
AHEAD = 8.0
"""Seconds for which cells are made out fine enough for where the viewer will be."""
STEPS = 4
"""Places on that way."""
INSIDE = 1 / 16
"""Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it."""
TOGETHER = 64
"""Cells that are offered as one, at most: by then each pays little for what they share, and more take long to list."""
SHARP = 1.0
"""Pixels of the screen for one of a picture, up to which instances are seen in it as well as all else is. In a coarser
one they are seen the less, in proportion (BEN 4.1): what is lost of a cell by it (CellEntry.losses) is mostly that of
the ground around them. With 2 the thesis' quality in the garden at 20 kB/s is .86 instead of .90."""
FINE = 0.5
"""How much of the accuracy of a mesh's level is that of the thesis, by the size of its faces; the rest is by the error
that the bake measured. Pixel by pixel a thinned tree is unlike the full one nearly everywhere, and still a tree."""
OBJECTS = 4.0
"""Importance of an instance beside that of a cell (BEN 4.3). More is better by the thesis' quality and worse by FLIP,
as the ground comes later. At 2 kB/s in the terrain: .44 and .29 with 1, .59 and .32 with 2, .65 and .39 with 4, .68 and
.46 with 8; in the garden .63 and .16 with 4, .68 and .17 with 8, and at 20 kB/s .953 and .034, .969 and .035."""
DEFAULT_LEAST_GAIN = 10.0


@dataclass(frozen=True, slots=True)
class SentCell:
    """What is to be sent: values of a cell, in this order."""

    cell: str
    """The first, of several leaves whose geometry shares meshes; of instances their mesh."""
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
    far_geometry: bool = True
    """Cells farther away are geometry too, in place of their pictures, where that shows more for its bytes."""


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


@dataclass(frozen=True, slots=True)
class _Geometry:
    """Geometry of near leaves, one row each."""

    values: list[CellValues]
    uses: list[list[int]]
    accuracy: list[Floats]
    """(uses, k) of each."""

    def add(self, value: CellValues, uses: list[int], accuracy: Floats) -> None:
        """A row."""
        self.values.append(value)
        self.uses.append(uses)
        self.accuracy.append(accuracy)


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
        whole = self._whole(outlook, away, dict(zip(first.tolist(), values, strict=True)))
        found = self._geometry(outlook, away, widths, whole)
        self._add_together(found, outlook)
        rows = self._placed(outlook, whole)
        self._add_meshes(found, rows, away, widths)
        self._add_boards(found, rows, outlook, away, widths)
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
        shared = {key for key in sent.keys if not key.startswith("geometry/")}
        cells = {key[len("geometry/") :].rpartition("-")[0] for key in sent.keys if key not in shared}
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

    def _whole(self, outlook: Outlook, away: Floats, pictures: dict[int, CellValues]) -> NDArray[np.bool_]:
        """(n,) cells that are not near, and all of whose pictures are there: they are not sent as geometry as well."""
        regions = self._regions
        found = np.zeros(len(regions.cells), bool)
        for row in np.flatnonzero(outlook.visible[: len(found)].any(axis=1) & ~self._near(away).any(axis=1)).tolist():
            found[row] = self._is_whole(pictures.get(int(regions.cells[row])))
        return found

    def _near(self, away: Floats) -> NDArray[np.bool_]:
        """(n, k) whether a cell is a near leaf in an interval."""
        regions = self._regions
        is_near = away[: len(regions.cells)] < regions.near
        return np.asarray(is_near & regions.tree.has_geometry[regions.cells, None])

    def _geometry(self, outlook: Outlook, away: Floats, widths: Floats, whole: NDArray[np.bool_]) -> _Geometry:
        """Forms of near leaves, and of what is farther as long as its pictures are not there.

        away, widths: (n + m, k) metres to each object, and of a pixel there, in each interval. whole: see `_whole`.
        """
        regions, tree = self._regions, self._regions.tree
        found = _Geometry([], [], [])
        if regions.near <= 0:
            return found
        count, afar = len(regions.cells), regions.shape.far_geometry
        near, within = self._near(away), away[:count] < REACH * tree.grid.leaf_size
        is_near = np.asarray(near.any(axis=1))
        seen = np.flatnonzero(outlook.visible[:count].any(axis=1) & (is_near | afar))
        each = [(row, tree.forms(int(regions.cells[row]))) for row in seen.tolist()]
        values = [value for _, forms in each for value in forms.values]
        rows = np.repeat(seen, [len(forms.values) for _, forms in each])
        all_forms = [NO_FORMS, *(forms for _, forms in each)]
        told, farthest, far, merged = (
            np.concatenate([getattr(forms, name) for forms in all_forms])
            for name in ("errors", "farthest", "far", "is_merged")
        )
        errors = tree.errors_at(told, widths[rows], farthest[:, None])
        may_be = near[rows] | ((within[rows] | merged[:, None]) & (far & afar)[:, None])
        accuracy = np.where(may_be, 1 - errors, 0.0)
        for n in np.flatnonzero(accuracy.any(axis=1)).tolist():
            row, value = rows[n], values[n]
            # What is placed in a cell that is farther comes first, level by level: the full meshes of 16 leaves with
            # statues are 100 kB, for which nothing else was sent in 5 s.
            comes = not whole[row] and (is_near[row] or value.listed <= self.held)
            if comes or self._holds(value):
                found.add(value, [row], accuracy[n : n + 1])
        if afar:
            self._add_merged(found, seen[~whole[seen]], widths)
        return found

    def _add_merged(self, geometry: _Geometry, rows: NDArray[np.int64], widths: Floats) -> None:
        """Forms of the cells above those that will be seen, and are not there: they stand in for all below them."""
        regions, tree = self._regions, self._regions.tree
        below: dict[int, list[int]] = {}
        for row in rows.tolist():
            above = int(tree.parents[regions.cells[row]])
            while above != NONE:
                if tree.has_merged[above]:
                    below.setdefault(above, []).append(row)
                above = int(tree.parents[above])
        for above, own in sorted(below.items()):
            forms = tree.merged(above)
            for n, value in enumerate(forms.values):
                told = np.broadcast_to(forms.errors[n], (len(own), forms.errors.shape[1]))
                geometry.add(value, own, 1 - tree.errors_at(told, widths[own], float(forms.farthest[n])))

    def _holds(self, value: CellValues) -> bool:
        return all(key in self.held for key in value.keys)

    def _is_whole(self, value: CellValues | None) -> bool:
        """Whether all of a cell's pictures are there."""
        if value is None:
            return False
        known = self._steps.get((value.cell, False, 1, 0))
        shown = known.shown if known and known.of is value else parts_of(value.shown_by(self.held))
        return shown == len(SHARES)

    def _add_together(self, geometry: _Geometry, outlook: Outlook) -> None:
        """Geometry of several cells as one, level by level, where they lack the same: each alone would pay for it.

        Of those that are seen largest, then of twice as many, up to TOGETHER.
        """
        pixels = outlook.visible.sum(axis=1, dtype=np.float64)
        levels: dict[int, dict[int, frozenset[str]]] = {}
        for n, value in enumerate(geometry.values):
            if lacks := value.refers - self.held:
                levels.setdefault(value.level, {})[n] = lacks
        for level, each in sorted(levels.items()):
            own = list(each)
            if len(set().union(*each.values())) == sum(map(len, each.values())):
                continue
            order = np.argsort(-pixels[[geometry.uses[n][0] for n in own]], kind="stable")[:TOGETHER].tolist()
            together: dict[str, int] = {}
            for taken, place in enumerate(order, 1):
                together.update(self._lacking(geometry.values[own[place]]))
                if taken == 1 or (taken < len(order) and taken & (taken - 1)):
                    continue
                chosen = [own[n] for n in order[:taken]]
                keys, sizes, cell = tuple(together), tuple(together.values()), geometry.values[chosen[0]].cell
                value = CellValues(cell, True, keys, sizes, (), (len(keys),), leaves=taken, level=level)
                uses = [use for n in chosen for use in geometry.uses[n]]
                geometry.add(value, uses, np.concatenate([geometry.accuracy[n] for n in chosen]))

    def _placed(self, outlook: Outlook, whole: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Rows of the regions' instances that will be seen, by mesh.

        Where all pictures are there, instances are drawn by these.
        """
        regions = self._regions
        rows = np.flatnonzero(outlook.visible[len(regions.cells) :].any(axis=1) & ~whole[regions.homes])
        return rows[np.argsort(regions.tree.instances.mesh[regions.instances[rows]], kind="stable")]

    def _add_meshes(self, geometry: _Geometry, rows: NDArray[np.int64], away: Floats, widths: Floats) -> None:
        """Levels of the meshes of instances that will be seen: sent once, placed many times."""
        regions, tree = self._regions, self._regions.tree
        count, listed = len(regions.cells), tree.instances
        meshes, homes, uses = listed.mesh[regions.instances[rows]], regions.homes[rows], count + rows
        near = self._near(away)[homes]
        finest = np.array([tree.finest_afar(cell) for cell in regions.cells[homes].tolist()], np.int64)
        starts, ends = _runs(meshes)
        last = listed.levels[meshes] - 1
        areas = listed.sides[regions.instances[rows], None] / widths[uses] ** 2
        for level in range(int(last.max(initial=-1)) + 1):
            errors = tree.errors_at(listed.told[meshes, level], widths[uses], MESH_FARTHEST)
            far = regions.shape.far_geometry & (finest != NONE) & (level >= np.minimum(finest, last))
            fine = level_accuracy(areas, listed.counts[meshes, level, None], listed.counts[meshes, 0, None])
            accuracy = np.where(near | far[:, None], (1 - FINE) * (1 - errors) + FINE * fine, 0.0)
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
                if level <= last[start]:
                    value = listed.forms[meshes[start]].values[level]
                    geometry.add(value, uses[start:end].tolist(), accuracy[start:end])

    def _add_boards(
        self, geometry: _Geometry, rows: NDArray[np.int64], outlook: Outlook, away: Floats, widths: Floats
    ) -> None:
        """Images of instances that will be seen."""
        regions, tree = self._regions, self._regions.tree
        uses = len(regions.cells) + rows
        drawn = self._near(away)[regions.homes[rows]] | regions.shape.far_geometry
        instances = regions.instances[rows]
        for one in board_offers(tree, instances, uses, outlook, drawn, widths[uses], self.held, FINE):
            geometry.add(*one)

    def _lacking(self, value: CellValues) -> dict[str, int]:
        """Key and bytes of what the viewer lacks of it."""
        return {key: size for key, size in zip(value.keys, value.sizes, strict=True) if key not in self.held}

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


def _runs(meshes: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each run of the same begins and ends."""
    starts = np.flatnonzero(np.append(True, meshes[1:] != meshes[:-1])) if len(meshes) else np.zeros(0, np.int64)
    return starts, np.append(starts[1:], len(meshes))[: len(starts)]


def _distances(boxes: Floats, eyes: Floats) -> Floats:
    """(n, k) metres from boxes, (n, 6), to eyes, (k, 3); 0 inside."""
    lower, upper = boxes[:, None, :3], boxes[:, None, 3:]
    gaps = np.maximum(np.maximum(lower - eyes, eyes - upper), 0.0)
    return np.asarray(np.sqrt((gaps * gaps).sum(axis=2)))
