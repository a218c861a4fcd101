"""The scene sorted on disk: what of it is in memory alone, or too large for it, becomes values of the world's store.

Footprints and city objects by square, large meshes in pieces, attributes by instance (OV 4.1, out of core).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import msgspec
import numpy as np

from farfield.bake.survey import CACHE_BYTES
from farfield.errors import InputError, MissingKeyError
from farfield.progress import Progress
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.faults import counted
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.model import Instances, MeshSource, Scene
from farfield.scene.stored.cities import StoredCity
from farfield.scene.stored.footprints import StoredFootprints
from farfield.scene.stored.piece import StoredPiece
from farfield.scene.stored.pieces import PIECE_TRIANGLES, holds, write_pieces
from farfield.scene.streams import MeshStream, StreamedSource
from farfield.scene.surfaces.source import FileMesh
from farfield.store.contract import Store
from farfield.world.attributes import put_table
from farfield.world.chunks import ChunkNote
from farfield.world.keys import content_hash, split_key
from farfield.world.limits import DAMAGE

WRITERS = 8
"""Values written at a time: what one takes is mostly waiting for the disk, or a bucket."""

LIMIT = CACHE_BYTES // 4
"""Bytes of a mesh in memory above which it is split: 3.5 million triangles that share their vertices, which take eight
times as much while they are loaded (12 million, 456 MB: 3.8 GB)."""

_VERSION = 1
"""Grows when the same file would give other pieces."""


def partition(scene: Scene, store: Store, progress: Progress) -> Scene:
    """The same scene, its footprints, city objects, attributes and large meshes in the store.

    To be called within `store.writing`. Raises InputError when no mesh can be read, and StoreError.
    """
    # Pieces of a scene that was kept are told of by the notes of the bake that made them.
    kept = any(isinstance(source, StoredPiece) for source in scene.meshes)
    scene = split_large(scene, store, progress, prune=not kept)
    with ThreadPoolExecutor(WRITERS) as pool:
        meshes = _stored_chunks(scene.meshes, store, pool, progress)
        parts = scene.attribute_parts or _attribute_parts(scene, store, pool)
    return replace(scene, meshes=meshes, attributes={}, attribute_parts=parts)


def _stored_chunks(
    sources: Sequence[MeshSource], store: Store, pool: ThreadPoolExecutor, progress: Progress
) -> tuple[MeshSource, ...]:
    chunks = [source for source in sources if isinstance(source, FootprintChunk | CityChunk)]
    if not chunks:
        return tuple(sources)
    named = "squares of footprints" if all(isinstance(chunk, FootprintChunk) for chunk in chunks) else "parts of cities"
    progress.start(len(chunks), f"{named} stored")
    stored = []
    for one in pool.map(_stored, chunks, repeat(store)):
        stored.append(one)
        progress.advance()
    progress.finish()
    following = iter(stored)
    return tuple(next(following) if isinstance(source, FootprintChunk | CityChunk) else source for source in sources)


def _stored(chunk: FootprintChunk | CityChunk, store: Store) -> MeshSource:
    return StoredCity.of(chunk, store) if isinstance(chunk, CityChunk) else StoredFootprints.of(chunk, store)


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


class _File(msgspec.Struct, frozen=True):
    path: str
    bytes: int
    modified: int
    """Nanoseconds."""


class _SplitNote(ChunkNote, frozen=True):
    """What a mesh became."""

    version: int
    most: int
    """Triangles of a piece."""
    files: tuple[_File, ...]
    """As they were."""
    pieces: int
    """How many of the chunks, the first, are pieces; the rest are what these refer to."""
    warnings: tuple[str, ...]


def split_large(
    scene: Scene,
    store: Store,
    progress: Progress,
    limit: int = LIMIT,
    most: int = PIECE_TRIANGLES,
    prune: bool = False,
) -> Scene:
    """The scene with meshes of more than `limit` bytes, as loaded, in pieces of at most `most` triangles in `store`.

    Each instance of such a mesh becomes one instance of every piece, of the same objects. A mesh that was split into
    this store before, from the same files, is not read again. Those whose format has to be loaded whole stay as they
    are; one that cannot be read is left out and said. prune: notes about other meshes go. To be called within
    `store.writing`.
    Raises InputError when no mesh is left, and StoreError.
    """
    parts: dict[int, tuple[MeshSource, ...]] = {}
    problem: InputError | None = None
    notes: set[str] = set()
    for number, source in enumerate(scene.meshes):
        stream = _large(source, limit, progress)
        if stream is None:
            continue
        notes.add(_note_key(stream))
        try:
            parts[number] = _pieces(source, stream, store, progress, most)
        except InputError as error:
            progress.note(f"left out: {error}")
            problem, parts[number] = problem or error, ()
        finally:
            stream.forget()
    if prune:
        for key in store.list("record/split"):
            if key not in notes:
                store.delete(key)
    if problem is not None and all(parts.get(number) == () for number in range(len(scene.meshes))):
        raise problem
    return _with_parts(scene, parts) if parts else scene


def _large(source: MeshSource, limit: int, progress: Progress) -> MeshStream | None:
    """The mesh, if it is to be split; what is wrong with it is found again when it is read."""
    if not isinstance(source, StreamedSource):
        return None
    try:
        stream = source.stream()
        if stream is None and isinstance(source, FileMesh) and source.path.stat().st_size > limit:
            progress.note(f"{source.name}: loaded whole, as all text; binary PLY would be read in pieces")
    except (InputError, OSError):
        return None
    return stream if stream is not None and stream.loaded_bytes > limit else None


def _pieces(
    source: MeshSource, stream: MeshStream, store: Store, progress: Progress, most: int
) -> tuple[MeshSource, ...]:
    files = tuple(_file(path) for path in stream.files)
    note = _note_of(stream, files, store, most)
    if note is None:
        found = write_pieces(stream, store, source.name, progress, most)
        chunks = found.pieces + found.textures
        note = _SplitNote(chunks, _VERSION, most, files, len(found.pieces), found.warnings)
        store.put(_note_key(stream), msgspec.json.encode(note))
        progress.note(f"{source.name}: split into {counted(note.pieces, 'piece')}")
    for warning in note.warnings:
        progress.note(warning)
    return tuple(
        StoredPiece(store, chunk, f"{source.name}, piece {number}")
        for number, (chunk, _) in enumerate(note.chunks[: note.pieces])
    )


def _file(path: Path) -> _File:
    stat = path.stat()
    return _File(str(path.absolute()), stat.st_size, stat.st_mtime_ns)


def _note_key(stream: MeshStream) -> str:
    return split_key(content_hash(str(stream.files[0].absolute()).encode(), str(stream.part).encode()))


def _note_of(stream: MeshStream, files: tuple[_File, ...], store: Store, most: int) -> _SplitNote | None:
    """What the mesh became before, if its files are the same and all chunks are there."""
    try:
        note = msgspec.json.decode(store.get(_note_key(stream)), type=_SplitNote)
    except (MissingKeyError, *DAMAGE):
        return None
    if (note.version, note.most, note.files) != (_VERSION, most, files):
        return None
    return note if all(holds(store, chunk, size) for chunk, size in note.chunks) else None


def _with_parts(scene: Scene, parts: dict[int, tuple[MeshSource, ...]]) -> Scene:
    """The scene with each mesh replaced by its parts, none or several, and its instances by one of each part."""
    becomes = [parts.get(number, (source,)) for number, source in enumerate(scene.meshes)]
    counts = np.array([len(sources) for sources in becomes], np.int64)
    first = np.cumsum(counts) - counts
    own = scene.instances
    each = counts[own.mesh]
    row = np.repeat(np.arange(len(each)), each)
    part = np.arange(len(row)) - np.repeat(np.cumsum(each) - each, each)
    mesh = (first[own.mesh[row]] + part).astype(np.int32)
    meshes = tuple(source for sources in becomes for source in sources)
    instances = Instances(mesh, own.transform[row], own.first_object[row], own.objects[row])
    attributes = tuple(scene.attribute_parts[k] for k in row.tolist()) if scene.attribute_parts else ()
    return replace(scene, meshes=meshes, instances=instances, attribute_parts=attributes)
