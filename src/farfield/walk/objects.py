"""The objects of a world, told from its near geometry: a world carries no scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.represent.geometry.read import read_leaf_glb, read_mesh_glb
from farfield.scene.model import Mesh, Texture
from farfield.stream.tree import NONE, CellTree
from farfield.world.keys import geometry_key, mesh_key
from farfield.world.world import World

Floats = NDArray[np.float64]
LIES_FLAT = 0.8
"""Share of its surface, seen from above, from which on an object is ground: open sheets with slopes up to 37 degrees.
Closed bodies have a share of 0, boxes without a bottom one of 0.7 when they are ten times as wide as high."""


@dataclass(frozen=True, slots=True)
class WorldObjects:
    """n objects, and the pieces of them that lie in leaves."""

    ids: NDArray[np.int64]
    """(n,) ascending."""
    boxes: Floats
    """(n, 6) local metres, lower and upper corners."""
    is_ground: NDArray[np.bool_]
    """(n,) whether they are sheets that lie flat."""
    faces: NDArray[np.int64]
    """(n,) triangles of the full models; those that leaves cut count in each."""
    piece_object: NDArray[np.int64]
    """(p,) row of the object of each piece."""
    piece_leaf: NDArray[np.int64]
    """(p,) number of its leaf in the CellTree."""
    piece_share: Floats
    """(p,) share of the object's surface that it is; those of an object add up to 1."""
    piece_instance: NDArray[np.int64]
    """(p,) row in CellTree.instances of the instance that it is of, as the index tells; NONE: of none."""

    def without_ground(self) -> WorldObjects:
        """Only what stands on it."""
        kept = ~self.is_ground
        pieces = kept[self.piece_object]
        rows = np.cumsum(kept) - 1
        return WorldObjects(
            self.ids[kept], self.boxes[kept], self.is_ground[kept], self.faces[kept], rows[self.piece_object[pieces]],
            self.piece_leaf[pieces], self.piece_share[pieces], self.piece_instance[pieces],
        )  # fmt: skip


def read_objects(world: World, tree: CellTree) -> WorldObjects:
    """All of them, from the geometry of every leaf. Raises CorruptTileError and StoreError.

    Keeps the shared meshes' triangles, 80 bytes each, while it reads.
    """
    reader = _Reader(world, tree)
    for leaf in np.flatnonzero(tree.has_geometry).tolist():
        reader.read(leaf)
    return reader.found.gathered()


@dataclass(slots=True)
class _Triangles:
    """Triangles of any objects."""

    corners: Floats
    """(m, 3, 3)."""
    objects: NDArray[np.int64]
    """(m,)."""

    @staticmethod
    def of(mesh: Mesh) -> _Triangles:
        own = mesh.triangle_object
        objects = np.zeros(len(mesh.triangles), np.int64) if own is None else own.astype(np.int64)
        return _Triangles(mesh.positions[mesh.triangles], objects)


