"""Notices that a world's manifest has been replaced. Stores have no watch of their own, so it is looked at."""

from __future__ import annotations

from pathlib import Path

from farfield.serve.public import MANIFEST
from farfield.store import DirectoryStore, Store
from farfield.world.manifest import decode_manifest

FOLDER_SECONDS = 0.25
"""Between two looks at a file: a `stat` takes some 10 microseconds."""

STORE_SECONDS = 1.0
"""Between two readings of the manifest from another store: at the usual price of buckets 4 cents a day, and only while
somebody listens."""


class ManifestWatch:
    """Looks at the manifest of one world; for one thread at a time."""

    def __init__(self, world: Store) -> None:
        self._world = world
        self._file = Path(world.location) / MANIFEST if isinstance(world, DirectoryStore) else None
        self._seen: object = None

    @property
    def pause_seconds(self) -> float:
        """How long to wait between two looks."""
        return STORE_SECONDS if self._file is None else FOLDER_SECONDS

    def look(self) -> int | None:
        """The generation, when the manifest is another than at the last look; else None.

        Raises MissingKeyError: there is none. StoreError: it cannot be read. WorldError: it is none.
        """
        identity = self._identity()
        if identity is not None and identity == self._seen:
            return None
        data = self._world.get(MANIFEST)
        if identity is None and data == self._seen:
            return None
        # Even when it turns out to be damaged: it is not read, and complained of, again and again.
        self._seen = data if identity is None else identity
        return decode_manifest(data, self._world.location).generation

    def forget(self) -> None:
        """The next look is the first."""
        self._seen = None

    def _identity(self) -> tuple[int, int, int] | None:
        """What changes when the file is replaced; None where only reading it tells."""
        if self._file is None:
            return None
        try:
            found = self._file.stat(follow_symlinks=False)
        except OSError:
            # Reading it says why.
            return None
        return found.st_ino, found.st_mtime_ns, found.st_size
