"""Scene chunks: named arrays and a few facts as one value (spec/record.md)."""

from __future__ import annotations

import struct
import zlib
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.world.limits import DAMAGE

MAGIC = b"FFSC"
VERSION = 1
_HEAD = struct.Struct("<4sHHII")
"""Magic, version, zero, bytes of the JSON, CRC-32 of all that follows."""
_ALIGNMENT = 8
_DTYPES = ("<f8", "<f4", "<i8", "<i4", "<u4", "<u2", "|u1", "|b1")


class _ArrayRecord(msgspec.Struct, frozen=True):
    name: str
    dtype: str
    shape: Annotated[tuple[Annotated[int, Meta(ge=0, le=1 << 40)], ...], Meta(max_length=4)]


class _Listing(msgspec.Struct, frozen=True):
    kind: str
    about: dict[str, Any]
    arrays: tuple[_ArrayRecord, ...]


class SceneChunk(msgspec.Struct, frozen=True):
    """What a value holds."""

    kind: str
    about: dict[str, Any]
    """What JSON can say."""
    arrays: dict[str, NDArray[Any]]
    """Read-only when decoded: they lie in the value itself."""


def encode_chunk(chunk: SceneChunk) -> bytes:
    """The chunk's bytes; the same chunk gives the same. Raises ValueError for arrays of any but plain numbers."""
    records, parts, at = [], [], 0
    for name, array in chunk.arrays.items():
        little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        if little.dtype.str not in _DTYPES:
            raise ValueError(f"{name} is of {array.dtype}")
        records.append(_ArrayRecord(name, little.dtype.str, little.shape))
        parts.append(little.tobytes() + bytes(-little.nbytes % _ALIGNMENT))
        at += len(parts[-1])
    listing = msgspec.json.encode(_Listing(chunk.kind, chunk.about, tuple(records)))
    listing += b" " * (-(len(listing) + _HEAD.size) % _ALIGNMENT)
    body = b"".join([listing, *parts])
    return _HEAD.pack(MAGIC, VERSION, 0, len(listing), zlib.crc32(body)) + body


def decode_chunk(data: bytes, kind: str, where: str = "") -> SceneChunk:
    """Reads a chunk of the wanted kind; allocates at most 32 bytes for each byte of its JSON.

    Raises CorruptTileError for anything else. What the arrays say is for the caller to check.
    """
    if len(data) < _HEAD.size:
        raise CorruptTileError("scene chunk is cut short", where)
    magic, version, zero, length, checksum = _HEAD.unpack_from(data)
    if (magic, version, zero) != (MAGIC, VERSION, 0) or length > len(data) - _HEAD.size:
        raise CorruptTileError("not a scene chunk of version 1", where)
    if zlib.crc32(memoryview(data)[_HEAD.size :]) != checksum:
        raise CorruptTileError("scene chunk is damaged: its checksum differs", where)
    try:
        listing = msgspec.json.decode(data[_HEAD.size : _HEAD.size + length], type=_Listing)
    except DAMAGE as error:
        raise CorruptTileError(f"scene chunk is damaged: {error}", where) from None
    if listing.kind != kind:
        raise CorruptTileError(f"scene chunk holds {listing.kind[:40]!r}, not {kind!r}", where)
    return SceneChunk(listing.kind, listing.about, _arrays(data, _HEAD.size + length, listing, where))


def _arrays(data: bytes, at: int, listing: _Listing, where: str) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    for record in listing.arrays:
        if record.dtype not in _DTYPES or record.name in arrays:
            raise CorruptTileError(f"scene chunk is damaged: array {record.name[:40]!r}", where)
        dtype = np.dtype(record.dtype)
        count = 1
        for side in record.shape:
            count *= side
        if count * dtype.itemsize > len(data) - at:
            raise CorruptTileError("scene chunk is cut short", where)
        # numpy refuses to find nothing at the end of a buffer.
        flat = np.frombuffer(data, dtype, count, at) if count else np.empty(0, dtype)
        arrays[record.name] = flat.reshape(record.shape)
        at += count * dtype.itemsize
        at += -at % _ALIGNMENT
    return arrays