@dataclass(slots=True)
class _Sums:
    """Surfaces and boxes of pieces, one row each."""

    objects: list[NDArray[np.int64]] = field(default_factory=list)
    leaves: list[NDArray[np.int64]] = field(default_factory=list)
    surfaces: list[Floats] = field(default_factory=list)
    """Square metres of all triangles, and of what of them faces up, seen from above; and how many they are."""
    boxes: list[Floats] = field(default_factory=list)
    instances: list[NDArray[np.int64]] = field(default_factory=list)

    def add(self, leaf: int, triangles: _Triangles, instance: int = NONE) -> None:
        """Triangles that lie in a leaf, local metres. instance: see WorldObjects.piece_instance."""
        if not len(triangles.objects):
            return
        order = np.argsort(triangles.objects, kind="stable")
        corners, objects = triangles.corners[order], triangles.objects[order]
        starts = np.flatnonzero(np.append(True, objects[1:] != objects[:-1]))
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        sizes = np.stack([np.linalg.norm(normals, axis=1), normals[:, 2], np.ones(len(normals))], axis=1)
        lower = np.minimum.reduceat(corners.min(axis=1), starts)
        upper = np.maximum.reduceat(corners.max(axis=1), starts)
        self.objects.append(objects[starts])
        self.leaves.append(np.full(len(starts), leaf, np.int64))
        self.instances.append(np.full(len(starts), instance, np.int64))
        self.surfaces.append(np.add.reduceat(sizes, starts))
        self.boxes.append(np.concatenate([lower, upper], axis=1))

    def gathered(self) -> WorldObjects:
        """By object."""
        none = np.zeros(0, np.int64)
        objects, leaves = np.concatenate([none, *self.objects]), np.concatenate([none, *self.leaves])
        surfaces = np.concatenate([np.zeros((0, 3)), *self.surfaces])
        ids, rows = np.unique(objects, return_inverse=True)
        whole = np.zeros((len(ids), 3))
        np.add.at(whole, rows, surfaces)
        lower, upper = np.full((len(ids), 3), np.inf), np.full((len(ids), 3), -np.inf)
        boxes = np.concatenate([np.zeros((0, 6)), *self.boxes])
        np.minimum.at(lower, rows, boxes[:, :3])
        np.maximum.at(upper, rows, boxes[:, 3:])
        most = np.maximum(whole[:, 0], 1e-12)
        return WorldObjects(
            ids, np.concatenate([lower, upper], axis=1), whole[:, 1] >= LIES_FLAT * most, whole[:, 2].astype(np.int64),
            rows.astype(np.int64), leaves, surfaces[:, 0] / most[rows], np.concatenate([none, *self.instances]),
        )  # fmt: skip


class _Reader:
    def __init__(self, world: World, tree: CellTree) -> None:
        self.found = _Sums()
        self._world, self._tree = world, tree
        self._meshes: dict[str, _Triangles] = {}
        self._listed = {first: row for row, first in enumerate(tree.instances.objects.tolist())}
        """Rows of the instances by the ids of their first objects."""

    def read(self, leaf: int) -> None:
        """One leaf's geometry."""
        entry = self._tree.entries[leaf]
        assert entry.geometry is not None
        key = geometry_key(entry.cell, entry.geometry.hash)
        geometry = read_leaf_glb(self._world.store.get(key), key, _no_texture)
        corner = self._world.grid.bounds(entry.cell)[0]
        if geometry.mesh is not None:
            clipped = _Triangles.of(geometry.mesh)
            self.found.add(leaf, _Triangles(clipped.corners + corner, clipped.objects))
        for placed in geometry.placed:
            mesh = self._mesh(placed.mesh)
            for transform, first in zip(placed.transforms, placed.objects, strict=True):
                corners = mesh.corners @ transform[:, :3].T + transform[:, 3] + corner
                own = self._inside(leaf, _Triangles(corners, mesh.objects + int(first)))
                self.found.add(leaf, own, self._listed.get(int(first), NONE))

    def _inside(self, leaf: int, triangles: _Triangles) -> _Triangles:
        """Those whose middle is in the leaf: instances are listed in every leaf that they reach into."""
        cell = self._tree.entries[leaf].cell
        inside = (self._world.grid.leaf_index(triangles.corners.mean(axis=1)) == [cell.x, cell.y, cell.z]).all(axis=1)
        return _Triangles(triangles.corners[inside], triangles.objects[inside])

    def _mesh(self, name: str) -> _Triangles:
        if name not in self._meshes:
            key = mesh_key(name)
            self._meshes[name] = _Triangles.of(read_mesh_glb(self._world.store.get(key), key, _no_texture))
        return self._meshes[name]


def _no_texture(name: str) -> Texture:
    """Surfaces are looked at without."""
    return Texture(np.zeros((1, 1, 4), np.uint8))
