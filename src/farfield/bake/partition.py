"""The scene sorted on disk: what of it is in memory alone becomes values of the world's store (OV 4.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farfield.progress import Progress
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.model import MeshSource, Scene
from farfield.scene.stored.footprints import StoredFootprints
from farfield.store.contract import Store
from farfield.world.attributes import put_table


def partition(scene: Scene, store: Store, progress: Progress) -> Scene:
    """The same scene, its footprints and attributes in the store. Raises StoreError."""
    chunks = sum(isinstance(source, FootprintChunk) for source in scene.meshes)
    if chunks:
        progress.start(chunks, "squares of footprints stored")
    meshes: list[MeshSource] = []
    for source in scene.meshes:
        if isinstance(source, FootprintChunk):
            meshes.append(StoredFootprints.of(source, store))
            progress.advance()
        else:
            meshes.append(source)
    if chunks:
        progress.finish()
    parts = scene.attribute_parts or _attribute_parts(scene, store)
    return replace(scene, meshes=tuple(meshes), attributes={}, attribute_parts=parts)


def _attribute_parts(scene: Scene, store: Store) -> tuple[str, ...]:
    """A table for the objects of each instance."""
    own = scene.instances
    if not scene.attributes:
        return ("",) * len(own.mesh)
    columns = {name: np.asarray(column) for name, column in scene.attributes.items()}
    parts = []
    for first, count in zip(own.first_object.tolist(), own.objects.tolist(), strict=True):
        rows = slice(first - 1, first - 1 + count)
        parts.append(put_table(store, {name: column[rows].tolist() for name, column in columns.items()}))
    return tuple(parts)
