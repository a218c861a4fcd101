"""The container of orthoview tiles: header, list of planes, checksum (spec/orthoview.md, Header).

Nothing in a tile is believed before it is checked, and nothing is allocated before its size is known from the header:
at most 4096 x 4096 pixels, and planes inflate to at most the bytes that their pixels need.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from farfield.errors import CorruptTileError
from farfield.inflate import inflate

VERSION = 1
MAXIMUM_SIDE = 4096
"""Columns or rows of a tile."""
MAXIMUM_PLANES = 64
RAW, DEFLATE, WEBP, CODED = 0, 1, 2, 3
"""Codecs of a plane."""

_HEADER = struct.Struct("<4sHBBiiiHHiIHHI")
_PLANE = struct.Struct("<BBHI")
_CRC_AT = 36


@dataclass(frozen=True, slots=True)
class TileHeader:
    """What the first 40 bytes say."""

    direction: int
    """Direction number, 0..255."""
    index: int
    """Depth layer, 0 or 1."""
    level: int
    x: int
    """Lattice column of the first column."""
    y: int
    """Lattice row of the first row."""
    width: int
    """Columns, 1..4096."""
    height: int
    """Rows, 1..4096."""
    depth_base: int
    """Depth steps of code 0."""
    valid: int
    """Pixels with a surface, at least 1."""


@dataclass(frozen=True, slots=True)
class Plane:
    """One plane as stored."""

    kind: int
    codec: int
    stored: bytes
    at: int = 0
    """Byte of the tile that it starts at; for messages."""


def pack(magic: bytes, header: TileHeader, planes: Sequence[Plane]) -> bytes:
    """The bytes of a tile. Raises ValueError for a header that does not fit the format."""
    h = header
    if not (0 < h.width <= MAXIMUM_SIDE and 0 < h.height <= MAXIMUM_SIDE and 0 < h.valid <= h.width * h.height):
        raise ValueError(f"a tile of {h.width} x {h.height} with {h.valid} valid pixels cannot be written")
    try:
        head = _HEADER.pack(
            magic, VERSION, h.direction, h.index, h.level, h.x, h.y, h.width, h.height, h.depth_base, h.valid,
            len(planes), 0, 0,
        )  # fmt: skip
    except struct.error as error:
        raise ValueError(f"the header of a tile does not fit: {error}") from None
    table = b"".join(_PLANE.pack(p.kind, p.codec, 0, len(p.stored)) for p in planes)
    tile = b"".join([head, table, *(p.stored for p in planes)])
    return tile[:_CRC_AT] + struct.pack("<I", zlib.crc32(tile)) + tile[_CRC_AT + 4 :]


def unpack(data: bytes, magic: bytes, where: str) -> tuple[TileHeader, dict[int, Plane]]:
    """Header and planes by kind. Raises CorruptTileError for anything the format does not allow."""
    if len(data) < _HEADER.size:
        raise CorruptTileError(f"{len(data)} bytes, shorter than a header", where)
    found, version, direction, index, level, x, y, width, height, base, valid, planes, reserved, crc = (
        _HEADER.unpack_from(data)
    )
    if found != magic:
        raise CorruptTileError(f"starts with {found!r} instead of {magic!r}", where)
    if version != VERSION:
        raise CorruptTileError(f"tile version {version} is not known", where, "a newer farfield may read it")
    expected = zlib.crc32(data[_CRC_AT + 4 :], zlib.crc32(bytes(4), zlib.crc32(data[:_CRC_AT])))
    if crc != expected:
        raise CorruptTileError(f"checksum {expected:08x} instead of {crc:08x}: truncated or altered", where)
    if not (0 < width <= MAXIMUM_SIDE and 0 < height <= MAXIMUM_SIDE and 0 < valid <= width * height):
        raise CorruptTileError(f"absurd size {width} x {height} with {valid} valid pixels", where)
    if index > 1 or reserved or planes > MAXIMUM_PLANES:
        raise CorruptTileError(f"layer {index}, {planes} planes, reserved {reserved}: not a tile of version 1", where)
    return TileHeader(direction, index, level, x, y, width, height, base, valid), _planes(data, planes, where)


def _planes(data: bytes, count: int, where: str) -> dict[int, Plane]:
    at = _HEADER.size + count * _PLANE.size
    if at > len(data):
        raise CorruptTileError(f"{count} planes do not fit in {len(data)} bytes", where)
    planes: dict[int, Plane] = {}
    for n in range(count):
        kind, codec, reserved, length = _PLANE.unpack_from(data, _HEADER.size + n * _PLANE.size)
        if reserved or kind in planes:
            raise CorruptTileError(f"plane {n} of kind {kind} is repeated or not of version 1", where)
        if length > len(data) - at:
            raise CorruptTileError(f"plane {n} of {length} bytes ends beyond the {len(data)} of the file", where)
        planes[kind] = Plane(kind, codec, data[at : at + length], at)
        at += length
    if at != len(data):
        raise CorruptTileError(f"{len(data) - at} bytes follow the last plane", where)
    return planes


def inflated(planes: Mapping[int, Plane], kind: int, name: str, size: int, where: str) -> bytes:
    """Exactly `size` bytes of a raw or deflated plane; never inflates more than one byte beyond that."""
    plane = planes.get(kind)
    if plane is None:
        raise CorruptTileError(f"has no {name} plane", where)
    if plane.codec == DEFLATE:
        try:
            return inflate(plane.stored, size)
        except zlib.error as error:
            raise CorruptTileError(f"{name} plane at byte {plane.at} cannot be inflated: {error}", where) from None
    if plane.codec != RAW:
        raise CorruptTileError(f"{name} plane at byte {plane.at} has codec {plane.codec}", where)
    if len(plane.stored) != size:
        raise CorruptTileError(f"{name} plane at byte {plane.at} does not hold the {size} bytes it should", where)
    return plane.stored
