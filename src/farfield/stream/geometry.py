"""Geometry as things to send: forms of cells, and levels and images of the meshes placed in them (BEN 4)."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.stream.accuracy import level_accuracy, picture_accuracy
from farfield.stream.boards import board_offers
from farfield.stream.forms import NO_FORMS, CellValues, merged_accuracy
from farfield.stream.outlook import Outlook
from farfield.stream.regions import Regions
from farfield.stream.tree import NONE, REACH
from farfield.world.index import MESH_FARTHEST

Floats = NDArray[np.float64]
TOGETHER = 64
"""Cells that are offered as one, at most: by then each pays little for what they share, and more take long to list."""
MORE = 0.05
"""Accuracy by which geometry must show more than a cell's pictures that are all there, to be sent as well."""
WORTH = 0.1
"""Share of `least_gain` that geometry must add: it is sent last. All of it took 4 dB from Tokyo seen from 16 r."""
WORTH_READING = 0.005
"""Share of what is seen of cells that a cell's pictures err by, from which on a viewer reads the index of leaves below
that it does not know (spec/stream.md): geometry of others would come in vain. All of Tokyo by BlockMaps, whose bare
ground errs a little, took 2.3 MB for 1.3."""
FINE = 0.5
"""How much of the accuracy of a mesh's level is that of the thesis, by the size of its faces; the rest is by the error
that the bake measured. Pixel by pixel a thinned tree is unlike the full one nearly everywhere, and still a tree."""


@dataclass(frozen=True, slots=True)
class GeometryOffers:
    """What could be sent as geometry, a row each, and the objects that it would show."""

    values: list[CellValues] = field(default_factory=list)
    uses: list[list[int]] = field(default_factory=list)
    accuracy: list[Floats] = field(default_factory=list)
    """(uses, k) of each."""

    def add(self, value: CellValues, uses: list[int], accuracy: Floats) -> None:
        """A row."""
        self.values.append(value)
        self.uses.append(uses)
        self.accuracy.append(accuracy)


