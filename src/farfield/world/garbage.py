"""Dropping what no longer belongs to a world: tiles of old generations, notes about cells that are gone, and parts of
the scene that no note names."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import msgspec

from farfield.progress import NoProgress, Progress
from farfield.store.contract import Store
from farfield.world import keys
from farfield.world.attributes import attribute_tables
from farfield.world.chunks import named_chunks
from farfield.world.index import decode_index
from farfield.world.limits import DAMAGE
from farfield.world.manifest import read_manifest
from farfield.world.reach import (
    blockmap_keys,
    blockmap_object_keys,
    first_index_tiles,
    geometry_keys,
    images_of,
    meshes_of,
    parted,
    textures_of,
)

_CELL = r"(-?\d+/-?\d+/-?\d+/-?\d+)"
_OF_CELL = re.compile(rf"(orthoview|objects|geometry|blockmap|index)/{_CELL}(?:/\d+/\d+|/blockmap)?(?:-([0-9a-f]+))?")
_RECORD = re.compile(rf"record/{_CELL}")
_NOTED = "orthoview", "geometry", "blockmap"
"""Kinds of values of which a bake's note about a cell tells the hash."""
_SHARED = re.compile(r"(mesh|texture|attributes|record/chunk)/([0-9a-f]+)")


@dataclass(frozen=True, slots=True)
class Dropped:
    """What was dropped, or would be."""

    keys: int
    bytes: int


@dataclass(slots=True)
class _Living:
    """What the current generation names. Some 300 bytes a cell."""

    named: dict[str, dict[str, str]] = field(default_factory=dict)
    """Kind → cell → hash."""
    shared: set[str] = field(default_factory=set)
    """Keys of geometry, BlockMaps and their object ids, meshes, textures, attributes and scene chunks."""

    def holds(self, key: str) -> bool:
        """Whether `key` belongs to the world; also true of what is none of its kinds of values."""
        if found := _OF_CELL.fullmatch(key):
            kind, cell, name = found.groups()
            if kind in ("geometry", "blockmap") or "/blockmap-" in key:
                return key in self.shared
            return self.named[kind].get(cell) == name
        return key in self.shared or _SHARED.fullmatch(key) is None


def drop_garbage(store: Store, dry: bool = False, progress: Progress | None = None) -> Dropped:
    """Removes the values that the world in `store` does not name. dry: only counts them.

    The viewer's files and whatever else lies there stay. Nothing is removed when any part of the index, or of the
    geometry that names images, cannot be read.
    Raises NotAWorldError, CorruptTileError, StoreError (a bake is under way among them).
    """
    progress = progress or NoProgress()
    with store.writing():
        living = _living(store, progress)
        progress.start(None, "values looked at")
        count = size = 0
        for key in store.list():
            progress.advance()
            if _is_true_record(store, key, living) if _RECORD.fullmatch(key) else living.holds(key):
                continue
            count += 1
            size += store.size(key)
            if not dry:
                store.delete(key)
        progress.finish()
    return Dropped(count, size)


class _Pictures(msgspec.Struct):
    """What a bake's note about a cell says of its values."""

    key: str = ""
    hash: str = ""
    output: str = ""
    geometry: _Hashed | None = None
    blockmap: _Hashed | None = None


class _Hashed(msgspec.Struct):
    hash: str = ""


class _Note(msgspec.Struct):
    entry: _Pictures


def _is_true_record(store: Store, key: str, living: _Living) -> bool:
    """Whether a note tells of a cell as the world has it.

    That of an update which was interrupted tells of values that are dropped here: kept, it would let the next one
    believe that they are there.
    """
    try:
        entry = msgspec.json.decode(store.get(key), type=_Note).entry
    except DAMAGE:
        return False
    cell = key.removeprefix("record/")
    if not entry.output:  # Nothing lies in the cell.
        return cell not in living.named["orthoview"]
    noted = {"orthoview": entry.hash}
    noted |= {"geometry": entry.geometry.hash} if entry.geometry else {}
    noted |= {"blockmap": entry.blockmap.hash} if entry.blockmap else {}
    return {kind: own[cell] for kind, own in living.named.items() if cell in own and kind in _NOTED} == noted


def _living(store: Store, progress: Progress) -> _Living:
    manifest = read_manifest(store)
    living = _Living({kind: {} for kind in (*_NOTED, "objects", "index")})
    living.shared |= named_chunks(store)
    if manifest.attributes:
        living.shared.add(keys.attributes_key(manifest.attributes))
        living.shared.update(attribute_tables(store, manifest.attributes))
    pending = first_index_tiles(manifest)
    progress.start(None, "cells read")
    while pending:
        cell, name = pending.pop()
        living.named["index"][str(cell)] = name
        key = keys.index_key(cell, name)
        below, entries = parted(decode_index(store.get(key), key))
        pending += below
        for entry in entries:
            living.named["orthoview"][entry.key] = living.named["objects"][entry.key] = entry.hash
            living.shared.update(keys.texture_key(name) for name in images_of(entry))
            if entry.blockmap:
                living.named["blockmap"][entry.key] = entry.blockmap.hash
            living.shared.update(key for key, _ in blockmap_keys(entry))
            living.shared.update(blockmap_object_keys(entry))
            if entry.geometry:
                living.named["geometry"][entry.key] = entry.geometry.hash
                for geometry, _ in geometry_keys(entry):
                    _add_shared(store, living, geometry)
                for mesh in meshes_of(entry):
                    _add_shared(store, living, keys.mesh_key(mesh))
            progress.advance()
    progress.finish()
    return living


def _add_shared(store: Store, living: _Living, key: str) -> None:
    """A GLB, if it is shared, and the images it names."""
    if key in living.shared:
        return
    living.shared.add(key)
    living.shared.update(keys.texture_key(name) for name in textures_of(store.get(key), key))
