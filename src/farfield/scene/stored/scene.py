"""What a world was baked from, as a value of its store: a part of it can be replaced without reading the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.scene.model import Instances, MeshSource, Scene
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk
from farfield.scene.stored.footprints import StoredFootprints
from farfield.scene.stored.sources import Words, print_of, source_of, words_of
from farfield.store.contract import Store
from farfield.world.chunks import put_scene_values, scene_values
from farfield.world.keys import attributes_key, chunk_key
from farfield.world.limits import Count, Vector

KEY = "record/scene"
KIND = "scene"
_LARGEST = 1e12
"""Metres (spec/world.md, Limits)."""


@dataclass(frozen=True, slots=True)
class MeshSummary:
    """What is known of a mesh once it was loaded."""

    boxes: NDArray[np.float64]
    """(b, 2, 3) float64: bounds of each block of triangles, mesh frame; b = 0 for a mesh that cannot be used."""
    triangles: int
    content: str
    """Hash of geometry and materials."""
    notes: tuple[str, ...] = ()
    """What loading left out and why."""


class _MeshNote(msgspec.Struct, frozen=True):
    source: Words
    print: list[int] | None
    triangles: Count
    content: str
    blocks: Count
    notes: tuple[str, ...]


class _SceneNote(msgspec.Struct, frozen=True):
    version: int
    meshes: tuple[_MeshNote, ...]
    name: str
    crs: str | None
    origin: Vector
    credits: tuple[str, ...]
    families: tuple[str, ...]
    source_bytes: Count
    attribute_parts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StoredScene:
    """The scene of a world, and what is known of its meshes."""

    scene: Scene
    """Without columns of attributes: they are stored by part."""
    summaries: list[MeshSummary]
    prints: list[list[int] | None]
    """(meshes,) `print_of` each source when it was summed up."""

    def known(self, sources: Sequence[MeshSource]) -> list[MeshSummary | None]:
        """What is known of other sources because they are among those of the scene, and have not changed since.

        Of files that are gone this is all that can be known: their meshes stay in the scene, and are missed when a cell
        that they reach into has to be drawn.
        """
        have: dict[bytes, MeshSummary] = {}
        for source, before, summary in zip(self.scene.meshes, self.prints, self.summaries, strict=True):
            if summary.content:
                have[_identity(source, before)] = have[_identity(source, "any")] = summary
        return [have.get(_identity(source, _told(source))) for source in sources]


def _told(source: MeshSource) -> list[int] | str:
    """What there is to tell its file by: "any" for one that is gone, "none" for one that always may have changed."""
    path = getattr(source, "path", None)
    if path is not None and not path.exists():
        return "any"
    fingerprint = print_of(source)
    return "none" if fingerprint is None else fingerprint


def _identity(source: MeshSource, fingerprint: list[int] | str | None) -> bytes:
    if isinstance(source, StoredFootprints):  # The same in a file of another name.
        return msgspec.json.encode((source.chunk, source.facades))
    return msgspec.json.encode((words_of(source), fingerprint))


def write_scene(
    store: Store,
    scene: Scene,
    summaries: Sequence[MeshSummary],
    prints: Sequence[list[int] | None],
    version: int,
) -> None:
    """Makes the scene the store's, if it can be told in words; otherwise nothing is kept. Raises StoreError.

    prints: `print_of` each mesh before it was summed up: a file that has changed since is not the one that is known.
    version: of the bake: what another one knew of meshes says nothing.
    """
    notes = []
    for source, summary, before in zip(scene.meshes, summaries, prints, strict=True):
        words = words_of(source)
        if words is None:
            store.delete(KEY)
            put_scene_values(store, ())
            return
        fingerprint = before if print_of(source) == before else None
        notes.append(_MeshNote(words, fingerprint, summary.triangles, summary.content, len(summary.boxes),
                               summary.notes))  # fmt: skip
    about = _SceneNote(
        version, tuple(notes), scene.name, scene.crs, scene.origin, scene.credits, scene.families, scene.source_bytes,
        scene.attribute_parts,
    )  # fmt: skip
    own = scene.instances
    arrays: dict[str, NDArray[Any]] = {
        "boxes": np.concatenate([summary.boxes for summary in summaries]) if summaries else np.empty((0, 2, 3)),
        "mesh": own.mesh,
        "transform": own.transform,
        "first_object": own.first_object,
        "objects": own.objects,
    }
    values = [chunk_key(note.source["chunk"]) for note in notes if "chunk" in note.source]
    values += [attributes_key(part) for part in scene.attribute_parts if part]
    # Whichever of the two scenes a crash leaves, what it is made of is no garbage.
    put_scene_values(store, [*scene_values(store), *values])
    store.put(KEY, encode_chunk(SceneChunk(KIND, msgspec.to_builtins(about), arrays)))
    put_scene_values(store, values)


def read_scene_of(store: Store, version: int) -> StoredScene | None:
    """The scene of the world in a store; None when it keeps none, or one of another version of the bake.

    Allocates at most 32 bytes for each byte of its JSON. Raises CorruptTileError and StoreError.
    """
    try:
        data = store.get(KEY)
    except MissingKeyError:
        return None
    return decode_scene(data, store, version)


def decode_scene(data: bytes, store: Store, version: int) -> StoredScene | None:
    """See `read_scene_of`."""
    chunk = decode_chunk(data, KIND, KEY)
    if chunk.about.get("version") != version:
        return None
    try:
        return _scene(msgspec.convert(chunk.about, _SceneNote), chunk.arrays, store)
    except (KeyError, TypeError, ValueError) as error:
        raise CorruptTileError(f"the scene's note is damaged: {error}", KEY, "bake the world again") from None


def object_count(first: NDArray[np.int64], objects: NDArray[np.int64]) -> int:
    """Objects of some instances: those with the same first object are the same."""
    return int(objects[np.unique(first, return_index=True)[1]].sum())


def _scene(about: _SceneNote, arrays: dict[str, NDArray[Any]], store: Store) -> StoredScene:
    mesh, transform, first, objects = (arrays[name] for name in ("mesh", "transform", "first_object", "objects"))
    boxes = arrays["boxes"]
    kinds = [{a.dtype.kind for a in like} for like in ((mesh, first, objects), (transform, boxes))]
    if kinds != [{"i"}, {"f"}]:
        raise ValueError("arrays of other kinds")
    count, meshes, blocks = len(mesh), len(about.meshes), sum(note.blocks for note in about.meshes)
    shapes = ((count,), (count, 3, 4), (count,), (count,), (blocks, 2, 3))
    if tuple(a.shape for a in (mesh, transform, first, objects, boxes)) != shapes:
        raise ValueError("arrays of different lengths")
    parts = about.attribute_parts
    if count and (int(mesh.min()) < 0 or int(mesh.max()) >= meshes or int(objects.min()) < 0):
        raise ValueError("instances of no mesh")
    if len(parts) not in (0, count) or (count and int(objects.max()) > 1 << 32):
        raise ValueError("attributes that do not fit, or more objects than there are ids")
    if not ((np.abs(transform) <= _LARGEST).all() and (np.abs(boxes) <= _LARGEST).all()):
        raise ValueError("a coordinate that is no number, or too large")
    ends = np.cumsum([note.blocks for note in about.meshes], dtype=np.int64)
    of_mesh = np.split(boxes, ends[:-1])
    scene = Scene(
        tuple(source_of(note.source, store) for note in about.meshes),
        Instances(mesh.astype(np.int32), transform.astype(np.float64), first, objects),
        about.name, about.crs, about.origin, about.credits, about.source_bytes, object_count(first, objects),
        attribute_parts=parts, families=about.families,
    )  # fmt: skip
    summaries = [
        MeshSummary(own, note.triangles, note.content, note.notes)
        for own, note in zip(of_mesh, about.meshes, strict=True)
    ]
    return StoredScene(scene, summaries, [note.print for note in about.meshes])
