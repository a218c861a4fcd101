"""Walkthrough quality as the thesis defines it (BEN 6.1): the benefit of what is held over that of all there is.

quality(t) = sum of visibility x accuracy / sum of visibility, over the objects in view; visibility is the pixels of
the bounding rectangle within the picture (BEN 4.2), accuracy that of the best that is held (BEN 4.1). An object that
lies in several leaves is as accurate as its pieces are, by their shares of its surface.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.boxes import see_boxes
from farfield.represent.geometry.board import dynamic_angle, side_angles, sines, squareness
from farfield.stream.accuracy import impostor_accuracy, level_accuracy
from farfield.stream.tree import FIRST_MERGED, NONE, CellTree
from farfield.walk.objects import WorldObjects
from farfield.walk.observer import Pose
from farfield.world.keys import DynamicImpostor, orthoview_key, texture_key

Floats = NDArray[np.float64]
LEAST_VISIBLE = 1.0
"""Pixels of its rectangle from which on an object is in view."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What is to be seen at a moment: k pieces of the objects in view."""

    eye: Floats
    """(3,) local metres."""
    focal: float
    """Pixels of one unit at distance one."""
    leaf: NDArray[np.int64]
    """(k,) number of the leaf of each piece."""
    area: Floats
    """(k,) pixels of the whole rectangle of its object."""
    height: Floats
    """(k,) pixels that the rectangle is high."""
    metres: Floats
    """(k,) height of its object."""
    faces: Floats
    """(k,) triangles of its object's full model."""
    towards: Floats
    """(k, 3) unit vectors from the middle of its object to the eye."""
    instance: NDArray[np.int64]
    """(k,) see WorldObjects.piece_instance."""


@dataclass(frozen=True, slots=True)
class Look:
    """The m objects in view, and the k pieces of them."""

    objects: NDArray[np.int64]
    """(m,) rows of WorldObjects."""
    visible: Floats
    """(m,) pixels of the rectangle within the picture."""
    sight: Sight
    piece_object: NDArray[np.int64]
    """(k,) which of the m objects each is of."""
    piece_share: Floats
    """(k,) of its object's surface."""


class HeldKind(Protocol):
    """A way to show objects, as far as walks are measured; images made on demand plug in by the same answers."""

    def hold(self, key: str) -> None:
        """A value has come; of any kind."""
        ...

    def accuracy(self, sight: Sight) -> Floats:
        """(k,) of each piece by what is held, 0 to 1 (BEN 4.1); 0 where nothing of it is."""
        ...


class _Gathered:
    """Counts what lacks of forms that are drawn when all of their values are there."""

    def __init__(self, forms: Iterable[tuple[int, int, Collection[str]]]) -> None:
        """forms: what each is of, its level, and its keys."""
        self._lacking: dict[tuple[int, int], int] = {}
        self._users: dict[str, list[tuple[int, int]]] = {}
        for of, level, keys in forms:
            self._lacking[of, level] = len(keys)
            for key in keys:
                self._users.setdefault(key, []).append((of, level))

    def hold(self, key: str) -> list[tuple[int, int]]:
        """A value has come; returns of what, and by which levels, forms are complete now."""
        users = self._users.pop(key, [])
        for user in users:
            self._lacking[user] -= 1
        return [user for user in users if self._lacking[user] == 0]


class HeldGeometry:
    """Leaves as triangles, the full models or a coarser form, when all of it is there.

    Beyond the near radius only forms of few enough triangles (stream.tree.CellForms.far).
    """

    def __init__(self, tree: CellTree, near_radius: float | None = None) -> None:
        """near_radius: metres; None: r, as the cut defines it."""
        self._tree, self._near_radius = tree, near_radius
        self._share = np.zeros(len(tree.entries))
        """Of the full models' triangles that the finest form that is held of each leaf has."""
        self._far = np.zeros(len(tree.entries))
        """The same of forms that may be drawn from afar."""
        cells = np.flatnonzero(tree.has_geometry).tolist()
        self._gathered = _Gathered((cell, form.level, form.keys) for cell in cells for form in tree.forms(cell).values)

    def hold(self, key: str) -> None:
        """See HeldKind."""
        for cell, level in self._gathered.hold(key):
            share = triangle_share(self._tree, cell, level)
            self._share[cell] = max(self._share[cell], share)
            if self._tree.forms(cell).far[level]:
                self._far[cell] = max(self._far[cell], share)

    def accuracy(self, sight: Sight) -> Floats:
        """See HeldKind."""
        tree = self._tree
        boxes = tree.boxes[sight.leaf]
        away = np.linalg.norm(np.maximum(np.maximum(boxes[:, :3] - sight.eye, sight.eye - boxes[:, 3:]), 0.0), axis=1)
        near = sight.focal * tree.grid.pitch(0) if self._near_radius is None else self._near_radius
        share = np.where(away < near, self._share[sight.leaf], self._far[sight.leaf])
        return mesh_accuracy(sight, share)


