"""Opening a world and finding things in it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.octree.grid import CellKey, Grid
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import decode_object_tile
from farfield.represent.orthoview.tile import DecodedTile, decode_tile
from farfield.store.contract import Store
from farfield.world import keys
from farfield.world.index import CellEntry, decode_index
from farfield.world.manifest import Manifest, read_manifest
from farfield.world.split import joined

_HINT = "run farfield verify"


class World:
    """A baked world, read through its store. Index tiles are loaded when they are first needed and kept.

    It is a `Tree` for `farfield.octree.cut.cut`.
    """

    def __init__(self, store: Store, manifest: Manifest) -> None:
        self.store = store
        self.manifest = manifest
        self.grid: Grid = manifest.octree
        self._entries: dict[CellKey, CellEntry] = {}
        self._loaded: set[str] = set()

    @classmethod
    def open(cls, store: Store) -> World:
        """Reads the manifest; of a world that is split over servers, what all of them have is read from then on.

        Raises NotAWorldError, VersionError or StoreError.
        """
        manifest = read_manifest(store)
        return cls(joined(store, manifest), manifest)

    @property
    def roots(self) -> tuple[CellKey, ...]:
        """Keys of the root cells."""
        return self.manifest.root_keys

    def entry(self, key: CellKey) -> CellEntry:
        """What the index says of a cell.

        Raises KeyError when the cell holds nothing, and CorruptTileError when the index says that it holds something
        but is damaged there.
        """
        if key not in self._entries:
            try:
                self._load_index_of(key)
            except KeyError:
                if not self._is_listed(key):
                    raise
                raise CorruptTileError("the index lists this cell but tells nothing of it", str(key), _HINT) from None
        return self._entries[key]

    def children(self, key: CellKey) -> tuple[CellKey, ...]:
        """Cells below `key` that hold something, ascending. Raises CorruptTileError when the index is damaged there."""
        found = tuple(CellKey.parse(child) for child in self.entry(key).children)
        # Else a cell could be reached on many ways, and a walk of a small index take for ever.
        if any(self.grid.parent(child) != key for child in found):
            raise CorruptTileError("the index lists cells of other parents below this one", str(key), _HINT)
        return found

    def cells(self) -> Iterator[CellEntry]:
        """Every cell, parents before children. Raises CorruptTileError where the index is damaged."""
        pending = list(self.roots)
        while pending:
            key = pending.pop()
            yield self.entry(key)
            pending.extend(reversed(self.children(key)))

    def tile(self, entry: CellEntry, direction: int, layer: int) -> DecodedTile:
        """One layer of one orthoview, decoded. Raises CorruptTileError when it is missing, damaged or another's."""
        key = keys.orthoview_key(entry.cell, direction, layer, entry.hash)
        try:
            tile = decode_tile(self.store.get(key), key)
        except MissingKeyError:
            raise CorruptTileError("tile is missing", key, _HINT) from None
        if (tile.level, tile.direction, tile.index) != (entry.cell.level, direction, layer):
            raise CorruptTileError("the tile belongs to another cell or view", key, _HINT)
        return tile

    def object_ids(self, entry: CellEntry, direction: int, layer: int, of: OrthoLayer) -> NDArray[np.uint32] | None:
        """(h, w) object ids of that tile, which is decoded already; None: it has none. Raises CorruptTileError."""
        key = keys.objects_key(entry.cell, direction, layer, entry.hash)
        try:
            return decode_object_tile(self.store.get(key), of, key)
        except MissingKeyError:
            return None

    def _is_listed(self, key: CellKey) -> bool:
        """Whether the manifest or the entry of its parent names a cell."""
        if key.level >= self.grid.top_level:
            return key in self.roots
        above = self._entries.get(self.grid.parent(key))
        return above is not None and str(key) in above.children

    def _load_index_of(self, key: CellKey) -> None:
        """Loads index tiles from the root down until the cell is known."""
        if key.level > self.grid.top_level:
            raise KeyError(key)
        root = self.grid.ancestor(key, self.grid.top_level)
        tiles = {r.key: r.hash for r in self.manifest.roots}
        if str(root) not in tiles:
            raise KeyError(key)
        self._load(root, tiles[str(root)])
        depth = self.manifest.index_depth
        for level in range(root.level - depth + 1, key.level, -(depth - 1)):
            top = self.grid.ancestor(key, level)
            if top not in self._entries:
                raise KeyError(key)
            if self._entries[top].index:
                self._load(top, self._entries[top].index)
        if key not in self._entries:
            raise KeyError(key)

    def _load(self, root: CellKey, tile_hash: str) -> None:
        name = keys.index_key(root, tile_hash)
        if name in self._loaded:
            return
        try:
            data = self.store.get(name)
        except MissingKeyError:
            raise CorruptTileError("index tile is missing", name, _HINT) from None
        tile = decode_index(data, name)
        if tile.root != str(root):
            raise CorruptTileError(f"index tile of another cell, {tile.root}", name, _HINT)
        for entry in tile.cells:
            known = self._entries.get(entry.cell)
            if known is None or not known.index:
                self._entries[entry.cell] = entry
        self._loaded.add(name)
