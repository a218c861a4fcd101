"""Baking again what is bad in a world: notes about its cells are taken away, and the next bake makes them anew."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from farfield.errors import FarfieldError
from farfield.octree.grid import CellKey
from farfield.store.contract import Store
from farfield.world import keys
from farfield.world.index import CellEntry
from farfield.world.reach import geometry_keys, images_of, meshes_of, textures_of
from farfield.world.world import World

_CELL = re.compile(r"(?:orthoview|objects|geometry|blockmap)/(-?\d+/-?\d+/-?\d+/-?\d+)")


def forget(world: World, bad: Iterable[str]) -> None:
    """Makes the next bake of the same input write the values under these keys anew.

    Tiles and near geometry: the note about their cell goes. Meshes and images that leaves share: the value goes, and
    the note about one leaf that needs it. Tables of attributes and parts of the scene go, to be
    written by the next bake of the sources as index tiles are. Raises StoreError.
    """
    store = world.store
    shared: set[str] = set()
    for key in bad:
        if found := _CELL.match(key):
            store.delete(keys.record_key(CellKey.parse(found[1])))
        elif key.startswith(("mesh/", "texture/")):
            shared.add(key)
            store.delete(key)
        elif key.startswith(("attributes/", "record/chunk/")):
            store.delete(key)
    if shared:
        _forget_users(world, shared)


def _forget_users(world: World, shared: set[str]) -> None:
    for entry in _readable_cells(world):
        if not shared:
            return
        needed = shared & set(_needs(world.store, entry))
        if needed:
            store_key = keys.record_key(entry.cell)
            world.store.delete(store_key)
            shared -= needed


def _needs(store: Store, entry: CellEntry) -> Iterator[str]:
    """Keys of the meshes and images that a leaf's near geometry refers to; a missing mesh's images are unknown."""
    own = [key for key, _ in geometry_keys(entry)]
    meshes = [keys.mesh_key(name) for name in meshes_of(entry)]
    yield from meshes
    yield from (keys.texture_key(name) for name in images_of(entry))
    for key in (*own, *meshes):
        try:
            yield from (keys.texture_key(name) for name in textures_of(store.get(key), key))
        except FarfieldError:
            continue


def _readable_cells(world: World) -> Iterator[CellEntry]:
    """Every cell that the index still tells of."""
    pending = list(world.roots)
    while pending:
        try:
            entry = world.entry(pending.pop())
        except (FarfieldError, KeyError):
            continue
        yield entry
        pending += [CellKey.parse(child) for child in entry.children]
