"""Which server has which value of a world that is split over several (spec/world.md, Servers; OV 7).

Cells below one cell of the rule's level are together, so that a server is asked for whole neighbourhoods; which server
that is, a checksum of the cell's name decides, so that no table grows with the world.
"""

from __future__ import annotations

import re
import zlib
from math import ceil, floor, prod
from typing import Annotated

import msgspec
from msgspec import Meta

from farfield.errors import OptionError
from farfield.octree.grid import MAXIMUM_LEVEL, CellKey, Grid
from farfield.world.limits import Bounds

RULE = "cell-crc32"
"""The one rule that version 1 knows."""

MAXIMUM_SERVERS = 256
MAXIMUM_ADDRESS = 256
"""Characters."""

CELLS_A_SERVER = 16
"""Cells of the rule's level for each server, at least, where the world has so many: then a server's share of them is
mostly within a quarter of the mean, and the levels above, which every server has, are a small part of the world."""

_NAME = r"(?!\.)[A-Za-z0-9._~-]{1,200}"
_HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+\])"
_ABSOLUTE = re.compile(rf"https?://{_HOST}(?::[0-9]{{1,5}})?/(?:{_NAME}/)*")
_RELATIVE = re.compile(rf"\./|(?:\.\./)?{_NAME}/")

_INDEX = r"(?:0|-?[1-9][0-9]{0,12})"
_OF_CELL = re.compile(rf"[a-z]+/((?:0|[1-9][0-9]?)/{_INDEX}/{_INDEX}/{_INDEX})(?:[-/].+)?")
_OF_HASH = re.compile(r"[a-z]+/([0-9a-f]{16})")


class ServersRecord(msgspec.Struct, frozen=True):
    """The servers of a world and the rule, as they are written."""

    rule: str
    level: Annotated[int, Meta(ge=0, le=MAXIMUM_LEVEL)]
    """Of the cells whose names decide for everything at and below them."""
    addresses: Annotated[tuple[str, ...], Meta(min_length=1, max_length=MAXIMUM_SERVERS)]
    """Where each server has its values: absolute, or relative to the manifest's folder; with a slash at the end."""

    @property
    def fault(self) -> str:
        """What cannot be, or nothing."""
        if len(set(self.addresses)) < len(self.addresses):
            return "servers: an address is there twice"
        for address in self.addresses:
            if not is_address(address):
                return f"servers: {address[:80]!r} is neither http(s) nor a folder in or beside the world's own"
        return ""

    def server_of(self, key: str, grid: Grid) -> int | None:
        """Number of the server that has `key`, from 0; None: it is where the manifest is."""
        place = _place_of(key, grid, self.level)
        return None if place is None else zlib.crc32(place.encode()) % len(self.addresses)


def is_address(text: str) -> bool:
    """Whether `text` may be the address of a server: http or https without user, query and fragment; or relative:
    the manifest's folder itself, one in it, or one beside it."""
    return len(text) <= MAXIMUM_ADDRESS and bool(_ABSOLUTE.fullmatch(text) or _RELATIVE.fullmatch(text))


def level_for(grid: Grid, bounds: Bounds, servers: int) -> int:
    """The highest level with CELLS_A_SERVER cells for each of so many servers, by the world's `bounds` (local metres);
    0 where there are fewer."""
    for level in range(grid.top_level, 0, -1):
        if _cells_within(grid, bounds, level) >= CELLS_A_SERVER * servers:
            return level
    return 0


def _cells_within(grid: Grid, bounds: Bounds, level: int) -> int:
    sides = zip(*bounds, grid.corner, grid.cell_size(level).tolist(), strict=True)
    return prod(
        max(1, ceil((upper - zero) / size) - floor((lower - zero) / size)) for lower, upper, zero, size in sides
    )


def _place_of(key: str, grid: Grid, level: int) -> str | None:
    """What decides about a key: the name of a cell, or a hash; None for what is everywhere."""
    if found := _OF_HASH.fullmatch(key):
        return found[1]
    if not (found := _OF_CELL.fullmatch(key)):
        return None
    try:
        cell = CellKey.parse(found[1])
    except OptionError:
        return None
    return str(grid.ancestor(cell, level)) if cell.level <= level else None
