"""What belongs to a world stays, and nothing else."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from bake.scenes import village
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.errors import CorruptTileError, StoreError
from farfield.scene.model import Instances, Scene
from farfield.store.memory import MemoryStore
from farfield.world.garbage import drop_garbage
from farfield.world.verification import verify_world
from farfield.world.world import World

OPTIONS = BakeOptions(leaf_size=4.0, resolution=32, directions="5", corner=(-64.0, -64.0, -8.0), workers=1)


def without_last(scene: Scene) -> Scene:
    """The scene with one instance less."""
    kept = np.arange(len(scene.instances.mesh) - 1)
    own = scene.instances
    rows = {field.name: getattr(own, field.name)[kept] for field in fields(own)}
    return replace(scene, instances=Instances(**rows))


def contents(store: MemoryStore) -> dict[str, bytes]:
    """Everything in a store."""
    return {key: store.get(key) for key in store.list()}


@pytest.fixture
def store() -> MemoryStore:
    """A world of two generations, with a stranger beside it."""
    store = MemoryStore()
    bake(village(), store, OPTIONS)
    bake(without_last(village()), store, OPTIONS)
    store.put("viewer/app.js", b"page")
    return store


def test_after_it_the_store_is_as_if_only_the_last_generation_had_been_baked(store: MemoryStore) -> None:
    alone = MemoryStore()
    bake(without_last(village()), alone, OPTIONS)
    before = contents(store)
    dry = drop_garbage(store, dry=True)
    assert contents(store) == before
    dropped = drop_garbage(store)
    assert dropped == dry
    assert dropped.keys > 10
    after = contents(store)
    assert sum(len(value) for value in before.values()) - sum(map(len, after.values())) == dropped.bytes
    assert set(after) - set(alone.list()) == {"viewer/app.js"}
    # Notes about leaves that hold nothing are made again in no time.
    assert all(key.startswith("record/") for key in set(alone.list()) - set(after))
    assert not verify_world(World.open(store)).faults
    assert drop_garbage(store).keys == 0


def test_nothing_is_dropped_when_the_index_is_damaged(store: MemoryStore) -> None:
    world = World.open(store)
    key = f"index/{world.manifest.roots[0].key}-{world.manifest.roots[0].hash}"
    store.put(key, store.get(key)[:-3])
    before = contents(store)
    with pytest.raises(CorruptTileError):
        drop_garbage(store)
    assert contents(store) == before


def test_not_while_a_bake_is_under_way(store: MemoryStore) -> None:
    with store.writing(), pytest.raises(StoreError, match="another process is writing"):
        drop_garbage(store)
