"""A store in a folder: one file a key, so that any web server can serve it as it is."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Never
from uuid import uuid4

from farfield.errors import MissingKeyError, OptionError, StoreError
from farfield.store.contract import busy
from farfield.store.keys import check_key, check_prefix

INCOMING = ".incoming"
"""Folder of values still being written. It begins with a dot, so nothing in it has a key."""

STALE_SECONDS = 24 * 3600
"""Age at which a file left in INCOMING belongs to no living writer."""

MOVE_ATTEMPTS = 5
"""How often `put` makes the folders for a value, should they be taken away each time."""

_MISSING = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR}

_FOLDER_CONFLICT = {errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENOTEMPTY}

_HINTS = {
    errno.ENOSPC: "free some space; what is stored so far is kept",
    errno.EDQUOT: "free some space; what is stored so far is kept",
    errno.EFBIG: "raise the limit of a file's size: ulimit -f",
    errno.EACCES: "check who may read and write there",
    errno.EPERM: "check who may read and write there",
    errno.EROFS: "the file system is mounted read-only; choose another folder",
    errno.EMFILE: "raise the limit of open files: ulimit -n",
    errno.EIO: "the disk reports a fault",
}


class DirectoryStore:
    """Keeps the contract of `Store` in a folder, which the first `put` makes when it is not there.

    Symbolic links below the folder are not followed, so that a world that is served never shows anything outside
    itself; the folder itself may be reached through one.
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self._root = Path(root)
        self._real_root = os.path.realpath(self._root)
        self._ready = False

    def __reduce__(self) -> tuple[type[DirectoryStore], tuple[str]]:
        """In another process it is the same folder, whatever that one's current folder; links on the way may differ."""
        return type(self), (os.path.abspath(self._root),)

    @property
    def location(self) -> str:
        """The folder, as it was given."""
        return str(self._root)

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        path = self._readable(key)
        try:
            with open(path, "rb") as file:
                return file.read()
        except OSError as error:
            self._fail(error, key, "cannot be read")

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        path = self._readable(key)
        try:
            with open(path, "rb") as file:
                file.seek(start)
                return file.read(length)
        except OSError as error:
            self._fail(error, key, "cannot be read")

    def put(self, key: str, data: bytes) -> None:
        """See `Store.put`."""
        path = self._root / check_key(key)
        incoming = self._root / INCOMING / uuid4().hex
        try:
            self._make_ready()
            _write_through(incoming, data)
            _move_into_place(incoming, path)
        except OSError as error:
            if error.errno in _FOLDER_CONFLICT:
                where = f"{self._root}: {key}"
                raise StoreError("a key cannot also be the folder of other keys", where) from error
            self._fail(error, key, "cannot be written")
        finally:
            # It is gone when all went well. Where nothing can be written, nothing can be removed either.
            with suppress(OSError):
                os.unlink(incoming)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """See `Store.writing`. The system's lock on the folder of incoming values: it ends with the process."""
        try:
            self._make_ready()
            lock = os.open(self._root / INCOMING, os.O_RDONLY)
        except OSError as error:
            self._fail(error, "", "cannot be written")
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise busy(self.location) from None
            yield
        finally:
            os.close(lock)

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        try:
            return os.path.isfile(self._readable(key))
        except MissingKeyError:
            return False

    def size(self, key: str) -> int:
        """See `Store.size`."""
        path = self._readable(key)
        if not os.path.isfile(path):
            self._missing(key)
        return os.path.getsize(path)

    def delete(self, key: str) -> None:
        """See `Store.delete`."""
        path = self._root / check_key(key)
        try:
            os.unlink(path)
            _prune(path.parent, self._root)
        except OSError as error:
            if error.errno not in _MISSING and not path.is_dir():
                self._fail(error, key, "cannot be removed")

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`."""
        folder = check_prefix(prefix)
        try:
            yield from _walk(os.path.join(self._real_root, folder), f"{folder}/" if folder else "")
        except OSError as error:
            if error.errno not in _MISSING:
                self._fail(error, prefix, "cannot be listed")

    def _readable(self, key: str) -> str:
        """The path of `key`'s file. Raises MissingKeyError: there is a symbolic link on the way."""
        path = os.path.join(self._real_root, check_key(key))
        if os.path.realpath(path) != path:
            self._missing(key)
        return path

    def _make_ready(self) -> None:
        """Make the folder for incoming values, and clear it of what killed writers left, once."""
        if self._ready:
            return
        incoming = self._root / INCOMING
        incoming.mkdir(parents=True, exist_ok=True)
        oldest = time.time() - STALE_SECONDS
        for entry in os.scandir(incoming):
            # Another process may move its value into place, or clear the same file, at any moment.
            with suppress(FileNotFoundError):
                if entry.stat(follow_symlinks=False).st_mtime < oldest:
                    os.unlink(entry.path)
        self._ready = True

    def _missing(self, key: str) -> Never:
        raise MissingKeyError("nothing is stored there", f"{self._root}: {key}")

    def _fail(self, error: OSError, key: str, what: str) -> Never:
        if error.errno in _MISSING:
            raise MissingKeyError("nothing is stored there", f"{self._root}: {key}") from error
        reason = os.strerror(error.errno).lower() if error.errno else str(error)
        hint = _HINTS.get(error.errno or 0, "")
        raise StoreError(f"{what}: {reason}", f"{self._root}: {key}" if key else str(self._root), hint) from error


def _write_through(path: Path, data: bytes) -> None:
    """Write a new file and wait until the medium has it.

    10,000 files of 8 kB took 0.5 s without fsync, 3.6 s with it, 3.2 s with all fsyncs at the end and 0.9 s with
    one sync of everything: 0.3 ms a file where encoding it takes 30 to 100, so each value is made safe as it is
    written and no `flush` has to be remembered. The folder is not synced: journals keep renames in their order, so
    a record that survives a power cut names only tiles that survived too, and the last seconds are baked again.
    """
    with open(path, "xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _move_into_place(incoming: Path, path: Path) -> None:
    """Rename, making the folders above; again when a `delete` takes an empty one away in between."""
    for _ in range(MOVE_ATTEMPTS - 1):
        # mkdir reports "exists" for a folder that was there when it tried and gone when it looked.
        with suppress(FileNotFoundError, FileExistsError):
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(incoming, path)
            return
    path.parent.mkdir(parents=True, exist_ok=True)
    os.replace(incoming, path)


def _prune(folder: Path, root: Path) -> None:
    """Remove `folder` and those above it up to `root`, as long as they are empty."""
    with suppress(OSError):
        while folder != root:
            folder.rmdir()
            folder = folder.parent


def _walk(folder: str, prefix: str) -> Iterator[str]:
    """Keys of the files below `folder`, in order; names that are no segments of a key are passed over."""
    with os.scandir(folder) as entries:
        ordered = sorted(entries, key=lambda entry: entry.name)
    for entry in ordered:
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            yield from _walk(entry.path, f"{prefix}{entry.name}/")
        elif entry.is_file(follow_symlinks=False):
            yield prefix + entry.name
