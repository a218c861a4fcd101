"""The scene sorted on disk: what of it is in memory alone becomes values of the world's store (OV 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import repeat

import numpy as np

from farfield.progress import Progress
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.model import MeshSource, Scene
from farfield.scene.stored.footprints import StoredFootprints
from farfield.store.contract import Store
from farfield.world.attributes import put_table

WRITERS = 8
"""Values written at a time: what one takes is mostly waiting for the disk, or a bucket."""


def partition(scene: Scene, store: Store, progress: Progress) -> Scene:
    """The same scene, its footprints and attributes in the store. Raises StoreError."""
    with ThreadPoolExecutor(WRITERS) as pool:
        meshes = _stored_footprints(scene.meshes, store, pool, progress)
        parts = scene.attribute_parts or _attribute_parts(scene, store, pool)
    return replace(scene, meshes=meshes, attributes={}, attribute_parts=parts)


def _stored_footprints(
    sources: Sequence[MeshSource], store: Store, pool: ThreadPoolExecutor, progress: Progress
) -> tuple[MeshSource, ...]:
    chunks = [source for source in sources if isinstance(source, FootprintChunk)]
    if not chunks:
        return tuple(sources)
    progress.start(len(chunks), "squares of footprints stored")
    stored = []
    for one in pool.map(StoredFootprints.of, chunks, repeat(store)):
        stored.append(one)
        progress.advance()
    progress.finish()
    following = iter(stored)
    return tuple(next(following) if isinstance(source, FootprintChunk) else source for source in sources)


def _attribute_parts(scene: Scene, store: Store, pool: ThreadPoolExecutor) -> tuple[str, ...]:
    """A table for the objects of each instance."""
    own = scene.instances
    if not scene.attributes:
        return ("",) * len(own.mesh)
    columns = {name: np.asarray(column) for name, column in scene.attributes.items()}

    def put(first: int, count: int) -> str:
        rows = slice(first - 1, first - 1 + count)
        return put_table(store, {name: column[rows].tolist() for name, column in columns.items()})

    return tuple(pool.map(put, own.first_object.tolist(), own.objects.tolist()))
