"""What a copy of a world is written to: a store, or an archive."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock
from typing import Protocol

from farfield.errors import MissingKeyError, NotAWorldError
from farfield.octree.grid import Grid
from farfield.store.archive import ArchiveWriter
from farfield.store.contract import Store
from farfield.store.opening import is_url
from farfield.world import keys
from farfield.world.manifest import KEY, Manifest, read_manifest, with_servers
from farfield.world.reach import first_index_tiles
from farfield.world.servers import ServersRecord


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


class SplitTarget:
    """One folder or bucket for each server of a world. What is above the rule's level, and the manifest, is in each:
    then the world can be opened at any of them, and seen from afar while others are away."""

    manifest_first = False

    def __init__(self, stores: Sequence[Store], servers: ServersRecord, grid: Grid) -> None:
        """stores: in the order of `servers.addresses`."""
        self._parts = [StoreTarget(store) for store in stores]
        self._servers = servers
        self._grid = grid
        self._lock = Lock()
        self.keys = [0] * len(stores)
        """Values of the world that each server has by now."""
        self.bytes = [0] * len(stores)
        """Of those."""
        self.remote = any(part.remote for part in self._parts)

    def has_begun(self, manifest: Manifest) -> bool:
        """See `Target.has_begun`."""
        # Each is asked, for each may be another world's.
        begun = [part.has_begun(manifest) for part in self._parts]
        return any(begun)

    def holds(self, key: str, size: int) -> bool:
        """See `Target.holds`."""
        there = all(self._parts[number].holds(key, size) for number in self._numbers(key))
        if there:
            self._count(key, size)
        return there

    def put(self, key: str, value: bytes) -> None:
        """See `Target.put`."""
        if key == KEY:
            value = with_servers(value, self._servers)
        for number in self._numbers(key):
            self._parts[number].put(key, value)
        self._count(key, len(value))

    def put_in_turn(self, key: str, value: bytes) -> None:
        """Nothing is left to do."""

    def _numbers(self, key: str) -> Sequence[int]:
        number = self._servers.server_of(key, self._grid)
        return range(len(self._parts)) if number is None else (number,)

    def _count(self, key: str, size: int) -> None:
        with self._lock:
            for number in self._numbers(key):
                self.keys[number] += 1
                self.bytes[number] += size


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
