"""Encoding and storing the tiles of one cell."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from farfield.bake.cell import Tiles
from farfield.bake.context import BakeContext
from farfield.bake.likeness import Layers
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey
from farfield.represent.orthoview.connectivity import mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import encode_object_tile
from farfield.represent.orthoview.quality import QUALITIES
from farfield.represent.orthoview.tile import encode_tile
from farfield.represent.orthoview.view_table import ViewTable, choose_views
from farfield.world.index import pack_picks
from farfield.world.keys import content_hash, objects_key, orthoview_key


class CellTiles:
    """The tiles of a cell while it is baked."""

    def __init__(self, context: BakeContext, key: CellKey) -> None:
        self._context = context
        self._key = key
        self.encoded: Tiles = {}
        self.objects: Tiles = {}
        self.table = ViewTable(())
        self._drawn: dict[int, list[OrthoLayer]] = {}

    def make(self, draw: Callable[[Direction], list[OrthoLayer]]) -> None:
        """Draws, connects and encodes every view, and chooses between them; draw: the layers of one view."""
        context = self._context

        def view(direction: Direction) -> list[OrthoLayer]:
            layers = draw(direction)
            self._add(direction, layers)
            return layers

        made = zip(context.directions, context.each(view, context.directions), strict=True)
        drawn = {direction.number: layers for direction, layers in made if layers}
        sizes = {place: len(tile) for place, tile in self.encoded.items()}
        self.table = choose_views(drawn, sizes, context.directions, context.grid, self._key, context.each)
        self._drawn = drawn

    def take_layers(self, places: Iterable[tuple[int, int]]) -> Layers:
        """Some layers as they were drawn; all are forgotten then."""
        drawn, self._drawn = self._drawn, {}
        directions = {direction.number: direction for direction in self._context.directions}
        return {(number, layer): (directions[number], drawn[number][layer]) for number, layer in places}

    def _add(self, direction: Direction, layers: list[OrthoLayer]) -> None:
        """Connects and encodes the layers of one view; object ids of the first layer only."""
        options = self._context.job.options
        for index, layer in enumerate(layers):
            mark_connected(layer)
            place = direction.number, index
            quality = QUALITIES[options.quality]
            self.encoded[place] = encode_tile(layer, direction.number, index, self._key.level, quality)
            if index == 0 and options.object_ids and layer.objects is not None:
                self.objects[place] = encode_object_tile(layer, direction.number, index, self._key.level)

    def listing(self) -> tuple[tuple[int, int, int], ...]:
        """(direction, layer, bytes) of each tile, ascending."""
        return tuple((d, i, len(self.encoded[d, i])) for d, i in sorted(self.encoded))

    def picked(self) -> tuple[str, str, str]:
        """For every view bin the picked tiles as the index writes them."""
        return pack_picks(self.table.picks)

    @property
    def object_bytes(self) -> int:
        """Bytes of the object id tiles."""
        return sum(map(len, self.objects.values()))


def store_tiles(context: BakeContext, key: CellKey, tiles: CellTiles) -> str:
    """Writes the tiles under the hash of them all; returns the hash."""
    everything = [tiles.encoded[place] for place in sorted(tiles.encoded)]
    cell_hash = content_hash(*everything, *(tiles.objects[place] for place in sorted(tiles.objects)))
    values = [(orthoview_key(key, *place, cell_hash), data) for place, data in tiles.encoded.items()]
    values += [(objects_key(key, *place, cell_hash), data) for place, data in tiles.objects.items()]
    for _ in context.each(lambda value: context.store.put(*value), values):
        pass
    return cell_hash
