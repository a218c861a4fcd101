"""Writing the index tiles of a finished tree, lowest first, so that each can name those below it."""

from __future__ import annotations

import msgspec

from farfield.bake.cell import BakedCell
from farfield.octree.grid import CellKey, Grid
from farfield.store.contract import Store
from farfield.world.index import CellEntry, IndexTile, encode_index
from farfield.world.keys import content_hash, index_key


def write_index(store: Store, grid: Grid, root: BakedCell, depth: int) -> str:
    """Writes all index tiles below a root; returns the hash of the topmost."""
    entries = {entry.cell: entry for entry in (root.record.entry, *root.below)}
    return _write(store, grid, entries, root.key, depth)


def _write(store: Store, grid: Grid, entries: dict[CellKey, CellEntry], top: CellKey, depth: int) -> str:
    cells: list[CellEntry] = []
    pending = [top]
    while pending:
        key = pending.pop()
        entry = entries[key]
        if key.level == top.level - depth + 1 and entry.children:
            cells.append(msgspec.structs.replace(entry, index=_write(store, grid, entries, key, depth)))
            continue
        cells.append(entry)
        pending.extend(CellKey.parse(child) for child in reversed(entry.children))
    data = encode_index(IndexTile(str(top), tuple(cells)))
    name = content_hash(data)
    store.put(index_key(top, name), data)
    return name
