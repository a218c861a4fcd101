"""Tiles of a world as a renderer wants them: decoded ahead on a second thread, kept for the next picture."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

from farfield.errors import CorruptTileError
from farfield.octree.grid import CellKey
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.world.index import CellEntry
from farfield.world.world import World

Place = tuple[int, int]
"""Direction and layer."""

DEFAULT_CACHE_BYTES = 512 << 20
THREADS = 2
AHEAD = 8
"""Cells that are decoded before they are drawn."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A cell and the tiles of it that a picture needs."""

    key: CellKey
    places: tuple[Place, ...]


class TileCache:
    """Decoded layers of one world, the least recently used thrown out first. Used by one thread at a time."""

    def __init__(self, world: World, capacity: int = DEFAULT_CACHE_BYTES) -> None:
        """capacity: bytes of decoded arrays to keep."""
        self.world = world
        self._capacity = capacity
        self._held: OrderedDict[tuple[CellKey, Place, bool], OrthoLayer] = OrderedDict()
        self._bytes = 0

    def cells(
        self, wanted: Sequence[Wanted], objects: bool = False
    ) -> Iterator[tuple[Wanted, list[OrthoLayer] | CorruptTileError]]:
        """Each wanted cell in its order with its layers in the order of its places, or why they cannot be read.

        objects: whether the layers shall have object ids, as far as there are any.
        """
        with ThreadPoolExecutor(THREADS) as pool:
            running: list[list[Future[OrthoLayer] | OrthoLayer]] = []
            for position, cell in enumerate(wanted):
                for ahead in wanted[position + len(running) : position + AHEAD]:
                    running.append([self._begin(pool, ahead.key, place, objects) for place in ahead.places])
                yield cell, self._finish(cell, running.pop(0), objects)

    def layers(self, cell: Wanted, objects: bool = False) -> list[OrthoLayer]:
        """The same for one cell, at once. Raises CorruptTileError."""
        return [self._keep(cell.key, place, objects, self._read(cell.key, place, objects)) for place in cell.places]

    def _begin(
        self, pool: ThreadPoolExecutor, key: CellKey, place: Place, objects: bool
    ) -> Future[OrthoLayer] | OrthoLayer:
        held = self._held.get((key, place, objects))
        if held is not None:
            self._held.move_to_end((key, place, objects))
            return held
        return pool.submit(self._read, key, place, objects)

    def _finish(
        self, cell: Wanted, running: list[Future[OrthoLayer] | OrthoLayer], objects: bool
    ) -> list[OrthoLayer] | CorruptTileError:
        layers = []
        try:
            for place, layer in zip(cell.places, running, strict=True):
                if isinstance(layer, Future):
                    layer = self._keep(cell.key, place, objects, layer.result())
                layers.append(layer)
        except CorruptTileError as error:
            return error
        return layers

    def _read(self, key: CellKey, place: Place, objects: bool) -> OrthoLayer:
        entry = self.world.entry(key)
        layer = self.world.tile(entry, *place).layer
        return replace(layer, objects=self.world.object_ids(entry, *place, layer)) if objects else layer

    def _keep(self, key: CellKey, place: Place, objects: bool, layer: OrthoLayer) -> OrthoLayer:
        if (key, place, objects) not in self._held:
            self._held[key, place, objects] = layer
            self._bytes += _size(layer)
        while self._bytes > self._capacity and len(self._held) > 1:
            self._bytes -= _size(self._held.popitem(last=False)[1])
        return layer


def _size(layer: OrthoLayer) -> int:
    arrays = (layer.depth, layer.color, layer.normal, layer.length, layer.coverage, layer.connected)
    return sum(a.nbytes for a in arrays) + (0 if layer.objects is None else layer.objects.nbytes)


def places_of(entry: CellEntry, directions: Sequence[int], layers: int) -> tuple[Place, ...]:
    """The tiles of those directions that exist, the first `layers` layers of each."""
    there = {(d, layer) for d, layer, _ in entry.tiles}
    return tuple((d, layer) for d in directions for layer in range(layers) if (d, layer) in there)