class HeldMerged:
    """What lies in leaves, but for the instances that these list, by the merged geometry of the cells above them."""

    def __init__(self, tree: CellTree) -> None:
        self._tree = tree
        triangles = np.array([entry.geometry.triangles if entry.geometry else 0 for entry in tree.entries], np.int64)
        self._full = np.where(tree.has_geometry, triangles, 0)
        """Triangles in full of all leaves at or below each cell."""
        for cell in range(len(tree.entries) - 1, -1, -1):
            if tree.parents[cell] != NONE:
                self._full[tree.parents[cell]] += self._full[cell]
        self._share = np.zeros(len(tree.entries))
        """Of those triangles that the finest form of each cell's own that is held has."""
        cells = np.flatnonzero(tree.has_merged).tolist()
        self._gathered = _Gathered((cell, form.level, form.keys) for cell in cells for form in tree.merged(cell).values)

    def hold(self, key: str) -> None:
        """See HeldKind."""
        for cell, level in self._gathered.hold(key):
            near = self._tree.entries[cell].geometry
            assert near is not None
            share = near.forms[level - FIRST_MERGED].triangles / max(int(self._full[cell]), 1)
            self._share[cell] = max(self._share[cell], min(share, 1.0))

    def accuracy(self, sight: Sight) -> Floats:
        """See HeldKind."""
        share = np.zeros(len(sight.leaf))
        pieces = np.flatnonzero(sight.instance == NONE)
        cells = self._tree.parents[sight.leaf[pieces]].astype(np.int64)
        while len(pieces):
            is_below = cells != NONE
            pieces, cells = pieces[is_below], cells[is_below]
            share[pieces] = np.maximum(share[pieces], self._share[cells])
            cells = self._tree.parents[cells].astype(np.int64)
        return mesh_accuracy(sight, share)


class HeldMeshes:
    """Objects by the levels of their meshes, which are drawn wherever the index has instances of them."""

    def __init__(self, tree: CellTree) -> None:
        self._tree = tree
        self._share = np.zeros(len(tree.instances.forms) + 1)
        """Of the full model's triangles that the finest level that is held has; the last is that of no mesh."""
        self._gathered = _Gathered(
            (mesh, form.level, form.keys) for mesh, forms in enumerate(tree.instances.forms) for form in forms.values
        )

    def hold(self, key: str) -> None:
        """See HeldKind."""
        for mesh, level in self._gathered.hold(key):
            own = self._tree.instances.triangles[mesh]
            self._share[mesh] = max(self._share[mesh], own[level] / own[0])

    def accuracy(self, sight: Sight) -> Floats:
        """See HeldKind."""
        return mesh_accuracy(sight, self._share[piece_meshes(self._tree, sight)])


