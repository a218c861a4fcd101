"""Worlds with BlockMaps: in place of orthoviews, or beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bake.scenes import box, contents, ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.bake.repair import forget
from farfield.geometry.color import LINEAR_OF_BYTE, srgb_from_linear
from farfield.octree.grid import CellKey
from farfield.represent.blockmap.blockmap import SIZES, BlockMap
from farfield.represent.blockmap.coding import decode_blockmap, with_objects
from farfield.scene.model import Material, Mesh, Scene
from farfield.store.archive import ArchiveStore
from farfield.store.archive.writer import writing_archive
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.world.copying import copy_world
from farfield.world.garbage import drop_garbage
from farfield.world.index import CellEntry
from farfield.world.keys import blockmap_key, blockmap_objects_key, record_key
from farfield.world.targets import ArchiveTarget, StoreTarget
from farfield.world.verification import verify_world
from farfield.world.world import World

SIDE = 128.0
OPTIONS = BakeOptions(
    leaf_size=32.0, resolution=32, corner=(0.0, 0.0, -8.0), workers=1, orthoviews=False, blockmap="32:192"
)
BOTH = replace(OPTIONS, orthoviews=True, directions="5")
GLASS, STONE, BRICK = (
    Material(name, (*color, 1.0))
    for name, color in (("glass", (0.1, 0.2, 0.5)), ("stone", (0.5, 0.45, 0.4)), ("brick", (0.5, 0.12, 0.08)))
)
TOWER = (20.3, 21.4, 27.7, 29.2)
TOWER_TOP = 69.0
"""Three leaves high."""
LARGE = (40.3, 41.2, 81.4, 77.7)
CROSSING = (90.4, 27.3, 101.2, 37.4)
Placed = tuple[Mesh, list[tuple[float, float, float]]]


def house(foot: tuple[float, float, float, float], height: float, material: Material) -> Placed:
    return box((foot[0], foot[1], 0.0), (foot[2], foot[3], height), material), [(0.0, 0.0, 0.0)]


def city(*more: Placed, crossing: float = 9.0) -> Scene:
    """A tower, a building larger than a leaf, one across the borders of four leaves, and two of little ones."""
    little = box((0.0, 0.0, 0.0), (7.1, 6.3, 5.0), BRICK)
    return scene_of(
        (ground(1.0, SIDE - 1), [(0.0, 0.0, 0.0)]),
        house(TOWER, TOWER_TOP, GLASS),
        house(LARGE, 12.0, STONE),
        house(CROSSING, crossing, BRICK),
        (little, [(5.2, 100.3, 0.0), (110.3, 110.4, 0.0)]),
        *more,
    )


def baked(scene: Scene, options: BakeOptions = OPTIONS, store: MemoryStore | None = None) -> MemoryStore:
    store = MemoryStore() if store is None else store
    bake(scene, store, options)
    return store


def everything(store: Store) -> dict[str, bytes]:
    """All values but those that tell when they were made."""
    return {key: store.get(key) for key in store.list() if key != "world.json"}


@pytest.fixture(scope="module")
def whole() -> dict[str, bytes]:
    """A baked city."""
    return everything_and_manifest(baked(city()))


def everything_and_manifest(store: Store) -> dict[str, bytes]:
    return {key: store.get(key) for key in store.list()}


def store_of(values: dict[str, bytes]) -> MemoryStore:
    found = MemoryStore()
    for key, value in values.items():
        found.put(key, value)
    return found


@pytest.fixture
def store(whole: dict[str, bytes]) -> MemoryStore:
    """That city, to be changed at will."""
    return store_of(whole)


def entries(store: Store) -> Iterator[CellEntry]:
    return World.open(store).cells()


def read(store: Store, entry: CellEntry) -> BlockMap:
    """With its object ids, if there are any."""
    assert entry.blockmap is not None
    key, ids = (make(entry.cell, entry.blockmap.hash) for make in (blockmap_key, blockmap_objects_key))
    found = decode_blockmap(store.get(key), key)
    return with_objects(found, store.get(ids), ids) if store.exists(ids) else found


def test_every_cell_has_one_and_tells_what_it_is_like(store: MemoryStore) -> None:
    found = list(entries(store))
    assert {entry.cell.level for entry in found} == {0, 1, 2}
    assert max(entry.cell.z for entry in found if entry.cell.level == 0) == 2
    for entry in found:
        assert entry.blockmap is not None
        assert (entry.tiles, entry.hash, entry.errors) == ((), "", ())
        assert len(entry.blockmap.errors) == 3
        assert entry.blockmap.errors == tuple(sorted(entry.blockmap.errors))
        assert len(entry.losses) == len(entry.children)
        assert (entry.geometry is None) == (entry.cell.level > 0)
        assert read(store, entry).objects is not None
    assert not any(key.startswith("orthoview/") for key in store.list())
    assert not verify_world(World.open(store)).faults


def test_one_of_the_root_shows_what_the_city_is_like(store: MemoryStore) -> None:
    world = World.open(store)
    root = read(store, world.entry(world.roots[0]))
    heights, texel = root.heights - 8.0, SIDE / 32
    assert (np.abs(heights[int(25 / texel), int(24 / texel)] - TOWER_TOP)) < 0.5
    y, x = np.mgrid[:32, :32] * texel + texel / 2
    inside = (x > LARGE[0] + texel) & (x < LARGE[2] - texel) & (y > LARGE[1] + texel) & (y < LARGE[3] - texel)
    assert (np.abs(heights[inside] - 12) < 0.5).all()
    assert root.objects is not None
    # Roofs are objects of their own here.
    (tower,), (large,) = np.unique(root.objects[heights > 60]), np.unique(root.objects[inside])
    (plain,) = np.unique(root.objects[np.abs(heights) < 0.5])
    assert len({0, tower, large, plain}) == 4
    assert (heights[root.objects == tower] > 60).all()
    assert np.nanmin(heights) == pytest.approx(0, abs=0.3)


def test_beside_orthoviews_they_are_a_form_of_their_own(whole: dict[str, bytes]) -> None:
    store = baked(city(), BOTH)
    alone = {entry.key: entry.blockmap for entry in entries(store_of(whole))}
    found = list(entries(store))
    assert {entry.key for entry in found} == set(alone)
    for entry in found:
        assert entry.tiles
        assert entry.errors
        assert entry.blockmap == alone[entry.key]
        assert len(entry.losses) == len(entry.children)
    assert not verify_world(World.open(store)).faults
    assert drop_garbage(store).keys == 0


def test_without_object_ids_there_are_none(whole: dict[str, bytes]) -> None:
    store = baked(city(), replace(OPTIONS, object_ids=False))
    assert not any(key.startswith("objects/") for key in store.list())
    maps = {key.rpartition("-")[0]: value for key, value in whole.items() if key.startswith("blockmap/")}
    assert {key.rpartition("-")[0]: store.get(key) for key in store.list("blockmap")} == maps
    assert not verify_world(World.open(store)).faults


def test_worlds_of_them_alone_need_no_geometry() -> None:
    store = baked(city(), replace(OPTIONS, geometry=False))
    assert all(entry.geometry is None and entry.blockmap for entry in entries(store))
    assert {key.split("/")[0] for key in store.list()} >= {"blockmap", "objects", "index", "record"}
    assert drop_garbage(store).keys == 0


def test_levels_look_alike_from_above(store: MemoryStore) -> None:
    """The mean light of all tops in a cell, and of those in the cell above."""
    world = World.open(store)
    for entry in entries(store):
        if entry.cell.level == 0 or entry.cell.z or entry.key == "1/0/0/0":
            continue  # Of a tower the leaf below knows no roof.
        own = read(store, entry)
        below = [read(store, world.entry(CellKey.parse(key))) for key in entry.children if key.endswith("/0")]
        colors = [LINEAR_OF_BYTE[one.colors[:, :32][one.codes > 0]] for one in (own, *below)]
        shown, true = (srgb_from_linear(light.mean(axis=0)) * 255 for light in (colors[0], np.concatenate(colors[1:])))
        assert np.abs(shown - true).max() < 8, entry.key


@pytest.mark.parametrize("damage", ["altered", "cut", "gone"])
def test_what_is_damaged_is_found_and_made_again(store: MemoryStore, whole: dict[str, bytes], damage: str) -> None:
    world = World.open(store)
    leaf, root = world.entry(CellKey(0, 1, 1, 0)), world.entry(world.roots[0])
    assert leaf.blockmap is not None
    assert root.blockmap is not None
    bad = [blockmap_key(leaf.cell, leaf.blockmap.hash), blockmap_key(root.cell, root.blockmap.hash)]
    if damage != "gone":
        bad.append(blockmap_objects_key(root.cell, root.blockmap.hash))
    for key in bad:
        if damage == "gone":
            store.delete(key)
        elif damage == "cut":
            store.put(key, store.get(key)[:-3])
        else:
            store.put(key, store.get(key)[:-1] + bytes([store.get(key)[-1] ^ 4]))
    faults = [fault.key for fault in verify_world(World.open(store)).faults]
    assert sorted(faults) == sorted(bad)
    forget(World.open(store), faults)
    assert bake(city(), store, OPTIONS).cells_rebuilt >= 1
    assert everything_and_manifest(store) == whole


def test_copies_hold_them_and_their_object_ids(store: MemoryStore, tmp_path: Path) -> None:
    """In an archive, and out of it again."""
    path, again = tmp_path / "city.ffa", MemoryStore()
    with writing_archive(path) as writer:
        copy_world(store, ArchiveTarget(writer))
    archive = ArchiveStore(path)
    copy_world(archive, StoreTarget(again))
    public = {key: value for key, value in everything_and_manifest(store).items() if not key.startswith("record/")}
    assert everything_and_manifest(again) == public
    for kind in ("blockmap/", "objects/"):
        assert len(list(again.list(kind))) == len(list(entries(store)))
    assert not verify_world(World.open(archive)).faults


class KilledError(Exception):
    """The bake is ended here."""


class FailingStore(MemoryStore):
    """Ends the bake after some values."""

    writes = -1

    def put(self, key: str, data: bytes) -> None:
        """As a store does."""
        if self.writes == 0:
            raise KilledError
        self.writes -= 1
        super().put(key, data)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8, 0.97])
def test_an_interrupted_bake_goes_on_to_the_same_bytes(whole: dict[str, bytes], share: float) -> None:
    store = FailingStore()
    store.writes = int(share * len(whole))
    with pytest.raises(KilledError):
        bake(city(), store, OPTIONS)
    kept = len(list(store.list("record")))
    store.writes = -1
    result = bake(city(), store, OPTIONS)
    assert everything_and_manifest(store) == whole
    assert result.cells_rebuilt <= len(list(entries(store))) - max(kept - 4, 0)


def test_workers_make_the_same_bytes(whole: dict[str, bytes], tmp_path: Path) -> None:
    bake(city(), DirectoryStore(tmp_path), replace(OPTIONS, workers=2))
    assert contents(tmp_path) == {key: value for key, value in whole.items() if not key.startswith("record/")}


def path_to(world: World, cell: CellKey) -> set[CellKey]:
    """A leaf and all cells above it."""
    return {world.grid.ancestor(cell, level) for level in range(world.grid.top_level + 1)}


@pytest.mark.parametrize("options", [OPTIONS, BOTH, replace(OPTIONS, geometry=False)])
def test_an_update_bakes_the_paths_to_what_changed_and_ends_in_the_bytes_of_a_whole_bake(options: BakeOptions) -> None:
    store, straight = baked(city(), options), baked(city(crossing=14.0), options)
    before = {entry.key: entry.blockmap for entry in entries(store)}
    untouched = {key: store.get(key) for key in store.list("blockmap")}
    written = Recording()
    for key in store.list():
        MemoryStore.put(written, key, store.get(key))
    result = bake(city(crossing=14.0), written, options)
    world = World.open(written)
    changed = {CellKey.parse(entry.key) for entry in world.cells() if entry.blockmap != before[entry.key]}
    paths = {cell for x in (2, 3) for y in (0, 1) for cell in path_to(world, CellKey(0, x, y, 0))}
    assert changed == paths
    assert result.cells_rebuilt == len(paths)
    maps = {
        CellKey.parse(key.split("/", 1)[1].rpartition("-")[0]) for key in written.keys if key.startswith("blockmap")
    }
    assert maps == paths
    for key, value in untouched.items():
        assert written.get(key) == value
    drop_garbage(written)
    assert everything(written) == everything(straight)
    assert not verify_world(world).faults


class Recording(MemoryStore):
    """Remembers what was written."""

    def __init__(self) -> None:
        super().__init__()
        self.keys: list[str] = []

    def put(self, key: str, data: bytes) -> None:
        """As a store does."""
        self.keys.append(key)
        super().put(key, data)


def test_a_bake_of_the_same_bakes_nothing(store: MemoryStore, whole: dict[str, bytes]) -> None:
    assert bake(city(), store, OPTIONS).cells_rebuilt == 0
    assert everything_and_manifest(store) == whole
    assert drop_garbage(store).keys == 0


@pytest.mark.parametrize("geometry", [True, False])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_what_an_interrupted_update_left_behind_is_forgotten_with_its_values(geometry: bool, share: float) -> None:
    """Notes of cells that were not finished would let the next update believe that their BlockMaps are there."""
    options, store = replace(OPTIONS, geometry=geometry), FailingStore()
    baked(city(), options, store)
    straight = baked(city(crossing=14.0), options)
    # The new values are: scene, 4 leaves, 4 cells above, index, manifest.
    fresh = set(straight.list()) - set(store.list())
    store.writes = int(share * (len(fresh) + 9))
    with pytest.raises(KilledError):
        bake(city(crossing=14.0), store, options)
    store.writes = -1
    drop_garbage(store)
    assert not verify_world(World.open(store)).faults
    bake(city(crossing=14.0), store, options)
    assert not verify_world(World.open(store)).faults
    drop_garbage(store)
    assert everything(store) == everything(straight)


def test_a_mast_that_nothing_of_is_seen_from_above_takes_them_from_no_cell_above() -> None:
    """Thinner than a texel it has none itself where it stands in a cell alone."""
    mast = box((60.1, 61.1, 0.0), (60.2, 61.2, 60.0), STONE), [(0.0, 0.0, 0.0)]
    sign = box((100.3, 100.0, 20.0), (104.0, 100.1, 70.0), BRICK), [(0.0, 0.0, 0.0)]
    store = baked(city(mast, sign))
    world = World.open(store)
    without = {entry.key for entry in world.cells() if entry.blockmap is None}
    assert without == {"0/1/1/1", "0/1/1/2", "0/3/3/1", "0/3/3/2", "1/1/1/1"} & {entry.key for entry in world.cells()}
    assert len(without) > 3
    for entry in world.cells():
        assert len(entry.losses) == (len(entry.children) if entry.blockmap else 0)
    assert not verify_world(world).faults
    # Without the mast the losses of one cell less are told.
    again = baked(city(sign), OPTIONS, store)
    drop_garbage(again)
    assert everything(again) == everything(baked(city(sign)))


def test_what_shines_by_itself_takes_none_away() -> None:
    lamp = box((70.0, 90.0, 0.0), (74.0, 94.0, 4.0), Material("lamp", unlit=True)), [(0.0, 0.0, 0.0)]
    world = World.open(baked(city(lamp), BOTH))
    assert all(entry.blockmap is not None for entry in world.cells())


def test_object_ids_are_those_of_the_scene_after_a_change_that_no_map_shows() -> None:
    """What is hidden in a house goes, and others are numbered anew."""
    # All stand in the same square of the numbering: their meshes are where they are.
    hidden = [(box((50.0 + x, 45.0, 2.0), (51.0 + x, 46.0, 3.0), STONE), [(0.0, 0.0, 0.0)]) for x in range(0, 20, 2)]
    before, straight = baked(city(*hidden)), baked(city())
    values = everything_and_manifest(before)
    store = baked(city(), OPTIONS, before)
    # Whatever carries a hash never changes.
    assert {key: store.get(key) for key in values if "-" in key} == {k: v for k, v in values.items() if "-" in k}
    drop_garbage(store)
    assert everything(store) == everything(straight)


@pytest.mark.parametrize("size", SIZES[::2])
def test_other_sizes(size: object) -> None:
    store = baked(city(), replace(OPTIONS, blockmap=str(size)))
    assert all(read(store, entry).size == size for entry in entries(store))
    assert store.exists(record_key(CellKey(0, 0, 0, 0)))
