"""What a viewer that holds some values shows a cell by: its pictures, or geometry of its own or of the leaves below."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.octree.cut import view_bin
from farfield.octree.grid import CellKey
from farfield.represent.geometry.board import board_matrix, dynamic_angle, side_angles, sines, squareness
from farfield.stream.accuracy import loss_from, picture_accuracy
from farfield.stream.forms import CellForms, merged_accuracy, own_forms, told_errors
from farfield.stream.regions import pixel_width
from farfield.stream.tree import NONE, REACH, CellTree
from farfield.world.index import MESH_FARTHEST, BlockMapEntry, CellEntry, GeometryLevel, Impostor
from farfield.world.keys import DYNAMIC, DynamicImpostor, texture_key
from farfield.world.world import World

MORE = 0.25
"""Accuracy that instances are taken to have above what is told of their meshes, which is for a view from nearer and has
half as much on top (bake/instances.py): statues by levels of .28 look better so than in pictures of .07, woods on
boards of .65 worse than in pictures of .14."""
WHOLE = 1 - 1e-6
"""Share of a cell's pictures from which on they are all there."""


@dataclass(frozen=True, slots=True)
class PlacedInstance:
    """A shared mesh, or a board in its stead, in its place."""

    key: str
    """Of the mesh, or of the image on the board."""
    transform: NDArray[np.float64]
    """(3, 4) from the mesh's or the board's frame (see `board_matrix`) to local metres."""
    first: int
    """Object id of the mesh's object 0."""
    box: NDArray[np.float64]
    """(6,) round it, local metres."""
    is_board: bool = False


@dataclass(frozen=True, slots=True)
class ShownForm:
    """A cell above leaves, or a leaf, that is geometry in the place of its pictures."""

    entry: CellEntry
    form: GeometryLevel | BlockMapEntry | None = None
    """By which; None: by the finest that is there."""


@dataclass(frozen=True, slots=True)
class _Board:
    """An image of an instance that is held."""

    key: str
    angle: NDArray[np.float64]
    """(2,) see `side_angles`."""


def _dynamic_in(held: Collection[str]) -> dict[tuple[str, int], list[_Board]]:
    """Dynamic impostors by mesh and rows."""
    found: dict[tuple[str, int], list[_Board]] = {}
    for key in sorted(key for key in held if key.startswith(DYNAMIC)):
        if dynamic := DynamicImpostor.of(key):
            board = _Board(key, dynamic_angle(dynamic.turn, dynamic.tilt))
            found.setdefault((dynamic.mesh, dynamic.rows), []).append(board)
    return found


