"""Tiles of finished branches, kept by the process that made them until the cell above is composited (OV 4.1)."""

from __future__ import annotations

from collections import OrderedDict

from farfield.bake.cell import BakedCell, Tiles
from farfield.octree.grid import CellKey

KEPT_BYTES = 64 << 20
"""Some 50 cells of 17 directions and two layers; more than a worker has waiting for their siblings."""


class KeptTiles:
    """What `BakedCell.release` would forget, within a budget of bytes; the cells kept longest go first.

    Nothing depends on it: what is not here is in the store.
    """

    def __init__(self, budget: int = KEPT_BYTES) -> None:
        self._budget = budget
        self._bytes = 0
        self._kept: OrderedDict[tuple[CellKey, str], tuple[Tiles, Tiles]] = OrderedDict()

    def take_from(self, cell: BakedCell) -> None:
        """Takes the tiles of a cell that was baked just now, so that the cell can be sent without them."""
        if cell.tiles is not None and cell.objects is not None:
            self._forget(cell)
            self._kept[_name(cell)] = cell.tiles, cell.objects
            self._bytes += _size(cell.tiles, cell.objects)
        cell.release()
        while self._bytes > self._budget:
            _, tiles = self._kept.popitem(last=False)
            self._bytes -= _size(*tiles)

    def give_back(self, cell: BakedCell) -> None:
        """Gives a finished cell its tiles, once, where they are still here."""
        tiles = self._forget(cell)
        if tiles is not None:
            cell.tiles, cell.objects = tiles

    def _forget(self, cell: BakedCell) -> tuple[Tiles, Tiles] | None:
        tiles = self._kept.pop(_name(cell), None)
        if tiles is not None:
            self._bytes -= _size(*tiles)
        return tiles


def _name(cell: BakedCell) -> tuple[CellKey, str]:
    return cell.key, cell.record.entry.hash


def _size(*tiles: Tiles) -> int:
    return sum(len(encoded) for each in tiles for encoded in each.values())
