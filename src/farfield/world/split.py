"""A world split over several servers, read as if it were in one place (spec/world.md, Servers)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from heapq import merge
from typing import Never
from urllib.parse import urljoin

from farfield.errors import DamagedValueError, MissingKeyError, NotAWorldError, OptionError, StoreError, WorldError
from farfield.octree.grid import Grid
from farfield.store import ArchiveStore, BucketStore, DirectoryStore, HttpStore, Place, Store, open_store
from farfield.store.opening import is_url
from farfield.world.manifest import KEY, Manifest, read_manifest, with_servers
from farfield.world.servers import ServersRecord

_HINT = "farfield copy it into one place first"


class SplitStore:
    """The values of all servers of a world, with a manifest that names no servers. Keeps the contract of `Store`, but
    for `put`, `delete` and `writing`, which raise StoreError."""

    def __init__(self, home: Store, parts: Sequence[Store], servers: ServersRecord, grid: Grid) -> None:
        """home: where the manifest was read. parts: the servers, in the order of `servers.addresses`."""
        self._home = home
        self._parts = tuple(parts)
        self._servers = servers
        self._grid = grid

    @property
    def location(self) -> str:
        """That of the manifest."""
        return self._home.location

    @property
    def remote(self) -> bool:
        """Whether any of the servers answers over a network."""
        return any(is_url(store.location) for store in (self._home, *self._parts))

    def get(self, key: str) -> bytes:
        """See `Store.get`. Raises DamagedValueError where another server than the manifest's fails: there is a rest."""
        store = self._of(key)
        try:
            data = store.get(key)
        except MissingKeyError:
            raise
        except StoreError as error:
            if store is self._home:
                raise
            raise DamagedValueError(error.what, error.where, error.hint) from error
        return with_servers(data, None) if key == KEY else data

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        if key != KEY:
            return self._of(key).get_range(key, start, length)
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        return self.get(key)[start : start + length]

    def put(self, key: str, data: bytes) -> None:
        """Raises StoreError."""
        self._refuse()

    def writing(self) -> AbstractContextManager[None]:
        """Raises StoreError."""
        self._refuse()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        return self._of(key).exists(key)

    def size(self, key: str) -> int:
        """See `Store.size`."""
        return len(self.get(key)) if key == KEY else self._of(key).size(key)

    def delete(self, key: str) -> None:
        """Raises StoreError."""
        self._refuse()

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`. What a server has without being asked for it by the rule is passed over."""
        own = [self._own(store, prefix) for store in dict.fromkeys((self._home, *self._parts))]
        yield from merge(*own, key=lambda key: key.split("/"))

    def _of(self, key: str) -> Store:
        number = self._servers.server_of(key, self._grid)
        return self._home if number is None else self._parts[number]

    def _own(self, store: Store, prefix: str) -> Iterator[str]:
        return (key for key in store.list(prefix) if self._of(key) is store)

    def _refuse(self) -> Never:
        raise StoreError("a world split over servers is only read", self.location, _HINT)


def joined(store: Store, manifest: Manifest) -> Store:
    """The store of the whole world whose `manifest` was read from `store`, which is `store` itself unless it is split.

    A relative address leads to a folder in or beside the manifest's own: on a disk, in a bucket, on a web server.
    Raises NotAWorldError: the manifest lies where such an address leads nowhere, in an archive among others.
    """
    servers = manifest.servers
    if not servers:
        return store
    if isinstance(store, ArchiveStore):
        raise NotAWorldError("an archive holds all of a world and is not split over servers", store.location)
    parts = [_part(store, address) for address in servers.addresses]
    return SplitStore(store, parts, servers, manifest.octree)


def open_world(place: Place) -> Store:
    """The store of the world at `place`, for reading; one that is split over servers as if it were in one place.

    Raises NotAWorldError, VersionError or StoreError; and as `open_store`.
    """
    store = open_store(place)
    return joined(store, read_manifest(store))


def open_served(place: Place) -> Store:
    """What a server at `place` has to offer: all of a world in one place, or split over folders that are all there;
    of others what lies at `place`, with a manifest that leads its readers to the other servers. Raises as `open_world`.
    """
    store = open_store(place)
    manifest = read_manifest(store)
    # Nobody gets to see through this server what only it can reach.
    if not manifest.servers or any(map(is_url, manifest.servers.addresses)):
        return store
    parts = [_part(store, address) for address in manifest.servers.addresses]
    return joined(store, manifest) if all(part.exists(KEY) for part in parts) else store


def refuse_split(store: Store) -> None:
    """Raises WorldError for a part of a world that is split: what is baked or dropped there would tear it apart."""
    try:
        servers = read_manifest(store).servers
    except WorldError:
        return
    if servers:
        raise WorldError("this is one part of a world that is split over servers", store.location, _HINT)


def _part(home: Store, address: str) -> Store:
    """The store of the server at `address`, which is one by `servers.is_address`."""
    if is_url(address):
        return HttpStore(address)
    if address == "./":
        return home
    if isinstance(home, HttpStore):
        return HttpStore(urljoin(f"{home.location}/", address))
    name, beside = address.removeprefix("../").removesuffix("/"), address.startswith("../")
    if isinstance(home, DirectoryStore):
        return _folder(home, name, beside)
    if isinstance(home, BucketStore):
        return _folder_of_bucket(home, name, beside)
    raise NotAWorldError("only folders and web servers hold parts of a world", home.location)


def _folder(home: DirectoryStore, name: str, beside: bool) -> Store:
    """Links are not followed, so that a world from a stranger shows nothing but what came with it or lies beside it."""
    own = os.path.realpath(home.location)
    path = os.path.join(os.path.dirname(own) if beside else own, name)
    if os.path.islink(path):
        raise NotAWorldError("the folder of a server is a symbolic link", path, "put the folder itself there")
    return DirectoryStore(path)


def _folder_of_bucket(home: BucketStore, name: str, beside: bool) -> Store:
    scheme, _, path = home.location.partition("://")
    if beside:
        path, slash, _ = path.rpartition("/")
        if not slash:
            raise NotAWorldError("an address leads out of the bucket", home.location, "put the parts into folders")
    return BucketStore(f"{scheme}://{path}/{name}")
