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
"""Accuracy of a texture that is not there: the mesh has its mean colour, which comes with it."""
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
        self._meshes = meshes
        self._mesh_of = mesh_of
        self.held = np.full(len(meshes), NONE)
        """Finest level of each mesh that the viewer has."""
        self.held_texture = np.full(len(meshes), NONE)
        self._items: list[SentLevel] = []
        used = mesh_of >= 0
        self._objects = np.flatnonzero(used)[np.argsort(mesh_of[used], kind="stable")].astype(np.int32)
        self._firsts = np.searchsorted(mesh_of[self._objects], np.arange(len(meshes) + 1))

    def offers(self, outlook: Outlook) -> Offers:
        """Finer levels of meshes, and of textures of meshes that are there, of which something will be visible."""
        seen = np.asarray(outlook.visible.any(axis=1))
        self._items = []
        sizes: list[int] = []
        firsts, objects, accuracy = [0], [], []
        for number, mesh in enumerate(self._meshes):
            own = self._objects[self._firsts[number] : self._firsts[number + 1]]
            own = own[seen[own]]
            if len(own) == 0:
                continue
            whole = outlook.whole[own]
            level, texture = int(self.held[number]), int(self.held_texture[number])
            wanted = [(SentLevel(number, n), mesh.sizes[n]) for n in range(level + 1, len(mesh.sizes))]
            if level >= 0:
                finer = range(texture + 1, len(mesh.texture_sizes))
                wanted += [(SentLevel(number, n, is_texture=True), mesh.texture_sizes[n]) for n in finer]
            for item, size in wanted:
                self._items.append(item)
                sizes.append(size)
                objects.append(own)
                if item.is_texture:
                    accuracy.append(_accuracy(mesh, level, item.level, whole))
                else:
                    accuracy.append(_accuracy(mesh, item.level, texture, whole))
                firsts.append(firsts[-1] + len(own))
        intervals = outlook.visible.shape[1]
        return Offers(
            np.array(sizes, np.int64),
            np.array(firsts, np.int64),
            np.concatenate([np.zeros(0, np.int32), *objects]),
            np.concatenate([np.zeros((0, intervals), np.float32), *accuracy]),
        )

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """Of every object whose mesh is there."""
        for number in map(int, np.flatnonzero(self.held >= 0)):
            own = self._objects[self._firsts[number] : self._firsts[number + 1]]
            mesh, level, texture = self._meshes[number], int(self.held[number]), int(self.held_texture[number])
            best[own] = np.maximum(best[own], _accuracy(mesh, level, texture, outlook.whole[own]))

    def take(self, item: int) -> SentLevel:
        """What to send."""
        found = self._items[item]
        held = self.held_texture if found.is_texture else self.held
        held[found.mesh] = max(held[found.mesh], found.level)
        return found


def _accuracy(mesh: MeshLevels, level: int, texture: int, whole: NDArray[np.float32]) -> NDArray[np.float32]:
    found = level_accuracy(whole, mesh.faces[level], mesh.faces[-1])
    if mesh.texels:
        sharp = BARE if texture == NONE else np.maximum(texture_accuracy(mesh.texels[texture], whole), BARE)
        found = compound_accuracy(found, sharp)
    return found.astype(np.float32)
