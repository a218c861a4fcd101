"""Notices that a world's manifest has been replaced. Stores have no watch of their own, so it is looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from farfield.serve.public import MANIFEST, tag_of
from farfield.serve.served import Served
from farfield.store import ArchiveStore, DirectoryStore
from farfield.store.archive.reader import Identity, identity_at
from farfield.world.manifest import decode_manifest

FILE_SECONDS = 0.25
"""Between two looks at a file: a `stat` takes some 10 microseconds."""

STORE_SECONDS = 1.0
"""Between two readings of the manifest from another store: at the usual price of buckets 4 cents a day, and only while
somebody listens."""


@dataclass(frozen=True, slots=True)
class Edition:
    """A manifest that was seen."""

    generation: int
    tag: str
    """Of its bytes (`tag_of`): a world that is baked from nothing again begins with generation 1 again."""


class ManifestWatch:
    """Looks at the manifest of one world; for one thread at a time."""

    def __init__(self, world: Served) -> None:
        self._world = world
        self._file = _file_of(world)
        self._seen: object = None

    @property
    def pause_seconds(self) -> float:
        """How long to wait between two looks."""
        return STORE_SECONDS if self._file is None else FILE_SECONDS

    def look(self) -> Edition | None:
        """The manifest's edition, when it is another than at the last look; else None.

        Raises MissingKeyError: there is none. StoreError: it cannot be read. WorldError: it is none.
        """
        identity = self._identity()
        if identity is not None and identity == self._seen:
            return None
        world = self._world.now()
        data = world.get(MANIFEST)
        if identity is None and data == self._seen:
            return None
        # Even when it turns out to be damaged: it is not read, and complained of, again and again.
        self._seen = data if identity is None else identity
        return Edition(decode_manifest(data, world.location).generation, tag_of(data))

    def forget(self) -> None:
        """The next look is the first."""
        self._seen = None

    def _identity(self) -> Identity | None:
        """What changes when the file is replaced; None where only reading the manifest tells."""
        return None if self._file is None else identity_at(self._file)


def _file_of(world: Served) -> Path | None:
    """The file that is another when the manifest is; None: it is in none."""
    store = world.now()
    if isinstance(store, DirectoryStore):
        return Path(store.location) / MANIFEST
    return Path(store.location) if isinstance(store, ArchiveStore) else None
