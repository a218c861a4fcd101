"""Reading an archive as a store."""

from __future__ import annotations

import os
import weakref
import zlib
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from threading import Lock
from typing import Never

from farfield.errors import DamagedValueError, MissingKeyError, OptionError, StoreError
from farfield.store.archive.layout import (
    COPY_AGAIN,
    VALUES_FROM,
    Entry,
    Span,
    decode_directory,
    decode_header,
)
from farfield.store.archive.order import rank
from farfield.store.keys import check_key, check_prefix

SUFFIX = ".farfield"
"""How the name of an archive ends."""

KEPT_DIRECTORIES = 64
"""Directories kept in memory, each of some thousand keys: 30 MB."""

Directory = dict[str, Span]

Identity = tuple[int, int, int, int]
"""Device, inode, nanoseconds of the last change and bytes of a file: whoever replaces or changes it gives it others."""


def identity_at(path: str | os.PathLike[str]) -> Identity | None:
    """The identity of what is at a path; None: nothing that can be looked at."""
    try:
        return _identity(os.stat(path))
    except OSError:
        return None


def _identity(found: os.stat_result) -> Identity:
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size


class ArchiveStore:
    """Keeps the reading half of the contract of `Store` with one file.

    An archive that another takes the place of by a rename is read on unchanged. One that is written over is refused
    from then on with a StoreError: its directories no longer tell where its values are.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Reads the header and the root directory.

        Raises NotAWorldError: no archive. VersionError: a newer one. StoreError: cannot be read, cut short, damaged.
        """
        self._path = os.fspath(path)
        self._lock = Lock()
        self._kept: OrderedDict[int, Directory] = OrderedDict()
        try:
            self._file = os.open(self._path, os.O_RDONLY)
            weakref.finalize(self, os.close, self._file)
            self.identity = _identity(os.fstat(self._file))
        except OSError as error:
            self._fail(error)
        self._header = decode_header(self._read(0, VALUES_FROM), self._path)
        *_, size = self.identity
        if size != self._header.length:
            what = f"the archive is cut short: {size} of {self._header.length} bytes"
            raise DamagedValueError(what, self._path, COPY_AGAIN)
        self._root = self._directory_at(self._header.root)
        self._ranks = [rank(entry.key) for entry in self._root]

    def __reduce__(self) -> tuple[type[ArchiveStore], tuple[str]]:
        return ArchiveStore, (self._path,)

    @property
    def location(self) -> str:
        """The path, as it was given."""
        return self._path

    def get(self, key: str) -> bytes:
        """See `Store.get`. Raises DamagedValueError besides: the checksum is another."""
        return self._checked(self._span(key), self._where(key))

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`. Nothing is checked: a checksum is that of a whole value."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        span = self._span(key)
        return self._read(span.offset + start, max(0, min(length, span.length - start)))

    def put(self, key: str, data: bytes) -> Never:
        """Raises StoreError: an archive is written as a whole."""
        self._refuse(check_key(key))

    def delete(self, key: str) -> Never:
        """Raises StoreError: an archive is written as a whole."""
        self._refuse(check_key(key))

    def writing(self) -> Never:
        """Raises StoreError: an archive is written as a whole."""
        self._refuse("")

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        return self._found(key) is not None

    def size(self, key: str) -> int:
        """See `Store.size`."""
        return self._span(key).length

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`. All keys that it gives are gathered first, for the archive's own order is another."""
        folder = check_prefix(prefix)
        start = f"{folder}/" if folder else ""
        keys = [key for n in range(len(self._root)) for key in self._directory(n) if key.startswith(start)]
        yield from sorted(keys, key=lambda key: key.split("/"))

    def _span(self, key: str) -> Span:
        found = self._found(key)
        if found is None:
            raise MissingKeyError("nothing is stored there", self._where(key))
        return found

    def _found(self, key: str) -> Span | None:
        number = bisect_right(self._ranks, rank(check_key(key))) - 1
        return self._directory(number).get(key) if number >= 0 else None

    def _directory(self, number: int) -> Directory:
        """The directory that the root lists as `number`."""
        with self._lock:
            known = self._kept.get(number)
            if known is not None:
                self._kept.move_to_end(number)
                return known
        directory = {entry.key: entry.span for entry in self._directory_at(self._root[number].span)}
        with self._lock:
            self._kept[number] = directory
            if len(self._kept) > KEPT_DIRECTORIES:
                self._kept.popitem(last=False)
        return directory

    def _directory_at(self, span: Span) -> Sequence[Entry]:
        where = f"{self._path}, byte {span.offset:,}"
        return decode_directory(self._checked(span, where), self._header.length, where)

    def _checked(self, span: Span, where: str) -> bytes:
        data = self._read(span.offset, span.length)
        if zlib.crc32(data) != span.checksum:
            raise DamagedValueError("the archive is damaged here: the checksum is another", where, COPY_AGAIN)
        return data

    def _read(self, offset: int, length: int) -> bytes:
        try:
            data = os.pread(self._file, length, offset)
            # Afterwards: what was written before or meanwhile has left its mark by now.
            found = _identity(os.fstat(self._file))
        except OSError as error:
            self._fail(error)
        if found != self.identity:
            raise StoreError("the archive was changed while it was open", self._path, "open it again")
        return data

    def _where(self, key: str) -> str:
        return f"{self._path}: {key}"

    def _refuse(self, key: str) -> Never:
        where = self._where(key) if key else self._path
        raise StoreError("an archive cannot be changed", where, "an archive is written by farfield copy")

    def _fail(self, error: OSError) -> Never:
        reason = os.strerror(error.errno).lower() if error.errno else str(error)
        raise StoreError(f"cannot be read: {reason}", self._path) from error