class HeldBoards:
    """Instances that the index lists by images of their meshes, each across its direction.

    Of the rows that the object has in them, and by the angle between the line of sight and their plane, in the mesh's
    frame.
    """

    def __init__(self, tree: CellTree) -> None:
        self._tree = tree
        impostors = tree.instances.impostors
        self._held = tuple(tuple(np.zeros(len(one.images), bool) for one in own) for own in impostors)
        """Of each mesh, of each of its impostors, (sides,)."""
        self._dynamic: dict[tuple[int, int], dict[str, Floats]] = {}
        """Mesh and number of its impostor -> keys and angles of the images that were made on demand."""
        self._numbers = {
            (forms.values[0].cell, impostor.rows): (mesh, number)
            for mesh, (forms, own) in enumerate(zip(tree.instances.forms, impostors, strict=True))
            for number, impostor in enumerate(own)
        }
        self._places: dict[str, list[tuple[int, int, int]]] = {}
        for mesh, own in enumerate(impostors):
            for number, impostor in enumerate(own):
                for side, (name, _) in enumerate(impostor.images):
                    self._places.setdefault(texture_key(name), []).append((mesh, number, side))

    def hold(self, key: str) -> None:
        """See HeldKind."""
        for mesh, number, side in self._places.get(key, []):
            self._held[mesh][number][side] = True
        dynamic = DynamicImpostor.of(key)
        if dynamic and (of := self._numbers.get((dynamic.mesh, dynamic.rows))):
            self._dynamic.setdefault(of, {})[key] = dynamic_angle(dynamic.turn, dynamic.tilt)

    def accuracy(self, sight: Sight) -> Floats:
        """See HeldKind."""
        found = np.zeros(len(sight.instance))
        for mesh, number, pieces, accuracy in self.all_accuracies(sight):
            held = np.append(self._held[mesh][number], np.ones(len(self._dynamic.get((mesh, number), ())), bool))
            best = np.where(held, accuracy, 0.0).max(axis=1)
            found[pieces] = np.maximum(found[pieces], best)
        return found

    def keys(self, mesh: int, number: int) -> list[str]:
        """Of all boards of an impostor, in the order of `all_accuracies`."""
        images = self._tree.instances.impostors[mesh][number].images
        return [*(texture_key(name) for name, _ in images), *self._dynamic.get((mesh, number), {})]

    def all_accuracies(self, sight: Sight) -> Iterator[tuple[int, int, NDArray[np.int64], Floats]]:
        """Of all boards, held or not, impostor by impostor: its mesh and number; pieces, (l,); (l, boards) accuracy.

        Boards are the sides that are baked, then what has been made on demand.
        """
        listed, meshes = self._tree.instances, piece_meshes(self._tree, sight)
        for mesh in np.unique(meshes[meshes != NONE]).tolist():
            pieces = np.flatnonzero(meshes == mesh)
            own, height = sight.instance[pieces], sight.height[pieces]
            # Of a mesh of several objects each has its share of the rows.
            share = np.minimum(
                sight.metres[pieces] / np.maximum(listed.bounds[own, 5] - listed.bounds[own, 2], 1e-9), 1
            )
            for number, impostor in enumerate(listed.impostors[mesh]):
                angles = np.array([*side_angles(len(impostor.images)), *self._dynamic.get((mesh, number), {}).values()])
                square = squareness(sines(listed.boxes[mesh], angles, listed.transforms[own], sight.eye[None]))[:, 0]
                sharp = impostor_accuracy(impostor.rows * share, height, np.pi / 2)
                yield mesh, number, pieces, sharp[:, None] * square


def piece_meshes(tree: CellTree, sight: Sight) -> NDArray[np.int64]:
    """(k,) number in CellTree.instances of the mesh of each piece; NONE: of none."""
    return np.append(tree.instances.mesh, NONE)[sight.instance].astype(np.int64)


def mesh_accuracy(sight: Sight, share: Floats) -> Floats:
    """(k,) of pieces that are shown by so many of the triangles of their objects; 0 of those without."""
    faces = np.maximum(sight.faces * share, 1.0)
    return np.where(share > 0, level_accuracy(sight.area, faces, np.maximum(sight.faces, faces)), 0.0)


class HeldPictures:
    """Pictures of a piece's leaf or of a cell above it, as boards that stand across their directions.

    Of the rows that the object has in them, and by the angle between the line of sight and their plane.
    """

    def __init__(self, tree: CellTree, directions: Sequence[tuple[int, tuple[float, float, float]]]) -> None:
        """directions: number and unit vector towards the camera of each."""
        self._vectors = np.array([vector for _, vector in directions]).reshape(-1, 3)
        self._parents, self._errors = tree.parents, tree.errors
        self._held = np.zeros((len(tree.entries), len(directions)), bool)
        columns = {number: column for column, (number, _) in enumerate(directions)}
        self._places = {
            orthoview_key(entry.cell, direction, layer, entry.hash): (row, columns[direction])
            for row, entry in enumerate(tree.entries)
            for direction, layer, _ in entry.tiles
            # The second layer shows what the first hides.
            if layer == 0
        }

    def hold(self, key: str) -> None:
        """See HeldKind."""
        if key in self._places:
            self._held[self._places[key]] = True

    def accuracy(self, sight: Sight) -> Floats:
        """See HeldKind."""
        found = np.zeros(len(sight.leaf))
        for pieces, cells, accuracy in self.all_accuracies(sight):
            best = np.where(self._held[cells], accuracy, 0.0).max(axis=1, initial=0.0)
            found[pieces] = np.maximum(found[pieces], best)
        return found

    def all_accuracies(self, sight: Sight) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats]]:
        """Of all pictures, held or not, level by level: pieces, (l,); their cells, (l,); (l, directions) accuracy."""
        angle = np.arcsin(np.clip(sight.towards @ self._vectors.T, 0.0, 1.0))
        square = impostor_accuracy(np.inf, 1.0, angle)
        pieces, cells = np.arange(len(sight.leaf)), sight.leaf.copy()
        while len(pieces):
            rows = sight.metres[pieces] / self._errors[cells]
            # Less than a row shows nothing.
            sharp = impostor_accuracy(rows, sight.height[pieces], np.pi / 2) * (rows >= 1)
            yield pieces, cells, sharp[:, None] * square[pieces]
            above = self._parents[cells]
            pieces, cells = pieces[above != NONE], above[above != NONE].astype(np.int64)


