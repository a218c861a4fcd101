"""Header and directories of an archive, to bytes and back (spec/archive.md)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from farfield.errors import DamagedValueError, NotAWorldError, VersionError
from farfield.inflate import inflate
from farfield.store.archive.order import rank
from farfield.store.keys import is_key

VERSION = 1

VALUES_FROM = 16 * 1024
"""Where the first value begins. The root directory lies between the header and this, so that whoever reads the first
16 KiB has both."""

MAX_DIRECTORY_BYTES = 16 << 20
"""A directory never unpacks to more than this."""

DIRECTORY_MEMORY = 64
"""Bytes of memory that reading a directory takes at most for each byte that it unpacks to: keys are held whole."""

SMALLEST_ENTRY = 8
"""Bytes of an entry at least: four numbers of one byte each, and the checksum."""

COPY_AGAIN = "the file is damaged: farfield copy the world again"

_MAGIC = b"FFAR"
_HEADER = struct.Struct("<4sHHQIIQQ")
_CHECKSUM = struct.Struct("<I")
HEADER_BYTES = _HEADER.size + _CHECKSUM.size
_BLOCK = struct.Struct("<II")


class Span(NamedTuple):
    """A range of bytes of the archive."""

    offset: int
    """From the start of the file."""
    length: int
    checksum: int
    """CRC-32 of those bytes."""


class Entry(NamedTuple):
    """What a directory says of a key; in the root, of the directory that begins with that key."""

    key: str
    span: Span


@dataclass(frozen=True, slots=True)
class Header:
    """The first bytes of an archive."""

    root: Span
    """The root directory."""
    length: int
    """Bytes of the whole file."""
    keys: int
    """Values in it."""


def encode_header(header: Header) -> bytes:
    """HEADER_BYTES bytes."""
    root = header.root
    packed = _HEADER.pack(_MAGIC, VERSION, 0, root.offset, root.length, root.checksum, header.length, header.keys)
    return packed + _CHECKSUM.pack(zlib.crc32(packed))


def decode_header(data: bytes, where: str) -> Header:
    """Reads the header at the start of `data`.

    Raises NotAWorldError: no archive. VersionError: a newer one. DamagedValueError: cut short or altered.
    """
    if data[:4] != _MAGIC:
        raise NotAWorldError(
            "a file, but no farfield archive", where, "a world is a folder, a bucket or a .farfield file"
        )
    if len(data) < HEADER_BYTES:
        raise DamagedValueError("the archive is cut short", where, COPY_AGAIN)
    _, version, _, offset, length, checksum, total, keys = _HEADER.unpack_from(data)
    if version > VERSION:
        what = f"archive of version {version}, this farfield reads up to {VERSION}"
        raise VersionError(what, where, "upgrade farfield")
    if zlib.crc32(data[: _HEADER.size]) != _CHECKSUM.unpack_from(data, _HEADER.size)[0]:
        raise DamagedValueError("the header of the archive is altered", where, COPY_AGAIN)
    root = Span(offset, length, checksum)
    if root.offset < HEADER_BYTES or root.offset + root.length > total:
        raise DamagedValueError("the root directory lies outside of the archive", where, COPY_AGAIN)
    return Header(root, total, keys)


def encode_directory(entries: Sequence[Entry]) -> bytes:
    """A directory of entries that are in the order of `rank`."""
    shared, rest, gaps, lengths, checksums, text = (bytearray() for _ in range(6))
    last, end = "", 0
    for key, span in entries:
        common = _common(last, key)
        shared += _varint(common)
        rest += _varint(len(key) - common)
        gaps += _varint(_zigzag(span.offset - end))
        lengths += _varint(span.length)
        checksums += _CHECKSUM.pack(span.checksum)
        text += key[common:].encode("ascii")
        last, end = key, span.offset + span.length
    columns = bytes(shared + rest + gaps + lengths + checksums + text)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return _BLOCK.pack(len(columns), len(entries)) + packer.compress(columns) + packer.flush()


def decode_directory(block: bytes, total: int, where: str) -> list[Entry]:
    """Reads a directory of an archive of `total` bytes; takes at most DIRECTORY_MEMORY times the memory it unpacks to.

    Raises DamagedValueError for anything but a directory whose keys are in order and whose spans lie in the archive.
    """
    try:
        return _decode(block, total)
    except (ValueError, struct.error, zlib.error) as error:
        raise DamagedValueError(f"a directory is damaged: {error}", where, COPY_AGAIN) from None


def _decode(block: bytes, total: int) -> list[Entry]:
    unpacked, count = _BLOCK.unpack_from(block)
    if unpacked > MAX_DIRECTORY_BYTES or count * SMALLEST_ENTRY > unpacked:
        raise ValueError("its size is absurd")
    reader = _Columns(inflate(block[_BLOCK.size :], unpacked))
    shared, rest, gaps, lengths = (reader.varints(count) for _ in range(4))
    checksums = struct.unpack(f"<{count}I", reader.take(4 * count))
    text = reader.take(sum(rest)).decode("ascii")
    if reader.left:
        raise ValueError("bytes follow its end")
    entries: list[Entry] = []
    key, end, at = "", 0, 0
    before = None
    for n in range(count):
        if shared[n] > len(key):
            raise ValueError("a key is cut short")
        key = key[: shared[n]] + text[at : at + rest[n]]
        at += rest[n]
        offset = end + _unzigzag(gaps[n])
        end = offset + lengths[n]
        if offset < HEADER_BYTES or end > total:
            raise ValueError("a value lies outside of the archive")
        here = rank(key) if is_key(key) else None
        if here is None or (before is not None and here <= before):
            raise ValueError("its keys are not in order")
        before = here
        entries.append(Entry(key, Span(offset, lengths[n], checksums[n])))
    return entries


class _Columns:
    """Reads numbers from bytes. Raises ValueError at their end."""

    def __init__(self, columns: bytes) -> None:
        self._bytes = columns
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._bytes) - self._at

    def take(self, count: int) -> bytes:
        if count > self.left:
            raise ValueError("it is cut short")
        self._at += count
        return self._bytes[self._at - count : self._at]

    def varints(self, count: int) -> list[int]:
        return [self._varint() for _ in range(count)]

    def _varint(self) -> int:
        value = 0
        # Seven bytes hold 49 bits: 500 TB, and exact in the numbers of a browser.
        for shift in range(0, 49, 7):
            byte = self.take(1)[0]
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("a number is too long")


def _varint(value: int) -> bytes:
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    found.append(value)
    return bytes(found)


def _zigzag(value: int) -> int:
    return value * 2 if value >= 0 else -2 * value - 1


def _unzigzag(value: int) -> int:
    return value >> 1 if value % 2 == 0 else -(value + 1 >> 1)


def _common(a: str, b: str) -> int:
    """Characters at the start of both."""
    count = 0
    for x, y in zip(a, b, strict=False):
        if x != y:
            break
        count += 1
    return count
