"""Index tiles: what each cell of a subtree holds, so that nobody has to probe (spec/world.md)."""

from __future__ import annotations

import itertools
import math
import struct
import zlib
from collections.abc import Iterable
from typing import Annotated

import msgspec
from msgspec import Meta

from farfield.errors import CorruptTileError, OptionError
from farfield.inflate import inflate
from farfield.octree.grid import CellKey
from farfield.world.limits import DAMAGE, Count, DirectionNumber, Hash, HashOrNone, LayerNumber, PickNumber, is_box
from farfield.world.limits import Bounds as Bounds

_HEADER = struct.Struct("<4sHHII")
_MAGIC = b"FFIX"
_VERSION = 1
MAXIMUM_BYTES = 64 << 20
"""An index tile never unpacks to more than this."""
MOST_GAIN = 65536.0
"""Pixels a kilobyte, from which the gains of picked tiles go down."""
STEPS = 4
"""By which a gain is halved: 16 or 32 in place of 4 make an index 5 and 10 % larger."""
WORST_STEPS = 255
"""From one gain to the next."""
_HINT = "run farfield verify"


class GeometryEntry(msgspec.Struct, frozen=True):
    """Near geometry of a leaf."""

    hash: Hash
    bytes: Count
    triangles: Count = 0
    instances: Count = 0
    meshes: tuple[tuple[Hash, Count], ...] = ()
    """Hash and bytes of each mesh its instances need."""


class CellEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One cell of the index."""

    key: str
    bounds: Bounds
    """Tight bounds of the content, local metres."""
    error: Annotated[float, Meta(ge=0, le=1e12)]
    """Geometric error, metres: the pitch of the orthoviews."""
    hash: HashOrNone = ""
    tiles: Annotated[tuple[tuple[DirectionNumber, LayerNumber, Count], ...], Meta(max_length=512)] = ()
    """(direction, layer, bytes) of each orthoview tile."""
    views: Annotated[tuple[Annotated[tuple[DirectionNumber, ...], Meta(max_length=256)], ...], Meta(max_length=26)] = ()
    """For each of 26 view bins the directions to draw, best first."""
    picks: Annotated[tuple[Annotated[tuple[PickNumber, ...], Meta(max_length=1024)], ...], Meta(max_length=26)] = ()
    """For each of 26 view bins the tiles to draw, see write_picks."""
    children: Annotated[tuple[str, ...], Meta(max_length=8)] = ()
    index: HashOrNone = ""
    geometry: GeometryEntry | None = None
    output: HashOrNone = ""

    def picks_from(self, view_bin: int) -> list[tuple[int, float]]:
        """(place in `tiles`, gain) of each tile picked for a view bin, best first.

        Gain: pixels of a view that a kilobyte of it adds to the tiles before it.
        """
        flat = self.picks[view_bin] if self.picks else ()
        below = itertools.accumulate(flat[1::2])
        return [(place, MOST_GAIN * 2.0 ** (-steps / STEPS)) for place, steps in zip(flat[::2], below, strict=True)]

    @property
    def cell(self) -> CellKey:
        """The key, parsed."""
        return CellKey.parse(self.key)


class IndexTile(msgspec.Struct, frozen=True):
    """The cells of a few levels below a root cell."""

    root: str
    cells: tuple[CellEntry, ...]


def write_picks(picks: Iterable[tuple[int, float]]) -> tuple[int, ...]:
    """(place, gain) of the tiles picked for a view bin, best first, as CellEntry.picks lists them."""
    flat: list[int] = []
    below = 0
    for place, gain in picks:
        wanted = round(STEPS * math.log2(MOST_GAIN / gain)) if gain > 0 else WORST_STEPS
        steps = min(max(wanted - below, 0), WORST_STEPS)
        below += steps
        flat += [place, steps]
    return tuple(flat)


def encode_index(tile: IndexTile) -> bytes:
    """Header, then deflated JSON; the same input gives the same bytes."""
    text = msgspec.json.encode(tile)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    body = packer.compress(text) + packer.flush()
    return _HEADER.pack(_MAGIC, _VERSION, 0, len(text), zlib.crc32(text)) + body


def decode_index(data: bytes, where: str) -> IndexTile:
    """Reads an index tile. Raises CorruptTileError for anything else.

    Allocates at most 16 bytes for each byte of JSON that the header declares, which is at most MAXIMUM_BYTES.
    """
    try:
        tile = msgspec.json.decode(_text_of(data, where), type=IndexTile)
        _check_cells(tile, where)
    except (*DAMAGE, OptionError) as error:
        raise CorruptTileError(f"index tile is damaged: {error}", where, _HINT) from None
    return tile


def _text_of(data: bytes, where: str) -> bytes:
    """The JSON. Raises CorruptTileError."""
    if len(data) < _HEADER.size:
        raise CorruptTileError("index tile is cut short", where, _HINT)
    magic, version, reserved, length, checksum = _HEADER.unpack_from(data)
    if magic != _MAGIC or version != _VERSION or reserved or length > MAXIMUM_BYTES:
        raise CorruptTileError("not an index tile of a known version", where, _HINT)
    try:
        text = inflate(data[_HEADER.size :], length)
    except zlib.error as error:
        raise CorruptTileError(f"index tile is damaged: {error}", where, _HINT) from None
    if zlib.crc32(text) != checksum:
        raise CorruptTileError("index tile is damaged", where, _HINT)
    return text


def _check_cells(tile: IndexTile, where: str) -> None:
    """Raises CorruptTileError, or OptionError for what is no key, unless the cells form trees below the root.

    So whoever walks them comes to an end. That a cell has but one parent only the grid can tell (`world.World`).
    """
    root, names = CellKey.parse(tile.root), {entry.key for entry in tile.cells}
    if len(names) != len(tile.cells) or not tile.cells or tile.cells[0].key != tile.root:
        raise CorruptTileError("index tile does not list each of its cells once, the root first", where, _HINT)
    for entry in tile.cells:
        children = [CellKey.parse(child) for child in entry.children]
        sane = (
            entry.cell.level <= root.level
            and is_box(entry.bounds)
            and len(set(children)) == len(children)
            and all(_may_be_below(child, entry.cell) for child in children)
            and all(_are_picks(picks, len(entry.tiles)) for picks in entry.picks)
            and (entry.index or names.issuperset(entry.children))
        )
        if not sane:
            raise CorruptTileError(f"index tile tells what cannot be of cell {entry.key}", where, _HINT)


def _are_picks(picks: tuple[int, ...], tiles: int) -> bool:
    """Whether they come in pairs, name tiles that exist, each once, and steps between gains."""
    places, steps = picks[::2], picks[1::2]
    each_once = len(set(places)) == len(places) == len(steps)
    return each_once and all(place < tiles for place in places) and all(step <= WORST_STEPS for step in steps)


def _may_be_below(child: CellKey, cell: CellKey) -> bool:
    """Whether it is a child in some grid: one level below, its index along each axis halved or the same."""
    pairs = zip(child[1:], cell[1:], strict=True)
    return child.level == cell.level - 1 and all(index in (below, below >> 1) for below, index in pairs)