@dataclass(frozen=True, slots=True)
class GeometryKind:
    """All that may be geometry, as it will be seen once."""

    regions: Regions
    outlook: Outlook
    away: Floats
    """(n + m, k) metres to each object in each interval."""
    widths: Floats
    """(n + m, k) metres that a pixel is wide there."""
    whole: NDArray[np.bool_]
    """(n,) cells that are not near, and all of whose pictures are there."""
    costs: Floats
    """(n,) bytes of all pictures of a cell; inf of near ones, and of those that have none."""
    held: AbstractSet[str]
    """Keys of what the viewer has."""
    found: GeometryOffers = field(default_factory=GeometryOffers)

    def offers(self) -> GeometryOffers:
        """Forms of cells, of those above them, and meshes and images of instances."""
        if self.regions.near > 0:
            self._add_cells()
            self._add_together()
            rows = self._placed()
            self._add_meshes(rows)
            self._add_boards(rows)
        return self.found

    def _add_cells(self) -> None:
        """Forms of near leaves, and of what is farther where they are fewer bytes than its pictures, or worth theirs.

        Those pictures come anyway: over a link so fast that all of a look is sent before the next, three times the
        bytes of a view of Tokyo were geometry for pictures of a tenth of its size.
        """
        regions, tree, outlook = self.regions, self.regions.tree, self.outlook
        count, afar = len(regions.cells), regions.shape.far_geometry
        near, within = regions.is_near(self.away), self.away[:count] < REACH * tree.grid.leaf_size
        is_near = np.asarray(near.any(axis=1))
        seen = np.flatnonzero(outlook.visible[:count].any(axis=1) & (is_near | afar))
        each = [tree.forms(cell) for cell in regions.cells[seen].tolist()]
        values = [value for forms in each for value in forms.values]
        rows = np.repeat(seen, [len(forms.values) for forms in each])
        told, far, merged = (
            np.concatenate([getattr(forms, name) for forms in (NO_FORMS, *each)])
            for name in ("errors", "far", "is_merged")
        )
        of_leaves = 1 - tree.errors_at(told, self.widths[rows])
        pitch = tree.errors[regions.cells[rows], None]
        shown = np.where(merged[:, None], merged_accuracy(told, pitch, self.widths[rows]), of_leaves)
        may_be = near[rows] | ((within[rows] | merged[:, None]) & (far & afar)[:, None])
        accuracy = np.where(may_be, shown, 0.0)
        pictures = picture_accuracy(
            tree.told[regions.cells, None], tree.errors[regions.cells, None] / self.widths[:count]
        )
        visible = outlook.visible[:count, 0]
        is_worth_reading = self.whole & ((1 - pictures[:, 0]) * visible >= WORTH_READING * visible.sum())
        is_read = is_worth_reading | ~tree.index_apart[regions.cells]
        for n in np.flatnonzero(accuracy.any(axis=1)).tolist():
            row, value = rows[n], values[n]
            own = sum(size for key, size in zip(value.keys, value.sizes, strict=True) if key not in value.refers)
            # As a tile does, it has to add enough for each kilobyte of its own, what others refer to left out.
            gain = accuracy[n] - pictures[row]
            adds = gain * outlook.visible[row] >= WORTH * regions.shape.least_gain * own / 1000
            is_worth = bool(((gain >= MORE) & adds).any())
            if not (merged[n] or is_read[row]):
                comes = False
            elif self.whole[row]:
                # Instances are seen by these pictures, and would be missed.
                comes = is_worth and not (merged[n] and len(tree.instances_below(int(regions.cells[row]))))
            else:
                # What is placed in a cell that is farther comes first, level by level: the full meshes of 16 leaves
                # with statues are 100 kB, for which nothing else was sent in 5 s.
                comes = is_near[row] or (value.listed <= self.held and (is_worth or own <= self.costs[row]))
            if comes or all(key in self.held for key in value.keys):
                self.found.add(value, [row], accuracy[n : n + 1])
        if afar:
            self._add_merged(seen[~self.whole[seen]])

    def _add_merged(self, rows: NDArray[np.int64]) -> None:
        """Forms of the cells above some that are not there: they stand in for all below them."""
        tree = self.regions.tree
        below: dict[int, list[int]] = {}
        for row in rows.tolist():
            above = int(tree.parents[self.regions.cells[row]])
            while above != NONE:
                if tree.has_merged[above]:
                    below.setdefault(above, []).append(row)
                above = int(tree.parents[above])
        for above, own in sorted(below.items()):
            forms = tree.merged(above)
            for value, told in zip(forms.values, forms.errors, strict=True):
                self.found.add(value, own, merged_accuracy(told, tree.errors[above], self.widths[own]))

    def _add_together(self) -> None:
        """Geometry of several cells as one, level by level, where they lack the same: each alone would pay for it.

        Of those that are seen largest, then of twice as many, up to TOGETHER.
        """
        found, pixels = self.found, self.outlook.visible.sum(axis=1, dtype=np.float64)
        levels: dict[int, dict[int, frozenset[str]]] = {}
        for n, value in enumerate(found.values):
            if lacks := value.refers - self.held:
                levels.setdefault(value.level, {})[n] = lacks
        for level, each in sorted(levels.items()):
            own = list(each)
            if len(set().union(*each.values())) == sum(map(len, each.values())):
                continue
            order = np.argsort(-pixels[[found.uses[n][0] for n in own]], kind="stable")[:TOGETHER].tolist()
            together: dict[str, int] = {}
            for taken, place in enumerate(order, 1):
                together.update(self._lacking(found.values[own[place]]))
                if taken == 1 or (taken < len(order) and taken & (taken - 1)):
                    continue
                chosen = [own[n] for n in order[:taken]]
                keys, sizes, cell = tuple(together), tuple(together.values()), found.values[chosen[0]].cell
                value = CellValues(cell, True, keys, sizes, (), (len(keys),), leaves=taken, level=level)
                uses = [use for n in chosen for use in found.uses[n]]
                found.add(value, uses, np.concatenate([found.accuracy[n] for n in chosen]))

    def _placed(self) -> NDArray[np.int64]:
        """Rows of the regions' instances that will be seen, by mesh.

        Where all pictures are there, instances are drawn by these.
        """
        regions = self.regions
        is_seen = self.outlook.visible[len(regions.cells) :].any(axis=1)
        rows = np.flatnonzero(is_seen & ~self.whole[regions.homes])
        return rows[np.argsort(regions.tree.instances.mesh[regions.instances[rows]], kind="stable")]

    def _add_meshes(self, rows: NDArray[np.int64]) -> None:
        """Levels of the meshes of instances that will be seen: sent once, placed many times."""
        regions, tree = self.regions, self.regions.tree
        listed = tree.instances
        meshes, homes = listed.mesh[regions.instances[rows]], regions.homes[rows]
        uses = len(regions.cells) + rows
        widths, near = self.widths[uses], regions.is_near(self.away)[homes]
        finest = np.array([tree.finest_afar(cell) for cell in regions.cells[homes].tolist()], np.int64)
        starts, ends = _runs(meshes)
        last = listed.levels[meshes] - 1
        areas = listed.sides[regions.instances[rows], None] / widths**2
        for level in range(int(last.max(initial=-1)) + 1):
            errors = tree.errors_at(listed.told[meshes, level], widths, MESH_FARTHEST)
            far = regions.shape.far_geometry & (finest != NONE) & (level >= np.minimum(finest, last))
            fine = level_accuracy(areas, listed.counts[meshes, level, None], listed.counts[meshes, 0, None])
            accuracy = np.where(near | far[:, None], (1 - FINE) * (1 - errors) + FINE * fine, 0.0)
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
                if level <= last[start]:
                    value = listed.forms[meshes[start]].values[level]
                    self.found.add(value, uses[start:end].tolist(), accuracy[start:end])

    def _add_boards(self, rows: NDArray[np.int64]) -> None:
        """Images of instances that will be seen."""
        regions, uses = self.regions, len(self.regions.cells) + rows
        drawn = regions.is_near(self.away)[regions.homes[rows]] | regions.shape.far_geometry
        instances, widths = regions.instances[rows], self.widths[uses]
        dynamic = regions.shape.dynamic_impostors
        for one in board_offers(regions.tree, instances, uses, self.outlook, drawn, widths, self.held, FINE, dynamic):
            self.found.add(*one)

    def _lacking(self, value: CellValues) -> dict[str, int]:
        """Key and bytes of what the viewer lacks of it."""
        return {key: size for key, size in zip(value.keys, value.sizes, strict=True) if key not in self.held}


def _runs(meshes: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each run of the same begins and ends."""
    starts = np.flatnonzero(np.append(True, meshes[1:] != meshes[:-1])) if len(meshes) else np.zeros(0, np.int64)
    return starts, np.append(starts[1:], len(meshes))[: len(starts)]
