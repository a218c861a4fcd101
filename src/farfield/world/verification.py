"""Checks every value of a world and of its scene against the hash in its name, and the index against what is there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

from farfield.errors import CorruptTileError, MissingKeyError, StoreError
from farfield.progress import NoProgress, Progress
from farfield.represent.blockmap.coding import decode_blockmap, decode_objects
from farfield.represent.orthoview.object_tile import decode_object_tile
from farfield.represent.orthoview.tile import decode_tile
from farfield.store.contract import Store
from farfield.world import keys
from farfield.world.attributes import attribute_tables
from farfield.world.chunks import SCENE, named_chunks, read_scene_values
from farfield.world.index import CellEntry, decode_index
from farfield.world.reach import (
    blockmap_keys,
    blockmap_object_keys,
    first_index_tiles,
    geometry_keys,
    images_of,
    meshes_of,
    object_keys,
    parted,
    textures_of,
    tile_keys,
)
from farfield.world.world import World


class Fault(NamedTuple):
    """Something that is not as it should be."""

    key: str
    what: str


@dataclass(frozen=True, slots=True)
class Verification:
    """What was found."""

    cells: int
    tiles: int
    """Values checked: orthoview layers, object ids, index tiles, geometry, meshes, textures, attributes, the scene."""
    bytes: int
    """Of all of them."""
    faults: tuple[Fault, ...]
    """In the order of the index."""


class _Report(NamedTuple):
    """What the check of one part found."""

    tiles: int = 0
    bytes: int = 0
    faults: tuple[Fault, ...] = ()
    textures: tuple[str, ...] = ()
    """Hashes of the images that the part refers to."""


def verify_world(world: World, progress: Progress | None = None) -> Verification:
    """Read everything the index of `world` names. Faults are collected, none ends the check.

    A cell whose tiles have the hash in their name is not decoded: 17 directions take some milliseconds to hash and
    half a second to decode. Only where the hash is another are its tiles decoded, to name the one at fault.
    """
    progress = progress or NoProgress()
    store = world.store
    index_report, entries = _read_index(world)
    reports = [index_report]
    progress.start(len(entries), "cells")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for report in pool.map(lambda entry: _check_cell(store, entry), entries):
            reports.append(report)
            progress.advance()
        reports += pool.map(lambda key: _check_hashed(store, key), _meshes_of(entries))
        named = (name for report in reports for name in report.textures)
        textures = dict.fromkeys([*named, *(name for entry in entries for name in images_of(entry))])
        others = [keys.texture_key(name) for name in textures]
        if world.manifest.attributes:
            others += _attributes_of(store, world.manifest.attributes)
        scene_report, scene_values = _read_scene(store)
        reports.append(scene_report)
        others += scene_values
        reports += pool.map(lambda key: _check_hashed(store, key), dict.fromkeys(others))
    progress.finish()
    faults = tuple(dict.fromkeys(fault for report in reports for fault in report.faults))
    return Verification(len(entries), sum(r.tiles for r in reports), sum(r.bytes for r in reports), faults)


def _attributes_of(store: Store, name: str) -> list[str]:
    """Keys of the index of attributes and of its tables, which are unknown when it is damaged."""
    try:
        tables = attribute_tables(store, name)
    except (CorruptTileError, StoreError):
        tables = []
    return [keys.attributes_key(name), *tables]


def _read_scene(store: Store) -> tuple[_Report, list[str]]:
    """The note of what the scene is made of, without which a world is whole, and keys of all that notes name."""
    try:
        values = read_scene_values(store)
    except MissingKeyError:
        values = []
    except (CorruptTileError, StoreError) as error:
        return _Report(faults=(Fault(SCENE, error.what),)), []
    try:
        return _Report(), sorted(named_chunks(store))
    except StoreError:  # A web server does not list the other notes.
        return _Report(), values


def _read_index(world: World) -> tuple[_Report, list[CellEntry]]:
    """Every cell that the index lists, once, and how the index itself is."""
    reports: list[_Report] = []
    entries: list[CellEntry] = []
    pending = first_index_tiles(world.manifest)
    seen: set[str] = set()
    while pending:
        cell, name = pending.pop()
        key = keys.index_key(cell, name)
        if key in seen:
            continue
        seen.add(key)
        report = _check_hashed(world.store, key)
        reports.append(report)
        if report.faults:
            continue
        try:
            below, cells = parted(decode_index(world.store.get(key), key))
        except (CorruptTileError, StoreError) as error:
            reports.append(_Report(faults=(Fault(key, error.what),)))
            continue
        pending += below
        entries += cells
    return _sum(reports), entries


def _check_cell(store: Store, entry: CellEntry) -> _Report:
    parts = [_check_tiles(store, entry)] if entry.tiles else []
    parts += [_check_hashed(store, key, size) for key, size in geometry_keys(entry)]
    keyed = zip(blockmap_keys(entry), blockmap_object_keys(entry), strict=True)
    parts += [_check_blockmap(store, *of_map, of_ids) for of_map, of_ids in keyed]
    return _sum(parts)


def _check_tiles(store: Store, entry: CellEntry) -> _Report:
    """The orthoview tiles of a cell and their object ids, which together make its hash."""
    tiles, objects = tile_keys(entry), object_keys(entry)
    try:
        found = [store.get(key) for key in tiles]
        ids = [store.get(key) for key in objects if store.exists(key)]
    except StoreError:
        found = ids = []
    if found and keys.content_hash(*found, *ids) == entry.hash:
        return _Report(len(found) + len(ids), sum(map(len, found)) + sum(map(len, ids)))
    faults = list(_tile_faults(store, tiles, objects))
    if not faults:
        where = f"orthoview/{entry.cell}"
        faults = [Fault(where, f"tiles are whole, but not those with the hash {entry.hash}")]
    return _Report(len(tiles), sum(map(len, found)), tuple(faults))


def _tile_faults(store: Store, tiles: Iterable[str], objects: Iterable[str]) -> Iterator[Fault]:
    for tile_key, objects_key in zip(tiles, objects, strict=True):
        try:
            tile = decode_tile(store.get(tile_key), tile_key)
        except (CorruptTileError, StoreError) as error:
            yield Fault(tile_key, error.what)
            continue
        try:
            decode_object_tile(store.get(objects_key), tile.layer, objects_key)
        except MissingKeyError:
            continue
        except (CorruptTileError, StoreError) as error:
            yield Fault(objects_key, error.what)


def _check_blockmap(store: Store, key: str, length: int, ids_key: str) -> _Report:
    """A BlockMap and its object ids, which together make its hash."""
    try:
        data = store.get(key)
        ids = [store.get(ids_key)] if store.exists(ids_key) else []
    except StoreError as error:
        return _Report(1, 0, (Fault(key, error.what),))
    found = _Report(1 + len(ids), len(data) + sum(map(len, ids)))
    if keys.content_hash(data, *ids) == key[-16:] and len(data) == length:
        return found
    faults = []
    for one, value, decode in ((key, data, decode_blockmap), *((ids_key, value, decode_objects) for value in ids)):
        try:
            decode(value, one)
        except CorruptTileError as error:
            faults.append(Fault(one, error.what))
    what = "is whole, but it and its object ids are not those with that hash"
    return found._replace(faults=tuple(faults) or (Fault(key, what),))


def _check_hashed(store: Store, key: str, length: int | None = None) -> _Report:
    """A value whose own hash ends its name."""
    try:
        data = store.get(key)
    except StoreError as error:
        return _Report(1, 0, (Fault(key, error.what),))
    if length is not None and len(data) != length:
        return _Report(1, len(data), (Fault(key, f"has {len(data)} bytes, the index says {length}"),))
    if keys.content_hash(data) != key[-16:]:
        return _Report(1, len(data), (Fault(key, "is altered: its hash is another"),))
    try:
        textures = tuple(textures_of(data, key))
    except CorruptTileError as error:
        return _Report(1, len(data), (Fault(key, error.what),))
    return _Report(1, len(data), (), textures)


def _meshes_of(entries: Iterable[CellEntry]) -> list[str]:
    return [keys.mesh_key(name) for name in dict.fromkeys(name for entry in entries for name in meshes_of(entry))]


def _sum(parts: list[_Report]) -> _Report:
    return _Report(
        sum(part.tiles for part in parts),
        sum(part.bytes for part in parts),
        tuple(fault for part in parts for fault in part.faults),
        tuple(name for part in parts for name in part.textures),
    )
