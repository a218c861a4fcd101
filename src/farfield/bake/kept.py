"""What finished branches have made, kept by the process that made it until the cell above has it (OV 4.1)."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

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
        self._kept: OrderedDict[tuple[CellKey, str], _Kept] = OrderedDict()

    def take_from(self, cell: BakedCell) -> None:
        """Takes what a cell has that was baked just now, so that the cell can be sent without it."""
        if cell.files or (cell.tiles is not None and cell.objects is not None):
            self._forget(cell)
            self._kept[_name(cell)] = kept = _Kept(cell.tiles, cell.objects, cell.files)
            self._bytes += kept.size
        cell.release()
        while self._bytes > self._budget:
            _, kept = self._kept.popitem(last=False)
            self._bytes -= kept.size

    def give_back(self, cell: BakedCell) -> None:
        """Gives a finished cell what it had, once, where it is still here."""
        kept = self._forget(cell)
        if kept is not None:
            cell.tiles, cell.objects, cell.files = kept.tiles, kept.objects, kept.files

    def _forget(self, cell: BakedCell) -> _Kept | None:
        kept = self._kept.pop(_name(cell), None)
        if kept is not None:
            self._bytes -= kept.size
        return kept


@dataclass(frozen=True, slots=True)
class _Kept:
    """Of one cell."""

    tiles: Tiles | None
    objects: Tiles | None
    files: dict[str, bytes]

    @property
    def size(self) -> int:
        """Bytes."""
        parts = (self.tiles, self.objects, self.files)
        return sum(len(value) for part in parts if part for value in part.values())


def _name(cell: BakedCell) -> tuple[CellKey, str]:
    return cell.key, cell.record.entry.hash
