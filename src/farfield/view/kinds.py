"""What a viewer that holds some values shows a cell by: its pictures, or the geometry of all leaves below it."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.octree.cut import view_bin
from farfield.octree.grid import CellKey
from farfield.stream.accuracy import picture_accuracy
from farfield.stream.pictures import pixel_width
from farfield.stream.tree import REACH, CellTree
from farfield.world.index import CellEntry
from farfield.world.world import World


@dataclass(frozen=True, slots=True)
class PlacedInstance:
    """A shared mesh in its place."""

    mesh: str
    """Its key."""
    transform: NDArray[np.float64]
    """(3, 4) from the mesh's frame to local metres."""
    first: int
    """Object id of the mesh's object 0."""


class Kinds:
    """Chooses by what is told of either, as who sends it does (stream.pictures)."""

    def __init__(self, world: World, eye: NDArray[np.float64], focal: float, least_gain: float) -> None:
        """eye: (3,) local metres. focal: pixels of one unit at distance one."""
        self._tree = CellTree.of(world)
        self._numbers = {entry.cell: number for number, entry in enumerate(self._tree.entries)}
        self._eye, self._focal, self._least_gain = eye, focal, least_gain

    def geometry_of(self, cell: CellKey, held: Collection[str]) -> list[CellEntry]:
        """The leaves to draw in place of a cell's pictures; none: its pictures are better, or it is no geometry."""
        tree, number = self._tree, self._numbers.get(cell)
        if number is None:
            return []
        bounds, forms = tree.bounds[number], tree.forms(number)
        away = np.asarray(np.linalg.norm(np.maximum(np.maximum(bounds[:3] - self._eye, self._eye - bounds[3:]), 0.0)))
        if away >= REACH * tree.grid.leaf_size:
            return []
        width = pixel_width(bounds, away, self._focal)
        for level, value in enumerate(forms.values):
            if forms.far[level] and all(key in held for key in value.keys):
                error = float(tree.errors_at(forms.errors[level : level + 1], np.full((1, 1), width))[0, 0])
                better = 1 - error >= self._pictures(number, width, held)
                return [tree.entries[leaf] for leaf in tree.leaves_below(number)] if better else []
        return []

    def instances_of(
        self, cell: CellKey, held: Collection[str], is_near: bool, leaves: Collection[CellKey] = ()
    ) -> list[PlacedInstance]:
        """The instances in a cell whose meshes are held, each by the finest level: what shows them meanwhile.

        leaves: that are drawn as geometry; what reaches into no other ones is left out.
        """
        tree, number = self._tree, self._numbers.get(cell)
        listed = tree.instances
        found = []
        for row in [] if number is None else tree.instances_below(number).tolist():
            if leaves and self._is_within(listed.bounds[row], leaves):
                continue
            values = listed.forms[int(listed.mesh[row])].values
            mesh = next(
                (
                    one.keys[-1]
                    for one in values
                    if (is_near or tree.may_be_afar(number or 0, one.level, len(values)))
                    and all(key in held for key in one.keys)
                ),
                None,
            )
            if mesh is not None:
                found.append(PlacedInstance(mesh, listed.transforms[row], int(listed.objects[row])))
        return found

    def _is_within(self, box: NDArray[np.float64], leaves: Collection[CellKey]) -> bool:
        first, last = self._tree.grid.leaf_index(box.reshape(2, 3)).tolist()
        ranges = (range(a, b + 1) for a, b in zip(first, last, strict=True))
        return all(CellKey(0, *key) in leaves for key in itertools.product(*ranges))

    def _pictures(self, number: int, width: NDArray[np.float64], held: Collection[str]) -> float:
        """Accuracy of what is held of a cell's pictures."""
        tree = self._tree
        if not tree.has_pictures[number]:
            return 0.0
        middle = tree.bounds[number].reshape(2, 3).mean(axis=0)
        value = tree.pictures(number, view_bin(middle, self._eye), self._least_gain)
        return value.shown_by(set(held)) * float(picture_accuracy(tree.told[number], tree.errors[number] / width))