@dataclass(frozen=True, slots=True)
class Sample:
    """A moment of a walk."""

    quality: float
    """0 to 1; nan when nothing is in view."""
    missing: int
    """Objects in view of which nothing is held."""
    in_view: int
    """Objects in view."""


class Measure:
    """Judges what a viewer holds."""

    def __init__(self, objects: WorldObjects, kinds: Sequence[HeldKind], size: tuple[int, int]) -> None:
        """size: width and height of the picture, pixels."""
        self._objects, self._kinds, self._size = objects, kinds, size

    def hold(self, keys: Iterable[str]) -> None:
        """Values have come."""
        for key in keys:
            for kind in self._kinds:
                kind.hold(key)

    def sample(self, pose: Pose) -> Sample:
        """As of now, from the true eye."""
        look = self.look(pose)
        if not len(look.visible):
            return Sample(float("nan"), 0, 0)
        accuracy = np.zeros(len(look.visible))
        np.add.at(accuracy, look.piece_object, look.piece_share * self.piece_accuracy(look.sight))
        quality = float((look.visible * accuracy).sum() / look.visible.sum())
        return Sample(quality, int((accuracy == 0).sum()), len(accuracy))

    def piece_accuracy(self, sight: Sight) -> Floats:
        """(k,) of each piece by the best that is held."""
        return np.asarray(np.max([kind.accuracy(sight) for kind in self._kinds], axis=0, initial=0.0))

    def look(self, pose: Pose) -> Look:
        """What is in view."""
        objects, focal = self._objects, self._size[1] / 2 / np.tan(np.radians(pose.fov) / 2)
        seen = _seen(objects.boxes, pose, focal, self._size)
        rows = np.flatnonzero(seen[:, 0] >= LEAST_VISIBLE)
        places = np.full(len(objects.ids), NONE)
        places[rows] = np.arange(len(rows))
        pieces = np.flatnonzero(places[objects.piece_object] != NONE)
        own = objects.piece_object[pieces]
        towards = pose.eye - (objects.boxes[own, :3] + objects.boxes[own, 3:]) / 2
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        metres = objects.boxes[own, 5] - objects.boxes[own, 2]
        sight = Sight(
            pose.eye, focal, objects.piece_leaf[pieces], seen[own, 1], seen[own, 2], metres,
            objects.faces[own].astype(np.float64), towards, objects.piece_instance[pieces],
        )  # fmt: skip
        return Look(rows, seen[rows, 0], sight, places[own], objects.piece_share[pieces])


def samples(
    measure: Measure, arrivals: Sequence[tuple[float, str]], poses: Iterable[tuple[float, Pose]]
) -> Iterator[Sample]:
    """One of each pose, with what had arrived by its time. Both ascend; seconds."""
    held = 0
    for at, pose in poses:
        begun = held
        while held < len(arrivals) and arrivals[held][0] <= at:
            held += 1
        measure.hold(key for _, key in arrivals[begun:held])
        yield measure.sample(pose)


def triangle_share(tree: CellTree, cell: int, level: int) -> float:
    """How many triangles a form of a leaf's geometry has for each of the full one's; of instances by their bytes."""
    near = tree.entries[cell].geometry
    assert near is not None
    form = near.forms[level]
    if near.triangles and not near.meshes:
        return min(form.triangles / near.triangles, 1.0)
    sizes = [one.bytes + sum(size for _, size in one.meshes) for one in (form, near)]
    return min(sizes[0] / sizes[1], 1.0)


def _seen(boxes: Floats, pose: Pose, focal: float, size: tuple[int, int]) -> Floats:
    """(n, 3) pixels: of the rectangle within the picture, of the whole, and its height."""
    right = np.cross(pose.forward, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(right))
    right = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else right / length
    axes = np.stack([right, np.cross(pose.forward, right), pose.forward])[None]
    seen = np.zeros((len(boxes), 1, 3), np.float32)
    width, height = map(float, size)
    see_boxes(np.ascontiguousarray(boxes), pose.eye[None].copy(), axes, 0, focal, width, height, seen)
    return seen[:, 0].astype(np.float64)
