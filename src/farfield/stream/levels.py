"""Levels of detail of meshes, with levels of their textures, as things to send (BEN 4.1, 4.1.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.stream.accuracy import compound_accuracy, level_accuracy, texture_accuracy
from farfield.stream.offers import Offers
from farfield.stream.outlook import Outlook

BARE = 0.3
"""Accuracy of a texture that is not there, by guess: the mesh has its mean colour, which comes with it."""
NONE = -1


@dataclass(frozen=True, slots=True)
class MeshLevels:
    """A mesh, which any number of objects may show: sent once, placed many times."""

    faces: tuple[int, ...]
    """Of each level, coarsest first; the last is the full mesh."""
    sizes: tuple[int, ...]
    """Bytes of each."""
    texels: tuple[int, ...] = ()
    """Of each level of its texture, coarsest first; none: it has no texture."""
    texture_sizes: tuple[int, ...] = ()
    """Bytes of each."""


@dataclass(frozen=True, slots=True)
class SentLevel:
    """What is to be sent: a level of a mesh, or one of its texture."""

    mesh: int
    level: int
    is_texture: bool = False


class Levels:
    """The levels of all meshes for one viewer, and which of them it holds."""

    def __init__(self, meshes: Sequence[MeshLevels], mesh_of: NDArray[np.int32]) -> None:
        """mesh_of: (n,) the mesh of each object, NONE for objects without."""
        self.held = np.full(len(meshes), NONE)
        """Finest level of each mesh that the viewer has."""
        self.held_texture = np.full(len(meshes), NONE)
        """The same of its texture."""
        self._mesh_of = mesh_of
        used = np.flatnonzero(mesh_of >= 0)
        self._objects = used[np.argsort(mesh_of[used], kind="stable")].astype(np.int32)
        self._faces = _padded([mesh.faces for mesh in meshes])
        self._full = np.array([mesh.faces[-1] for mesh in meshes], np.float64)
        self._texels = _padded([mesh.texels for mesh in meshes])
        self._textured = np.array([len(mesh.texels) > 0 for mesh in meshes], bool)
        self._rows = _Rows.of(meshes)
        self._items = np.zeros(0, np.int64)

    def offers(self, outlook: Outlook) -> Offers:
        """Finer levels of meshes, and of textures of meshes that are there, of which something will be visible."""
        seen = np.asarray(outlook.visible.any(axis=1))
        own = self._objects[seen[self._objects]]
        count = np.bincount(self._mesh_of[own], minlength=len(self.held))
        rows = self._rows
        held = np.where(rows.is_texture, self.held_texture[rows.mesh], self.held[rows.mesh])
        there = ~rows.is_texture | (self.held[rows.mesh] >= 0)
        self._items = np.flatnonzero((rows.level > held) & there & (count[rows.mesh] > 0))
        mesh, level, is_texture = rows.mesh[self._items], rows.level[self._items], rows.is_texture[self._items]
        # Uses of an item are the objects of its mesh, which follow each other in `own`.
        firsts = np.concatenate([[0], np.cumsum(count[mesh])])
        begin = (np.cumsum(count) - count)[mesh] - firsts[:-1]
        use = np.repeat(np.arange(len(mesh)), count[mesh])
        objects = own[np.arange(firsts[-1]) + begin[use]]
        shown = np.where(is_texture, self.held[mesh], level)
        texture = np.where(is_texture, level, self.held_texture[mesh])
        accuracy = self._accuracy(mesh[use], shown[use], texture[use], outlook.whole[objects])
        return Offers(rows.size[self._items], firsts, objects, accuracy)

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """Of every object whose mesh is there."""
        own = self._objects[self.held[self._mesh_of[self._objects]] >= 0]
        mesh = self._mesh_of[own].astype(np.int64)
        found = self._accuracy(mesh, self.held[mesh], self.held_texture[mesh], outlook.whole[own])
        best[own] = np.maximum(best[own], found[..., None])

    def take(self, item: int) -> SentLevel:
        """What to send."""
        row, rows = self._items[item], self._rows
        found = SentLevel(int(rows.mesh[row]), int(rows.level[row]), bool(rows.is_texture[row]))
        held = self.held_texture if found.is_texture else self.held
        held[found.mesh] = max(held[found.mesh], found.level)
        return found

    def _accuracy(
        self, mesh: NDArray[np.int64], level: NDArray[np.int64], texture: NDArray[np.int64], whole: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """(m, k) of levels of meshes with levels of their textures, where they take `whole`, (m, k), pixels."""
        found = level_accuracy(whole, self._faces[mesh, level, None], self._full[mesh, None])
        textured = self._textured[mesh]
        if textured.any():
            sharp = np.maximum(texture_accuracy(self._texels[mesh, texture, None], whole), BARE)
            sharp = np.where((texture == NONE)[:, None], BARE, sharp)
            found = np.where(textured[:, None], compound_accuracy(found, sharp), found)
        return found.astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Rows:
    """Everything that may be sent, one row each."""

    mesh: NDArray[np.int64]
    level: NDArray[np.int64]
    is_texture: NDArray[np.bool_]
    size: NDArray[np.int64]
    """Bytes."""

    @staticmethod
    def of(meshes: Sequence[MeshLevels]) -> _Rows:
        rows = [
            (number, level, is_texture, size)
            for number, mesh in enumerate(meshes)
            for is_texture, sizes in ((False, mesh.sizes), (True, mesh.texture_sizes))
            for level, size in enumerate(sizes)
        ]
        columns = np.array(rows, np.int64).reshape(-1, 4).T.copy()
        return _Rows(columns[0], columns[1], columns[2].astype(bool), columns[3])


def _padded(rows: Sequence[Sequence[int]]) -> NDArray[np.float64]:
    """(m, most) of rows of different lengths, 1 behind their ends."""
    found = np.ones((len(rows), max(map(len, rows), default=1) or 1))
    for n, row in enumerate(rows):
        found[n, : len(row)] = row
    return found
