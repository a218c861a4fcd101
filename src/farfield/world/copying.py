"""From one store to another: what the manifest reaches, and nothing else."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from farfield.errors import CorruptTileError, MissingKeyError, OptionError
from farfield.octree.grid import CellKey
from farfield.progress import NoProgress, Progress
from farfield.store.archive.order import rank
from farfield.store.contract import Store
from farfield.store.opening import is_url
from farfield.world import keys
from farfield.world.attributes import attribute_tables
from farfield.world.index import CellEntry, decode_index
from farfield.world.manifest import KEY, decode_manifest, manifest_bytes
from farfield.world.reach import (
    IndexRoot,
    blockmap_keys,
    blockmap_object_keys,
    first_index_tiles,
    geometry_keys,
    images_of,
    meshes_of,
    parted,
    textures_of,
)
from farfield.world.split import SplitStore
from farfield.world.targets import Target

REQUESTS = 16
"""Values under way at once where one side answers over a network; a sixteenth of the time, mostly."""

DISK_REQUESTS = 2
"""The same between disks, where more would only wait for each other."""

UNDER_WAY_BYTES = 64 << 20
"""Bytes of values held at once, unless one alone has more."""

UNKNOWN_BYTES = 1 << 20
"""What a value counts whose size the index does not tell: an image, a table of attributes, object ids."""

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Copied:
    """What a copy came to."""

    keys: int
    """Values of the world."""
    bytes: int
    """Of all of them."""
    skipped: int
    """Values among them that the target held already."""


class _Wanted(NamedTuple):
    """A value to be copied."""

    key: str
    size: int | None = None
    """Bytes, where the index tells."""
    optional: bool = False
    """Whether it may be missing."""


class _Moved(NamedTuple):
    """A value that has been read and offered to the target."""

    key: str
    size: int
    skipped: bool = False
    value: bytes = b""
    """Empty when skipped, unless it names others."""
    textures: tuple[str, ...] = ()


class _Cell(NamedTuple):
    """What has to be remembered of a cell until its turn: some 200 bytes and 24 a tile."""

    key: CellKey
    hash: str
    tiles: array[int]
    """Direction, layer and bytes of each tile, one after the other."""
    geometry: tuple[tuple[str, int], ...]
    """Key and bytes of each form, and of its BlockMap."""
    objects: tuple[str, ...]
    """Keys of the object ids of its BlockMaps."""


def copy_world(source: Store, target: Target, progress: Progress | None = None) -> Copied:
    """Copy the world in `source`; of a store that holds a part of it already, the rest.

    The manifest comes last, so that readers of the target never see half a world. Memory: UNDER_WAY_BYTES, the list
    of cells, and, for an archive, an entry a key.

    Raises NotAWorldError: no world, or another one in the target. VersionError, StoreError: as reading and writing
    do, a value that is missing included. CorruptTileError: an index tile or a GLB is damaged.
    """
    return _Copy(source, target, progress or NoProgress()).run()


class _Copy:
    """One copy under way."""

    def __init__(self, source: Store, target: Target, progress: Progress) -> None:
        self._source = source
        self._target = target
        self._progress = progress
        self._keys = self._bytes = self._skipped = 0
        self._meshes: dict[str, int] = {}
        """Hash → bytes."""
        self._textures: dict[str, None] = {}
        data = manifest_bytes(source)
        # What is decoded and what is written are the same, even if the source gets a new generation meanwhile.
        self._manifest_bytes, self._manifest = data, decode_manifest(data, f"{source.location}/{KEY}")
        self._resuming = target.has_begun(self._manifest)
        requests = REQUESTS if target.remote or _is_remote(source) else DISK_REQUESTS
        self._pool = ThreadPoolExecutor(requests)

    def run(self) -> Copied:
        try:
            if self._target.manifest_first:
                self._put_manifest()
            self._copy_cells(sorted(self._copy_index(), key=lambda cell: rank(keys.geometry_key(cell.key, ""))))
            self._copy_shared()
            if not self._target.manifest_first:
                self._put_manifest()
        finally:
            self._pool.shutdown(cancel_futures=True)
        return Copied(self._keys, self._bytes, self._skipped)

    def _put_manifest(self) -> None:
        self._target.put(KEY, self._manifest_bytes)
        self._target.put_in_turn(KEY, self._manifest_bytes)
        self._keys += 1
        self._bytes += len(self._manifest_bytes)

    def _copy_index(self) -> list[_Cell]:
        """Copies the index, level by level, and returns the cells it lists."""
        self._progress.start(None, "index tiles")
        cells: list[_Cell] = []
        pending: list[IndexRoot] = first_index_tiles(self._manifest)
        while pending:
            wanted = sorted((_Wanted(keys.index_key(*root)) for root in pending), key=lambda one: rank(one.key))
            pending = []
            for moved in self._copy(wanted):
                try:
                    below, entries = parted(decode_index(moved.value, moved.key))
                    cells += map(self._remembered, entries)
                except (OptionError, OverflowError) as error:
                    what = f"the index tile names what cannot be: {error}"
                    raise CorruptTileError(what, moved.key, "run farfield verify") from None
                pending += below
                self._progress.advance()
        return cells

    def _remembered(self, entry: CellEntry) -> _Cell:
        self._meshes.update(meshes_of(entry))
        self._textures.update(dict.fromkeys(images_of(entry)))
        tiles = array("Q", [number for tile in entry.tiles for number in tile])
        return _Cell(
            entry.cell,
            entry.hash,
            tiles,
            (*geometry_keys(entry), *blockmap_keys(entry)),
            tuple(blockmap_object_keys(entry)),
        )

    def _copy_cells(self, cells: list[_Cell]) -> None:
        self._progress.start(sum(len(cell.tiles) // 3 + len(cell.geometry) for cell in cells), "tiles")
        for _ in self._copy(wanted for cell in cells for wanted in _pictures_of(cell)):
            self._progress.advance()
        # The index does not tell which tiles have object ids: each is asked for, and may be missing.
        self._progress.start(sum(len(cell.tiles) // 3 + len(cell.objects) for cell in cells), "object ids")
        for _ in self._copy(wanted for cell in cells for wanted in _object_ids_of(cell)):
            self._progress.advance()

    def _copy_shared(self) -> None:
        """Meshes before images: they name some."""
        attributes = self._manifest.attributes
        first: list[_Wanted] = []
        if attributes:
            first = [_Wanted(keys.attributes_key(attributes))]
            first += [_Wanted(key) for key in attribute_tables(self._source, attributes)]
        first += [_Wanted(keys.mesh_key(name), self._meshes[name]) for name in sorted(self._meshes)]
        self._progress.start(len(first), "meshes")
        for _ in self._copy(first):
            self._progress.advance()
        images = [_Wanted(keys.texture_key(name)) for name in sorted(self._textures)]
        self._progress.start(len(images), "images")
        for _ in self._copy(images):
            self._progress.advance()
        self._progress.finish()

    def _copy(self, wanted: Iterable[_Wanted]) -> Iterator[_Moved]:
        """Copies values, several at once; gives those that are there, in the order of `wanted`."""
        for moved in _in_order(self._pool, self._move, wanted):
            if moved is None:
                continue
            self._target.put_in_turn(moved.key, moved.value)
            self._keys += 1
            self._bytes += moved.size
            self._skipped += moved.skipped
            self._textures.update(dict.fromkeys(moved.textures))
            yield moved

    def _move(self, wanted: _Wanted) -> _Moved | None:
        """Reads one value and offers it to the target; None: it is missing, as it may be."""
        key = wanted.key
        # What names others has to be read in any case.
        names_others = key.startswith(("index/", "geometry/", "mesh/"))
        try:
            if self._resuming and not names_others:
                size = self._source.size(key) if wanted.size is None else wanted.size
                if self._target.holds(key, size):
                    return _Moved(key, size, skipped=True)
            value = self._source.get(key)
        except MissingKeyError:
            if wanted.optional:
                return None
            raise
        skipped = self._resuming and names_others and self._target.holds(key, len(value))
        if not skipped:
            self._target.put(key, value)
        return _Moved(key, len(value), skipped, value, tuple(textures_of(value, key)) if names_others else ())


def _is_remote(store: Store) -> bool:
    """Whether it answers over a network."""
    return store.remote if isinstance(store, SplitStore) else is_url(store.location)


def _pictures_of(cell: _Cell) -> Iterator[_Wanted]:
    """Geometry and orthoview tiles of a cell, in the order of an archive."""
    for key, size in cell.geometry:
        yield _Wanted(key, size)
    for direction, layer, size in _tiles_of(cell):
        yield _Wanted(keys.orthoview_key(cell.key, direction, layer, cell.hash), size)


def _object_ids_of(cell: _Cell) -> Iterator[_Wanted]:
    for direction, layer, _ in _tiles_of(cell):
        yield _Wanted(keys.objects_key(cell.key, direction, layer, cell.hash), optional=True)
    for key in cell.objects:
        yield _Wanted(key, optional=True)


def _tiles_of(cell: _Cell) -> list[tuple[int, int, int]]:
    """Direction, layer and bytes of each tile, ordered as their keys are."""
    tiles = zip(cell.tiles[0::3], cell.tiles[1::3], cell.tiles[2::3], strict=True)
    return sorted(tiles, key=lambda tile: (str(tile[0]), str(tile[1])))


def _in_order(pool: ThreadPoolExecutor, move: Callable[[_Wanted], _T], wanted: Iterable[_Wanted]) -> Iterator[_T]:
    """`move` of each, in order, as many under way as UNDER_WAY_BYTES hold."""
    under_way: deque[tuple[int, Future[_T]]] = deque()
    held = 0
    for one in wanted:
        size = UNKNOWN_BYTES if one.size is None else one.size
        while under_way and (held + size > UNDER_WAY_BYTES or len(under_way) >= 4 * REQUESTS):
            before, future = under_way.popleft()
            held -= before
            yield future.result()
        under_way.append((size, pool.submit(move, one)))
        held += size
    for _, future in under_way:
        yield future.result()
