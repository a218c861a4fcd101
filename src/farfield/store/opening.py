"""From what a user names to a store."""

from __future__ import annotations

import os
from pathlib import Path

from farfield.errors import NotAWorldError
from farfield.store.archive import ArchiveStore
from farfield.store.archive.reader import SUFFIX
from farfield.store.bucket import SCHEMES, BucketStore
from farfield.store.contract import Store
from farfield.store.directory import INCOMING, DirectoryStore
from farfield.store.http import SCHEMES as WEB_SCHEMES
from farfield.store.http import HttpStore

MANIFEST = "world.json"
"""Key of the one value that makes a store a world."""

_SIGNS_OF_A_BAKE = (MANIFEST, INCOMING, "record")

Place = str | os.PathLike[str]
"""What a user names: a path, or the URL of a bucket or of a folder on a web server."""


def open_store(place: Place, *, create: bool = False) -> Store:
    """The store at `place`: a folder, an archive, or the URL of a bucket or web server; with `create` one that may be
    written to and need not be there yet.

    Raises NotAWorldError: there is nothing at `place`, or a file that is no archive; or, with `create`, it is an
    archive or on a web server, or a folder or bucket that holds something other than a world, finished or begun.
    StoreError: it cannot be read. MissingExtraError: what reads buckets is not installed.
    """
    if is_url(place):
        return _of_url(os.fspath(place), create)
    path = Path(place)
    if path.is_dir():
        if create and not _may_hold_a_world(path):
            raise NotAWorldError("the folder holds something other than a world", str(path), "choose an empty folder")
        return DirectoryStore(path)
    if create and is_archive(place):
        raise NotAWorldError("an archive is written as a whole", str(path), "bake into a folder, then farfield copy it")
    if path.exists() or path.is_symlink():
        if create:
            raise NotAWorldError("this is a file; a world is a folder", str(path))
        return ArchiveStore(path)
    if not create:
        raise NotAWorldError("there is no such folder or file", str(path), "farfield bake SOURCE -o WORLD makes one")
    return DirectoryStore(path)


def is_url(place: Place) -> bool:
    """Whether `place` is written as a URL."""
    return "://" in os.fspath(place)


def is_archive(place: Place) -> bool:
    """Whether `place` has the name of an archive in a file system."""
    return not is_url(place) and os.fspath(place).endswith(SUFFIX) and not Path(place).is_dir()


def _of_url(url: str, create: bool) -> Store:
    scheme = url.partition("://")[0]
    if scheme not in (*SCHEMES, *WEB_SCHEMES):
        known = ", ".join(f"{name}://" for name in (*SCHEMES, *WEB_SCHEMES))
        raise NotAWorldError(f"worlds are not read from {scheme}://", url, f"a folder, a .farfield file, or {known}")
    if url.endswith(SUFFIX):
        hint = "keep the file on a disk, and upload it for the page to read"
        raise NotAWorldError("archives are not read or written in buckets and on web servers", url, hint)
    if scheme not in WEB_SCHEMES:
        return _bucket(url, create)
    if create:
        raise NotAWorldError("nothing is written to web servers", url, "write a folder, and put it there")
    return HttpStore(url)


def _bucket(url: str, create: bool) -> Store:
    store = BucketStore(url)
    if create and not _bucket_may_hold_a_world(store):
        raise NotAWorldError("there is something other than a world", url, "choose another folder of the bucket")
    return store


def _may_hold_a_world(folder: Path) -> bool:
    if any((folder / name).exists() for name in _SIGNS_OF_A_BAKE):
        return True
    return not any(folder.iterdir())


def _bucket_may_hold_a_world(store: BucketStore) -> bool:
    """The signs of a bake or of a copy; a bucket has no folder of incoming values."""
    if not store.holds_any() or store.exists(MANIFEST):
        return True
    return any(store.holds_any(folder) for folder in ("record", "index"))
