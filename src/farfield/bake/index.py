"""Writing the index on the way up: a tile as soon as all its cells are known, so that none has to be kept (OV-6)."""

from __future__ import annotations

from farfield.bake.cell import BakedCell
from farfield.octree.grid import Grid
from farfield.store.contract import Store
from farfield.world.index import IndexTile, encode_index
from farfield.world.keys import content_hash, index_key

INDEX_DEPTH = 4
"""Levels of cells in one index tile: some 20 kB for a flat world. The lowest are the tops of the tiles below."""


def close_index_tile(store: Store, grid: Grid, cell: BakedCell) -> None:
    """Writes the index tile of which `cell` is the top, if it is one; what is below it is then listed there."""
    root = cell.key.level == grid.top_level
    top = (grid.top_level - cell.key.level) % (INDEX_DEPTH - 1) == 0 and bool(cell.record.entry.children)
    if not (root or top):
        return
    data = encode_index(IndexTile(str(cell.key), (cell.record.entry, *cell.listed)))
    name = content_hash(data)
    store.put(index_key(cell.key, name), data)
    cell.index, cell.listed = name, ()
