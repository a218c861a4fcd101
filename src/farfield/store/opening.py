"""From what a user names to a store."""

from __future__ import annotations

import os
from pathlib import Path

from farfield.errors import NotAWorldError
from farfield.store.contract import Store
from farfield.store.directory import INCOMING, DirectoryStore

MANIFEST = "world.json"
"""Key of the one value that makes a store a world."""

_SIGNS_OF_A_BAKE = (MANIFEST, INCOMING, "record")


def open_store(place: str | os.PathLike[str], *, create: bool = False) -> Store:
    """The store at `place`, a folder; with `create` one that may be written to and need not be there yet.

    Raises NotAWorldError: there is nothing at `place`; it is a file; or, with `create`, it is a folder
    that holds something other than a world, finished or begun.
    """
    path = Path(place)
    if path.is_dir():
        if create and not _may_hold_a_world(path):
            raise NotAWorldError("the folder holds something other than a world", str(path), "choose an empty folder")
    elif path.exists() or path.is_symlink():
        raise NotAWorldError("this is a file; a world is a folder", str(path))
    elif not create:
        raise NotAWorldError("there is no such folder", str(path), "farfield bake SOURCE -o WORLD makes one")
    return DirectoryStore(path)


def _may_hold_a_world(folder: Path) -> bool:
    if any((folder / name).exists() for name in _SIGNS_OF_A_BAKE):
        return True
    return not any(folder.iterdir())
