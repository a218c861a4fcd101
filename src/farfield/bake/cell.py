"""What baking a cell yields, and the note that lets an interrupted bake go on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import msgspec

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.octree.grid import CellKey
from farfield.store.contract import Store
from farfield.world.index import CellEntry
from farfield.world.keys import objects_key, orthoview_key, record_key
from farfield.world.limits import DAMAGE, Count
from farfield.world.reach import blockmap_keys, geometry_keys, meshes_of

Tiles = dict[tuple[int, int], bytes]
"""(direction, layer) -> encoded tile."""


class Record(msgspec.Struct, frozen=True):
    """Note of the bake about a finished cell. Written after all that it names."""

    input: str
    """Hash of everything that the cell was made from; of a cell above the leaves, of what its pictures were."""
    entry: CellEntry
    triangles: Count = 0
    """Source triangles drawn in the leaf, pieces counted."""
    object_bytes: Count = 0
    """Bytes of its object id tiles."""
    drawn: str = ""
    """Of a leaf: hash of what its pictures were drawn from, its own part of the meshes that reach into it."""
    opaque: bool = False
    """Of a leaf: whether its own triangles, those of no shared mesh, have no holes cut out by alpha."""
    merged: str = ""
    """Of a cell above the leaves: hash of what its geometry was made from; empty: it may have none."""
    blockmap: str = ""
    """The same of its BlockMap."""


@dataclass(frozen=True, slots=True)
class Tally:
    """What a cell and all below it hold, counted on the way up so that nobody has to keep their entries."""

    cells: int = 0
    orthoviews: int = 0
    tiles: int = 0
    bytes: int = 0
    """Of tiles and near geometry, without the meshes that leaves share."""
    meshes: tuple[tuple[str, int], ...] = ()
    """Hash and bytes of each shared mesh, ascending."""
    rebuilt: int = 0
    """Cells baked afresh."""

    @classmethod
    def of(cls, entry: CellEntry, fresh: bool) -> Tally:
        """Of one cell."""
        return cls(
            cells=1,
            orthoviews=sum(layer == 0 for _, layer, _ in entry.tiles),
            tiles=len(entry.tiles),
            bytes=sum(size for _, _, size in entry.tiles)
            + sum(size for _, size in (*geometry_keys(entry), *blockmap_keys(entry))),
            meshes=tuple(sorted(meshes_of(entry).items())),
            rebuilt=int(fresh),
        )

    @classmethod
    def sum(cls, tallies: Iterable[Tally]) -> Tally:
        """Of several; a mesh that they share counts once."""
        listed = list(tallies)
        return cls(
            cells=sum(t.cells for t in listed),
            orthoviews=sum(t.orthoviews for t in listed),
            tiles=sum(t.tiles for t in listed),
            bytes=sum(t.bytes for t in listed),
            meshes=tuple(sorted({mesh for t in listed for mesh in t.meshes})),
            rebuilt=sum(t.rebuilt for t in listed),
        )


@dataclass(frozen=True, slots=True)
class Standing:
    """What geometry of the cells above has to know of a cell."""

    is_solid: bool = False
    """Whether all of it but for the instances that its leaves list can be merged."""
    leaves: int = 1
    """At and below it."""
    lists: bool = False
    """Whether any of these lists instances."""
    boxes: tuple[tuple[float, ...], ...] = ()
    """Round all instances that they list, local metres, lower and upper corners; none where there are too many leaves
    for any cell above to have geometry."""


@dataclass(slots=True)
class BakedCell:
    """A finished cell: its record, and its tiles and geometry as long as its parent may need them."""

    key: CellKey
    record: Record
    tally: Tally
    standing: Standing = Standing()
    index: str = ""
    """Hash of the index tile that it is the top of; empty: it is listed in the tile of a cell above."""
    listed: tuple[CellEntry, ...] = ()
    """Entries of the cells below it that are to be listed in the same index tile as itself."""
    tiles: Tiles | None = None
    """None: read them from the store when needed."""
    objects: Tiles | None = None
    """Object id tiles of the first layers, likewise."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Its geometry by key; what is not here is in the store."""

    @property
    def entries(self) -> tuple[CellEntry, ...]:
        """Its entry and those below it, as an index tile lists them."""
        entry = self.record.entry
        return (msgspec.structs.replace(entry, index=self.index) if self.index else entry, *self.listed)

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

    def file_from(self, store: Store, key: str) -> bytes:
        """A form of its geometry, likewise."""
        return self.files[key] if key in self.files else store.get(key)

    def release(self) -> None:
        """Forgets the tiles and the geometry once the parent has them."""
        self.tiles = self.objects = None
        self.files = {}


def read_record(store: Store, key: CellKey, input_hash: str) -> Record | None:
    """The record of a cell made from the same input, or None: then the cell is baked anew."""
    record = latest_record(store, key)
    return record if record is not None and record.input == input_hash else None


def latest_record(store: Store, key: CellKey) -> Record | None:
    """The record of a cell, whatever it was made from; None: there is none that can be read."""
    try:
        return decode_record(store.get(record_key(key)), key)
    except (MissingKeyError, CorruptTileError):
        return None


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
