"""Encoding and storing the tiles of one cell."""

from __future__ import annotations

from farfield.bake.cell import Tiles
from farfield.bake.context import BakeContext
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey
from farfield.represent.orthoview.connectivity import mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import encode_object_tile
from farfield.represent.orthoview.quality import QUALITIES
from farfield.represent.orthoview.tile import encode_tile
from farfield.world.keys import content_hash, objects_key, orthoview_key


class CellTiles:
    """The tiles of a cell while it is baked."""

    def __init__(self, context: BakeContext, key: CellKey) -> None:
        self._quality = QUALITIES[context.job.options.quality]
        self._object_ids = context.job.options.object_ids
        self._key = key
        self.encoded: Tiles = {}
        self.objects: Tiles = {}
        self.views: tuple[tuple[int, ...], ...] = ()

    def add(self, direction: Direction, layers: list[OrthoLayer]) -> None:
        """Connects and encodes the layers of one view; object ids of the first layer only."""
        for index, layer in enumerate(layers):
            mark_connected(layer)
            place = direction.number, index
            self.encoded[place] = encode_tile(layer, direction.number, index, self._key.level, self._quality)
            if index == 0 and self._object_ids and layer.objects is not None:
                self.objects[place] = encode_object_tile(layer, direction.number, index, self._key.level)

    def listing(self) -> tuple[tuple[int, int, int], ...]:
        """(direction, layer, bytes) of each tile, ascending."""
        return tuple((d, i, len(self.encoded[d, i])) for d, i in sorted(self.encoded))

    @property
    def object_bytes(self) -> int:
        """Bytes of the object id tiles."""
        return sum(map(len, self.objects.values()))


def store_tiles(context: BakeContext, key: CellKey, tiles: CellTiles) -> str:
    """Writes the tiles under the hash of them all; returns the hash."""
    everything = [tiles.encoded[place] for place in sorted(tiles.encoded)]
    cell_hash = content_hash(*everything, *(tiles.objects[place] for place in sorted(tiles.objects)))
    for (direction, layer), data in tiles.encoded.items():
        context.store.put(orthoview_key(key, direction, layer, cell_hash), data)
    for (direction, layer), data in tiles.objects.items():
        context.store.put(objects_key(key, direction, layer, cell_hash), data)
    return cell_hash
