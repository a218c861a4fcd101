"""Values that are deflated behind a head of 16 bytes: what they are, their length and their checksum."""

from __future__ import annotations

import struct
import zlib

from farfield.errors import CorruptTileError
from farfield.inflate import inflate

_HEADER = struct.Struct("<4sHHII")
_PLAIN, _WITH_DICTIONARY = 1, 2
"""Versions."""
_HINT = "run farfield verify"


def pack(magic: bytes, *parts: bytes, dictionary: bytes = b"") -> bytes:
    """Head, then the deflated content; the same input gives the same bytes.

    parts: of the content, each in blocks of its own, as text and numbers pack worse together. dictionary: what the
    content is expected to be like; with one it is version 2, and has to be unpacked with the same.
    """
    packer = zlib.compressobj(9, zlib.DEFLATED, -15, zdict=dictionary)
    last = len(parts) - 1
    body = b"".join(
        packer.compress(part) + packer.flush(zlib.Z_FINISH if n == last else zlib.Z_BLOCK)
        for n, part in enumerate(parts)
    )
    content = b"".join(parts)
    version = _WITH_DICTIONARY if dictionary else _PLAIN
    return _HEADER.pack(magic, version, 0, len(content), zlib.crc32(content)) + body


def unpack(data: bytes, magic: bytes, largest: int, what: str, where: str, *, dictionary: bytes = b"") -> bytes:
    """The content. Raises CorruptTileError; never inflates more than the head declares, which is at most `largest`.

    dictionary: of version 2; without one that version is unknown.
    """
    if len(data) < _HEADER.size:
        raise CorruptTileError(f"{what} is cut short", where, _HINT)
    found, version, reserved, length, checksum = _HEADER.unpack_from(data)
    known = version == _PLAIN or (version == _WITH_DICTIONARY and dictionary)
    if found != magic or not known or reserved or length > largest:
        raise CorruptTileError(f"not {what} of a known version", where, _HINT)
    try:
        content = inflate(data[_HEADER.size :], length, dictionary if version == _WITH_DICTIONARY else b"")
    except zlib.error as error:
        raise CorruptTileError(f"{what} is damaged: {error}", where, _HINT) from None
    if zlib.crc32(content) != checksum:
        raise CorruptTileError(f"{what} is damaged", where, _HINT)
    return content