class Kinds:
    """Chooses by what is told of either, as who sends it does (stream.geometry)."""

    def __init__(self, world: World, eye: NDArray[np.float64], focal: float, least_gain: float) -> None:
        """eye: (3,) local metres. focal: pixels of one unit at distance one."""
        self._tree = CellTree.of(world)
        self._numbers = {entry.cell: number for number, entry in enumerate(self._tree.entries)}
        self._eye, self._focal, self._least_gain = eye, focal, least_gain
        self._dynamic: tuple[Collection[str], dict[tuple[str, int], list[_Board]]] | None = None
        """Those of the values that are held, and these."""

    def geometry_of(self, cell: CellKey, held: Collection[str]) -> list[ShownForm]:
        """What to draw in place of a cell's pictures: the leaves below, or the cell itself as merged geometry.

        None: its pictures are better, or it is no geometry (spec/drawing.md, Cells as geometry).
        """
        tree, number = self._tree, self._numbers.get(cell)
        if number is None:
            return []
        bounds, forms = tree.bounds[number], tree.forms(number)
        away = self._away(bounds)
        width = pixel_width(bounds, away, self._focal)
        may_be = forms.far & (forms.is_merged | (away < REACH * tree.grid.leaf_size))
        best = self._best(forms, may_be, number, width, held)
        if best is None or best[1] < self._pictures(number, width, held):
            return []
        if forms.is_merged[best[0]]:
            return [ShownForm(tree.entries[number], self._own_form(number, forms, best[0]))]
        return [ShownForm(tree.entries[leaf]) for leaf in tree.leaves_below(number)]

    def _own_form(self, number: int, forms: CellForms, chosen: int) -> GeometryLevel | BlockMapEntry:
        return own_forms(self._tree.entries[number])[chosen - len(forms.values)]

    def stands_in(self, cell: CellKey, held: Collection[str]) -> GeometryLevel | BlockMapEntry | None:
        """The form of its own by which a cell above others stands in for them; None: it does by its pictures."""
        number = self._numbers.get(cell)
        if number is None:
            return None
        bounds, forms = self._tree.bounds[number], self._tree.merged(number)
        width = pixel_width(bounds, self._away(bounds), self._focal)
        best = self._best(forms, forms.far, number, width, held)
        if best is None or best[1] < self._pictures(number, width, held):
            return None
        return self._own_form(number, forms, best[0])

    def _best(
        self,
        forms: CellForms,
        may_be: NDArray[np.bool_],
        number: int,
        width: NDArray[np.float64],
        held: Collection[str],
    ) -> tuple[int, float] | None:
        """Of a cell's forms that are held that which shows most, and how much; the finer, when two show the same."""
        best, pitch = None, float(self._tree.errors[number])
        own = own_forms(self._tree.entries[number])
        listed = float(self._tree.listed[number])
        placed = None
        for n, value in enumerate(forms.values):
            if may_be[n] and all(key in held for key in value.keys):
                shown = self._shown(forms.errors[n], width)
                if forms.is_merged[n]:
                    shown = float(merged_accuracy(forms.errors[n], pitch, np.full((1, 1), width))[0, 0])
                    if listed and not isinstance(own[n - len(forms.values)], BlockMapEntry):
                        placed = self._placed(number, held) if placed is None else placed
                        shown = (1 - listed) * shown + listed * placed
                if best is None or shown > best[1]:
                    best = n, shown
        return best

    def _placed(self, number: int, held: Collection[str]) -> float:
        """How much of the instances in a cell that is farther than near is drawn, by their sizes on the mean."""
        rows = self._tree.instances_below(number)
        drawn = [self._drawn_by(number, row, held, False) for row in rows.tolist()]
        shown = [min(accuracy + MORE, 1.0) if placed else 0.0 for placed, accuracy in drawn]
        sides = self._tree.instances.sides[rows]
        return float(np.average(shown, weights=sides)) if sides.sum() > 0 else 0.0

    def instances_of(
        self,
        cell: CellKey,
        held: Collection[str],
        is_near: bool,
        leaves: Collection[CellKey] = (),
        pictured: bool = False,
        into: NDArray[np.float64] | None = None,
    ) -> list[PlacedInstance]:
        """The instances in a cell of which meshes or boards are held, each by what shows most: what is seen meanwhile.

        leaves: that are drawn as geometry; what reaches into no other ones is left out. pictured: whether pictures of
        the cell, or of those above it, are drawn as well; what shows less than they do is left out. into: (n, 6) boxes
        of which one at least is reached by what is given; None: it does not matter.
        """
        tree, number = self._tree, self._numbers.get(cell)
        if number is None:
            return []
        found = []
        rows = tree.instances_below(number).tolist()
        least = self._instances_pictured(number, held) - MORE if pictured and rows else 0.0
        for row in rows:
            box = tree.instances.bounds[row]
            if leaves and self._is_within(box, leaves):
                continue
            if into is not None and not ((box[:3] < into[:, 3:]) & (into[:, :3] < box[3:])).all(axis=1).any():
                continue
            mesh, most = self._mesh_of(number, row, held, is_near)
            if mesh is None or self._shown_together(row, mesh.key) < least:
                mesh, most = None, 0.0
            board, _ = self._board_of(row, held, max(most, least))
            instance = board or mesh
            if instance is not None:
                found.append(instance)
        return found

    def _shown_together(self, row: int, key: str) -> float:
        """How much a level shows of an instance, where all of its mesh in the same leaf are nearest."""
        listed = self._tree.instances
        mesh, leaf = int(listed.mesh[row]), int(listed.leaf[row])
        first, last = np.searchsorted(listed.leaf, [leaf, leaf + 1])
        own = listed.bounds[first:last][listed.mesh[first:last] == mesh]
        box = np.concatenate([own[:, :3].min(axis=0), own[:, 3:].max(axis=0)])
        forms = listed.forms[mesh]
        errors = next(e for value, e in zip(forms.values, forms.errors, strict=True) if value.keys[-1] == key)
        return self._shown(errors, pixel_width(box, self._away(box), self._focal), MESH_FARTHEST)

    def _drawn_by(
        self, cell: int, row: int, held: Collection[str], is_near: bool
    ) -> tuple[PlacedInstance | None, float]:
        """An instance by the level or board that shows most of those that are held; None, 0: it cannot be drawn."""
        mesh, most = self._mesh_of(cell, row, held, is_near)
        board, shown = self._board_of(row, held, most)
        return (board, shown) if board else (mesh, most)

    def _mesh_of(
        self, cell: int, row: int, held: Collection[str], is_near: bool
    ) -> tuple[PlacedInstance | None, float]:
        """An instance by the finest level that is held, and how much that shows; None, 0: none may be drawn."""
        tree, listed = self._tree, self._tree.instances
        forms = listed.forms[int(listed.mesh[row])]
        for value, errors in zip(forms.values, forms.errors, strict=True):
            may_be = is_near or tree.may_be_afar(cell, value.level, len(forms.values))
            if may_be and all(key in held for key in value.keys):
                placed = PlacedInstance(
                    value.keys[-1], listed.transforms[row], int(listed.objects[row]), listed.bounds[row]
                )
                return placed, self._shown(errors, self._width(row), MESH_FARTHEST)
        return None, 0.0

    def _board_of(self, row: int, held: Collection[str], most: float) -> tuple[PlacedInstance | None, float]:
        """An instance by the board that shows most of those that are held; None: none shows more than `most`."""
        listed = self._tree.instances
        mesh, transform = int(listed.mesh[row]), listed.transforms[row]
        found = None
        for impostor in listed.impostors[mesh]:
            board, shown = self._board_by(impostor, row, held)
            if shown > most:
                found, most = board, shown
        if found is None:
            return None, most
        matrix = transform[:, :3] @ board_matrix(listed.boxes[mesh], found.angle)
        matrix[:, 3] += transform[:, 3]
        return PlacedInstance(found.key, matrix, int(listed.objects[row]), listed.bounds[row], is_board=True), most

    def _board_by(self, impostor: Impostor, row: int, held: Collection[str]) -> tuple[_Board | None, float]:
        """The board of an instance that is seen most squarely of those that are held, and how much it shows."""
        listed, mesh = self._tree.instances, int(self._tree.instances.mesh[row])
        boards = self._boards(impostor, listed.forms[mesh].values[0].cell, held)
        if not boards:
            return None, 0.0
        angles = np.array([board.angle for board in boards])
        sine = sines(listed.boxes[mesh], angles, listed.transforms[row][None], self._eye[None])[0, 0]
        best = int(np.argmax(sine))
        shown = self._shown(told_errors(impostor.errors), self._width(row), MESH_FARTHEST)
        return boards[best], float(shown * squareness(sine[best]))

    def _boards(self, impostor: Impostor, mesh: str, held: Collection[str]) -> list[_Board]:
        """Those of a mesh that are held: of its sides, then those that were made on demand."""
        sides = zip(impostor.images, side_angles(len(impostor.images)), strict=True)
        named = [_Board(texture_key(name), angle) for (name, _), angle in sides]
        baked = [board for board in named if board.key in held]
        if self._dynamic is None or self._dynamic[0] is not held:
            self._dynamic = held, _dynamic_in(held)
        return baked + self._dynamic[1].get((mesh, impostor.rows), [])

    def _shown(self, errors: NDArray[np.float64], width: NDArray[np.float64], farthest: float = 1.0) -> float:
        """How much is shown by what has these errors, (3,), where a pixel is so wide; see CellTree.errors_at."""
        return 1 - float(self._tree.errors_at(errors[None], np.full((1, 1), width), farthest)[0, 0])

    def _width(self, row: int) -> NDArray[np.float64]:
        """Metres that a pixel is wide on an instance."""
        bounds = self._tree.instances.bounds[row]
        return pixel_width(bounds, self._away(bounds), self._focal)

    def _away(self, bounds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Metres to a box, (6,); 0 inside."""
        gap = np.maximum(np.maximum(bounds[:3] - self._eye, self._eye - bounds[3:]), 0.0)
        return np.asarray(np.linalg.norm(gap))

    def _is_within(self, box: NDArray[np.float64], leaves: Collection[CellKey]) -> bool:
        first, last = self._tree.grid.leaf_index(box.reshape(2, 3)).tolist()
        ranges = (range(a, b + 1) for a, b in zip(first, last, strict=True))
        return all(CellKey(0, *key) in leaves for key in itertools.product(*ranges))

    def _pictures(self, number: int, width: NDArray[np.float64], held: Collection[str]) -> float:
        """Accuracy of what shows most of a cell: what is held of its pictures, or of those of a cell above it."""
        return max(self._share(above, held) * shown for above, shown in self._by_pictures_above(number, width))

    def _by_pictures_above(self, number: int, width: NDArray[np.float64]) -> Iterator[tuple[int, float]]:
        """A cell, and then each one above it, and how well all its pictures show the first."""
        tree, shown = self._tree, self._by_pictures(number, width)
        while True:
            yield number, shown
            above = int(tree.parents[number])
            if above == NONE:
                return
            shown *= 1 - float(loss_from(tree.losses[number], tree.errors[above] / width))
            number = above

    def _instances_pictured(self, number: int, held: Collection[str]) -> float:
        """How well instances in a cell are shown by the pictures that are drawn of it and of cells above.

        As sharp as these are, up to where one is whole or merged geometry stands in; and by the square of what share
        of them is held: through a wall that is missing one sees the backs of others.
        """
        tree, bounds, most = self._tree, self._tree.bounds[number], 0.0
        width = pixel_width(bounds, self._away(bounds), self._focal)
        for above, shown in self._by_pictures_above(number, width):
            if above != number and self.stands_in(tree.entries[above].cell, held) is not None:
                break
            share = self._share(above, held)
            most = max(most, share**2 * shown * min(float(width / tree.errors[above]), 1.0))
            if share >= WHOLE:
                break
        return most

    def _share(self, number: int, held: Collection[str]) -> float:
        """How much of what a cell's pictures show is held."""
        tree = self._tree
        if not tree.has_pictures[number]:
            return 0.0
        middle = tree.bounds[number].reshape(2, 3).mean(axis=0)
        value = tree.pictures(number, view_bin(middle, self._eye), self._least_gain)
        return sum(share for share, key in zip(value.shares, value.keys, strict=True) if key in held)

    def _by_pictures(self, number: int, width: NDArray[np.float64]) -> float:
        """Accuracy of a cell's own pictures, all of them.

        Above the leaves no better than where their pixels are as wide as the screen's: from farther they are told by
        what their children's look like, .92 to .96 where .90 to .93 is measured (docs/performance.md, Accuracy).
        """
        tree = self._tree
        pitch = float(tree.errors[number] / width)
        return float(picture_accuracy(tree.told[number], max(pitch, 1.0) if tree.levels[number] > 0 else pitch))
