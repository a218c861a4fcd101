"""Writing an archive, one value after the other."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Never
from uuid import uuid4

from farfield.errors import StoreError
from farfield.store.archive.layout import (
    HEADER_BYTES,
    VALUES_FROM,
    Entry,
    Header,
    Span,
    encode_directory,
    encode_header,
)
from farfield.store.archive.order import rank
from farfield.store.keys import check_key

DIRECTORY_KEYS = 1024
"""Keys of a directory: 5 to 10 kB packed. More where the root would not fit before the first value otherwise."""

_ROOM = VALUES_FROM - HEADER_BYTES


class ArchiveWriter:
    """Takes values in any order and writes them as they come; best in the order of `rank`.

    Holds a directory entry a key in memory (some 500 bytes), never a value. Used by `writing_archive`.
    """

    def __init__(self, file: BinaryIO, location: str, directory_keys: int = DIRECTORY_KEYS) -> None:
        """directory_keys: keys of a directory, unless the root would grow too large."""
        self._file = file
        self._location = location
        self._directory_keys = directory_keys
        self._entries: dict[str, Span] = {}
        self._end = VALUES_FROM
        file.seek(VALUES_FROM)

    def put(self, key: str, data: bytes) -> None:
        """Append a value.

        Raises StoreError: no key, a key for the second time, or no room.
        """
        if check_key(key) in self._entries:
            raise StoreError("is written already", f"{self._location}: {key}")
        self._entries[key] = self._append(data)

    def finish(self) -> int:
        """Write the directories and the header; returns the bytes of the whole file. Raises StoreError."""
        entries = sorted((Entry(*entry) for entry in self._entries.items()), key=lambda entry: rank(entry.key))
        leaves = _leaves_of(entries, self._directory_keys)
        root = encode_directory([Entry(leaf[0].key, self._append(encode_directory(leaf))) for leaf in leaves])
        fits = len(root) <= _ROOM
        span = Span(HEADER_BYTES, len(root), zlib.crc32(root)) if fits else self._append(root)
        self._file.seek(0)
        head = encode_header(Header(span, self._end, len(entries))) + (root if fits else b"")
        self._write(head.ljust(VALUES_FROM, b"\0"))
        return self._end

    def _append(self, data: bytes) -> Span:
        span = Span(self._end, len(data), zlib.crc32(data))
        self._write(data)
        self._end += len(data)
        return span

    def _write(self, data: bytes) -> None:
        try:
            self._file.write(data)
        except OSError as error:
            fail(error, self._location)


def _leaves_of(entries: list[Entry], count: int) -> list[list[Entry]]:
    """`entries` cut into directories of `count` keys, or more, so that the root fits before the first value."""
    while True:
        leaves = [entries[start : start + count] for start in range(0, len(entries), count)]
        if len(encode_directory([_guessed(leaf[0].key) for leaf in leaves])) <= _ROOM * 15 // 16:
            return leaves
        count *= 2


def _guessed(key: str) -> Entry:
    """An entry of the root as hard to pack as the true one, which is not known before its directory is written."""
    checksum = zlib.crc32(key.encode("ascii"))
    return Entry(key, Span(VALUES_FROM, checksum & 0x3FFF, checksum))


@contextmanager
def writing_archive(path: str | os.PathLike[str], directory_keys: int = DIRECTORY_KEYS) -> Iterator[ArchiveWriter]:
    """A writer to the archive `path`, which is there, whole and on the medium, once the block has ended.

    The file grows beside it under a name of its own and is removed when the block fails.

    Raises StoreError: something is there already, or it cannot be written.
    """
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise StoreError("there is something of that name", str(target), "remove it, or give another name")
    incoming = target.with_name(f".{target.name}-{uuid4().hex[:8]}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with open(incoming, "xb") as file:
            writer = ArchiveWriter(file, str(target), directory_keys)
            yield writer
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
        os.replace(incoming, target)
    except OSError as error:
        fail(error, str(target))
    finally:
        with suppress(OSError):
            incoming.unlink(missing_ok=True)


def fail(error: OSError, location: str) -> Never:
    """Raises StoreError for what the system says."""
    reason = os.strerror(error.errno).lower() if error.errno else str(error)
    raise StoreError(f"cannot be written: {reason}", location, "free some space, or choose another place") from error
