"""A small village through the whole bake and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bake.scenes import Held, ground, scene_of, village
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.errors import InputError, OptionError
from farfield.octree.grid import CellKey
from farfield.progress import NoProgress
from farfield.scene.model import Mesh, Scene
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.world.world import World

SMALL = BakeOptions(leaf_size=4.0, resolution=32, directions="9+0.3,0.2,0.9", workers=1)


def contents(store: MemoryStore | DirectoryStore) -> dict[str, bytes]:
    """Everything in a store."""
    return {key: store.get(key) for key in store.list()}


@pytest.fixture(scope="module")
def baked() -> MemoryStore:
    """The village, baked."""
    store = MemoryStore()
    bake(village(), store, SMALL)
    return store


def test_every_tile_the_index_names_is_there_and_decodes(baked: MemoryStore) -> None:
    world = World.open(baked)
    tiles = 0
    for entry in world.cells():
        for direction, layer, size in entry.tiles:
            tile = world.tile(entry, direction, layer)
            assert (tile.direction, tile.index, tile.level) == (direction, layer, entry.cell.level)
            assert size > 0
            tiles += 1
    assert tiles == world.manifest.statistics.tiles > 100


def test_the_tree_is_whole(baked: MemoryStore) -> None:
    world = World.open(baked)
    cells = {entry.cell: entry for entry in world.cells()}
    assert len(cells) == world.manifest.statistics.cells
    for key, entry in cells.items():
        for child in world.children(key):
            assert world.grid.parent(child) == key
            lower, upper = np.array(cells[child].bounds)
            assert (lower >= np.array(entry.bounds[0])).all()
            assert (upper <= np.array(entry.bounds[1])).all()
        if key.level == 0:
            assert entry.geometry is not None


def test_the_number_of_workers_does_not_change_a_byte(baked: MemoryStore, tmp_path: Path) -> None:
    store = DirectoryStore(tmp_path / "world")
    bake(village(), store, replace(SMALL, workers=2))
    assert contents(store) == contents(baked)


def test_the_order_of_instances_does_not_change_a_tile(baked: MemoryStore) -> None:
    scene = village()
    order = np.arange(len(scene.instances.mesh))[::-1]
    turned = replace(
        scene,
        instances=replace(
            scene.instances,
            mesh=scene.instances.mesh[order],
            transform=scene.instances.transform[order],
            first_object=scene.instances.first_object[order],
            objects=scene.instances.objects[order],
        ),
    )
    store = MemoryStore()
    bake(turned, store, SMALL)
    assert set(store.list("orthoview")) == set(baked.list("orthoview"))


class KilledError(Exception):
    """Stands for a kill."""


class FailingStore(MemoryStore):
    """Stops after a number of writes."""

    def __init__(self, writes: int) -> None:
        super().__init__()
        self.writes = writes

    def put(self, key: str, data: bytes) -> None:
        """Writes, or fails."""
        if self.writes == 0:
            raise KilledError
        self.writes -= 1
        super().put(key, data)


@pytest.mark.parametrize("writes", [3, 40, 200, 700])
def test_an_interrupted_bake_goes_on_to_the_same_bytes(baked: MemoryStore, writes: int) -> None:
    store = FailingStore(writes)
    with pytest.raises(KilledError):
        bake(village(), store, SMALL)
    finished = len(list(store.list("record")))
    store.writes = -1
    result = bake(village(), store, SMALL)
    assert contents(store) == contents(baked)
    assert result.cells_rebuilt <= len(list(store.list("record"))) - finished


def test_baking_again_builds_nothing(baked: MemoryStore) -> None:
    result = bake(village(), baked, SMALL)
    assert result.cells_rebuilt == 0
    bake(village(), MemoryStore(), SMALL)


def test_flat_worlds_have_flat_upper_cells() -> None:
    result = bake(scene_of((ground(-30.0, 30.0), [(0.0, 0.0, 0.0)])), MemoryStore(), replace(SMALL, directions="5"))
    assert result.manifest.grid.axis_levels == (4, 4, 0)


def test_a_given_corner_inside_the_scene_gives_several_roots() -> None:
    store = MemoryStore()
    options = replace(SMALL, directions="5", corner=(0.5, 1.0, -0.25))
    bake(scene_of((ground(-9.0, 9.0), [(0.0, 0.0, 0.0)])), store, options)
    world = World.open(store)
    assert [key[1:] for key in world.roots] == [(-1, -1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 0)]
    leaves = [entry.cell for entry in world.cells() if entry.cell.level == 0]
    assert min(key.x for key in leaves) == -3


def test_a_mesh_that_cannot_be_read_is_left_out() -> None:
    class Broken(Held):
        def load(self) -> Mesh:
            raise InputError("is truncated", "b.glb", "export it again")

    notes: list[str] = []

    class Listening(NoProgress):
        def note(self, text: str) -> None:
            notes.append(text)

    scene = village()
    broken: Scene = replace(scene, meshes=[*scene.meshes[:-1], Broken(ground(0, 1))])
    bake(broken, MemoryStore(), SMALL, Listening())
    assert any("b.glb: is truncated" in note for note in notes)


def test_a_scene_without_triangles_is_refused() -> None:
    empty = replace(ground(0, 1), triangles=np.zeros((0, 3), np.uint32), triangle_material=np.zeros(0, np.uint16))
    with pytest.raises(InputError, match="no triangle"):
        bake(scene_of((replace(empty, triangle_object=None), [(0, 0, 0)])), MemoryStore(), SMALL)


@pytest.mark.parametrize(
    "wrong", [{"leaf_size": -1.0}, {"resolution": 100}, {"depth_layers": 3}, {"quality": "x"}, {"directions": "7"}]
)
def test_options_that_cannot_be_used(wrong: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        BakeOptions(**wrong)  # type: ignore[arg-type]


def test_cell_keys_read_back() -> None:
    assert CellKey.parse(str(CellKey(3, -1, 0, 7))) == (3, -1, 0, 7)
    with pytest.raises(OptionError):
        CellKey.parse("3/1/x/0")
