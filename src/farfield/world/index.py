"""Index tiles: what each cell of a subtree holds, so that nobody has to probe (spec/world.md)."""

from __future__ import annotations

import struct
import zlib

import msgspec

from farfield.errors import CorruptTileError
from farfield.octree.grid import CellKey

_HEADER = struct.Struct("<4sHHII")
_MAGIC = b"FFIX"
_VERSION = 1
MAXIMUM_BYTES = 64 << 20
"""An index tile never unpacks to more than this."""

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]


class GeometryEntry(msgspec.Struct, frozen=True):
    """Near geometry of a leaf."""

    hash: str
    bytes: int
    triangles: int = 0
    instances: int = 0
    meshes: tuple[tuple[str, int], ...] = ()
    """Hash and bytes of each mesh its instances need."""


class CellEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One cell of the index."""

    key: str
    bounds: Bounds
    """Tight bounds of the content, local metres."""
    error: float
    """Geometric error, metres: the pitch of the orthoviews."""
    hash: str = ""
    tiles: tuple[tuple[int, int, int], ...] = ()
    """(direction, layer, bytes) of each orthoview tile."""
    views: tuple[tuple[int, ...], ...] = ()
    """For each of 26 view bins the directions to draw, best first."""
    children: tuple[str, ...] = ()
    index: str = ""
    geometry: GeometryEntry | None = None
    output: str = ""

    @property
    def cell(self) -> CellKey:
        """The key, parsed."""
        return CellKey.parse(self.key)


class IndexTile(msgspec.Struct, frozen=True):
    """The cells of a few levels below a root cell."""

    root: str
    cells: tuple[CellEntry, ...]


def encode_index(tile: IndexTile) -> bytes:
    """Header, then deflated JSON; the same input gives the same bytes."""
    text = msgspec.json.encode(tile)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    body = packer.compress(text) + packer.flush()
    return _HEADER.pack(_MAGIC, _VERSION, 0, len(text), zlib.crc32(text)) + body


def decode_index(data: bytes, where: str) -> IndexTile:
    """Reads an index tile. Raises CorruptTileError for anything else."""
    hint = "run farfield verify"
    if len(data) < _HEADER.size:
        raise CorruptTileError("index tile is cut short", where, hint)
    magic, version, _, length, checksum = _HEADER.unpack_from(data)
    if magic != _MAGIC or version != _VERSION or length > MAXIMUM_BYTES:
        raise CorruptTileError("not an index tile of a known version", where, hint)
    try:
        text = zlib.decompressobj(-15).decompress(data[_HEADER.size :], length)
        if len(text) != length or zlib.crc32(text) != checksum:
            raise CorruptTileError("index tile is damaged", where, hint)
        return msgspec.json.decode(text, type=IndexTile)
    except (zlib.error, msgspec.DecodeError) as error:
        raise CorruptTileError(f"index tile is damaged: {error}", where, hint) from None
