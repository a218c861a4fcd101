"""First pass over a scene: each mesh is loaded once and only its block boxes, counts and hash are kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.progress import Progress
from farfield.represent.blocks import BlockedMesh
from farfield.scene.model import Material, Mesh, MeshSource, Scene
from farfield.scene.stored.scene import MeshSummary

CACHE_BYTES = 1 << 29
"""Meshes a process keeps loaded; the least recently used go first."""


@dataclass(slots=True)
class LoadedMesh:
    """A mesh in blocks with its materials."""

    blocks: BlockedMesh
    materials: tuple[Material, ...]


class MeshCache:
    """Loads meshes of a scene and keeps the recently used ones within a budget of bytes."""

    def __init__(self, scene: Scene, budget: int = CACHE_BYTES) -> None:
        self._scene = scene
        self._budget = budget
        self._kept: OrderedDict[int, tuple[LoadedMesh, int]] = OrderedDict()
        self._bytes = 0

    def get(self, index: int) -> LoadedMesh:
        """The mesh, from memory or read again. Raises InputError."""
        if index in self._kept:
            self._kept.move_to_end(index)
            return self._kept[index][0]
        return self.add(index, self._scene.meshes[index].load())

    def add(self, index: int, mesh: Mesh) -> LoadedMesh:
        """Blocks of a mesh just read; kept."""
        loaded = LoadedMesh(BlockedMesh.from_mesh(mesh), mesh.materials)
        size = mesh_bytes(mesh)
        self._kept[index] = (loaded, size)
        self._bytes += size
        while self._bytes > self._budget and len(self._kept) > 1:
            _, (_, freed) = self._kept.popitem(last=False)
            self._bytes -= freed
        return loaded


def mesh_bytes(mesh: Mesh) -> int:
    """Bytes of a mesh's arrays and textures."""
    arrays = (mesh.positions, mesh.triangles, mesh.normals, mesh.uvs, mesh.colors, mesh.triangle_object)
    textures = {id(m.texture): m.texture.pixels.nbytes for m in mesh.materials if m.texture is not None}
    return sum(a.nbytes for a in arrays if a is not None) + sum(textures.values())


@dataclass(frozen=True, slots=True)
class Surveyed:
    """A mesh's summary, and what there is to say of it."""

    summary: MeshSummary
    problem: InputError | None = None
    """Why it is left out."""


def survey_mesh(cache: MeshCache, index: int, source: MeshSource) -> Surveyed:
    """Loads a mesh into the cache and sums it up."""
    try:
        mesh = source.load()
        loaded = cache.add(index, mesh)
        return Surveyed(MeshSummary(loaded.blocks.boxes, len(mesh.triangles), _content(mesh), tuple(mesh.warnings)))
    except InputError as error:
        return Surveyed(MeshSummary(np.zeros((0, 2, 3)), 0, "", (f"left out: {error}",)), error)


def survey(
    known: Sequence[MeshSummary | None], look: Callable[[list[int]], Iterable[Surveyed]], progress: Progress
) -> list[MeshSummary]:
    """Summaries of all meshes. One that cannot be read is reported and left out; InputError when none is left.

    known: (meshes,) what is known already, or None. look: surveys the meshes of these numbers, in that order.
    """
    wanted = [mesh for mesh, summary in enumerate(known) if summary is None]
    found = dict(enumerate(known))
    problem = None
    if wanted:
        progress.start(len(wanted), "meshes surveyed")
        for mesh, surveyed in zip(wanted, look(wanted), strict=True):
            problem = problem or surveyed.problem
            found[mesh] = surveyed.summary
            progress.advance()
        progress.finish()
    summaries = [summary for summary in found.values() if summary is not None]
    # Meshes that share what is at fault say the same of it.
    for note in dict.fromkeys(note for summary in summaries for note in summary.notes):
        progress.note(note)
    if all(s.triangles == 0 for s in summaries):
        raise problem or InputError("nothing to bake: the scene holds no triangle")
    return summaries


def _content(mesh: Mesh) -> str:
    digest = blake2b(digest_size=16)
    arrays: list[NDArray[Any]] = [mesh.positions, mesh.triangles, mesh.normals, mesh.triangle_material]
    optional: list[NDArray[Any] | None] = [*arrays, mesh.uvs, mesh.colors, mesh.triangle_object]
    for array in optional:
        digest.update(b"-" if array is None else array.tobytes())
    for m in mesh.materials:
        digest.update(repr((m.base_color, m.alpha_cutoff, m.double_sided, m.unlit)).encode())
        if m.texture is not None:
            digest.update(repr(m.texture.pixels.shape).encode())
            digest.update(m.texture.pixels.tobytes())
    return digest.hexdigest()
