"""What a world consists of: from the manifest by the index to every value that is named on the way."""

from __future__ import annotations

from farfield.octree.grid import CellKey
from farfield.represent.geometry.read import texture_hashes
from farfield.world import keys
from farfield.world.index import CellEntry, IndexTile
from farfield.world.manifest import Manifest

IndexRoot = tuple[CellKey, str]
"""Cell and hash of an index tile."""


def first_index_tiles(manifest: Manifest) -> list[IndexRoot]:
    """The index tiles that the manifest names."""
    return [(CellKey.parse(root.key), root.hash) for root in manifest.roots]


def parted(tile: IndexTile) -> tuple[list[IndexRoot], list[CellEntry]]:
    """The index tiles below `tile`, and its cells without those that stand in these again, as their first."""
    below = [(entry.cell, entry.index) for entry in tile.cells if entry.index]
    return below, [entry for entry in tile.cells if not entry.index]


def tile_keys(entry: CellEntry) -> list[str]:
    """Keys of the orthoview tiles of a cell."""
    return [keys.orthoview_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in entry.tiles]


def object_keys(entry: CellEntry) -> list[str]:
    """Keys under which the object ids of those tiles are, where there are any."""
    return [keys.objects_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in entry.tiles]


def textures_of(data: bytes, where: str) -> tuple[str, ...]:
    """Hashes of the images that a GLB refers to; none for anything else. Raises CorruptTileError: a damaged GLB."""
    return texture_hashes(data, where) if data.startswith(b"glTF") else ()
