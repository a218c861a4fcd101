"""What baking a cell yields, and the note that lets an interrupted bake go on."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.octree.grid import CellKey
from farfield.store.contract import Store
from farfield.world.index import CellEntry
from farfield.world.keys import objects_key, orthoview_key, record_key
from farfield.world.limits import DAMAGE, Count

Tiles = dict[tuple[int, int], bytes]
"""(direction, layer) -> encoded tile."""


class Record(msgspec.Struct, frozen=True):
    """Note of the bake about a finished cell. Written after all that it names."""

    input: str
    """Hash of everything that the cell was made from."""
    entry: CellEntry
    triangles: Count = 0
    """Source triangles drawn in the leaf, pieces counted."""
    object_bytes: Count = 0
    """Bytes of its object id tiles."""


@dataclass(slots=True)
class BakedCell:
    """A finished cell: its record, and its tiles as long as its parent may need them."""

    key: CellKey
    record: Record
    fresh: bool
    """False when an earlier bake had already made it."""
    tiles: Tiles | None = None
    """None: read them from the store when needed."""
    objects: Tiles | None = None
    """Object id tiles of the first layers, likewise."""
    below: list[CellEntry] = field(default_factory=list)
    """Entries of all cells below, for the index."""
    rebuilt: int = 0
    """Cells baked afresh, at and below."""

    def tiles_from(self, store: Store) -> Tiles:
        """The encoded tiles, read back only when an earlier bake made them."""
        if self.tiles is None:
            entry = self.record.entry
            self.tiles = {
                (d, layer): store.get(orthoview_key(self.key, d, layer, entry.hash)) for d, layer, _ in entry.tiles
            }
        return self.tiles

    def objects_from(self, store: Store) -> Tiles:
        """The encoded object id tiles, likewise; empty when none are kept."""
        if self.objects is None:
            entry, self.objects = self.record.entry, {}
            if self.record.object_bytes:
                for d in sorted({d for d, layer, _ in entry.tiles if layer == 0}):
                    self.objects[d, 0] = store.get(objects_key(self.key, d, 0, entry.hash))
        return self.objects

    def release(self) -> None:
        """Forgets the tiles once the parent has them."""
        self.tiles = self.objects = None


def read_record(store: Store, key: CellKey, input_hash: str) -> Record | None:
    """The record of a cell made from the same input, or None: then the cell is baked anew."""
    try:
        record = decode_record(store.get(record_key(key)), key)
    except (MissingKeyError, CorruptTileError):
        return None
    return record if record.input == input_hash else None


def decode_record(data: bytes, key: CellKey) -> Record:
    """Reads the record of a cell; allocates at most 32 bytes for each byte of it.

    Raises CorruptTileError when it is none, or of another cell.
    """
    try:
        record = msgspec.json.decode(data, type=Record)
    except DAMAGE as error:
        raise CorruptTileError(f"record is damaged: {error}", record_key(key)) from None
    if record.entry.key != str(key):
        raise CorruptTileError(f"record of another cell, {record.entry.key[:80]!r}", record_key(key))
    return record


def write_record(store: Store, key: CellKey, record: Record) -> None:
    """Writes the note."""
    store.put(record_key(key), msgspec.json.encode(record))
