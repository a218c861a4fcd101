"""What a copy of a world is written to: a store, or an archive."""

from __future__ import annotations

from typing import Protocol

from farfield.errors import MissingKeyError, NotAWorldError
from farfield.store.archive import ArchiveWriter
from farfield.store.contract import Store
from farfield.store.opening import is_url
from farfield.world import keys
from farfield.world.manifest import KEY, Manifest, read_manifest
from farfield.world.reach import first_index_tiles


class Target(Protocol):
    """Where the values go."""

    manifest_first: bool
    """Whether the manifest is to be the first value, not the last."""

    remote: bool
    """Whether it answers over a network."""

    def has_begun(self, manifest: Manifest) -> bool:
        """Whether any of the world is there already. Raises NotAWorldError: another world is."""
        ...

    def holds(self, key: str, size: int) -> bool:
        """Whether a value of so many bytes is there; from any thread."""
        ...

    def put(self, key: str, value: bytes) -> None:
        """Takes a value, from any thread and in any order."""
        ...

    def put_in_turn(self, key: str, value: bytes) -> None:
        """Takes a value, from one thread and in order."""
        ...


class StoreTarget:
    """A folder or bucket. Its writes may wait for a network, so they are done by those who read."""

    manifest_first = False

    def __init__(self, store: Store) -> None:
        self._store = store
        self.remote = is_url(store.location)

    def has_begun(self, manifest: Manifest) -> bool:
        """See `Target.has_begun`."""
        first = [keys.index_key(*root) for root in first_index_tiles(manifest)]
        if self._store.exists(KEY):
            _refuse_another_world(manifest, read_manifest(self._store), self._store.location)
            return True
        # The index is what a copy begins with.
        return any(map(self._store.exists, first))

    def holds(self, key: str, size: int) -> bool:
        """See `Target.holds`. The name carries a hash, so the size tells."""
        try:
            return self._store.size(key) == size
        except MissingKeyError:
            return False

    def put(self, key: str, value: bytes) -> None:
        """See `Target.put`."""
        self._store.put(key, value)

    def put_in_turn(self, key: str, value: bytes) -> None:
        """Nothing is left to do."""


class ArchiveTarget:
    """An archive that is being written: always new, and its values lie in the order of a picture's needs."""

    manifest_first = True
    remote = False

    def __init__(self, writer: ArchiveWriter) -> None:
        self._writer = writer

    def has_begun(self, manifest: Manifest) -> bool:
        """Never."""
        return False

    def holds(self, key: str, size: int) -> bool:
        """Never."""
        return False

    def put(self, key: str, value: bytes) -> None:
        """Nothing yet: it waits for its turn."""

    def put_in_turn(self, key: str, value: bytes) -> None:
        """See `Target.put_in_turn`."""
        self._writer.put(key, value)


def _refuse_another_world(ours: Manifest, there: Manifest, where: str) -> None:
    """A later generation of the same world may take the place of an earlier one, another world may not."""
    if (there.name, there.grid, there.crs, there.origin) != (ours.name, ours.grid, ours.crs, ours.origin):
        raise NotAWorldError(f"there is another world, {there.name!r}", where, "choose an empty place")
