"""The store that requests are answered from."""

from __future__ import annotations

import logging
from threading import Lock

from farfield.errors import FarfieldError
from farfield.store import ArchiveStore, Store
from farfield.store.archive.reader import Identity, identity_at

_log = logging.getLogger("farfield.serve")


class Served:
    """A world that is served. An archive is opened again once another file has taken its place."""

    def __init__(self, world: Store) -> None:
        self._world = world
        self._lock = Lock()
        self._tried = world.identity if isinstance(world, ArchiveStore) else None

    def now(self) -> Store:
        """The world as it is now; one answer is given from one of these, so that it never mixes two archives.

        A file that cannot be read as an archive, such as one that is still being written, changes nothing.
        """
        if isinstance(self._world, ArchiveStore):
            found = identity_at(self._world.location)
            if found not in (None, self._tried):
                self._open_again(found)
        return self._world

    def _open_again(self, found: Identity | None) -> None:
        with self._lock:
            if found == self._tried:
                return
            try:
                archive = ArchiveStore(self._world.location)
            except FarfieldError as error:
                _log.warning("%s", error)
                self._tried = found
            else:
                self._world, self._tried = archive, archive.identity
