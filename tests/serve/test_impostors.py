"""Images of instances that a session has made on demand, for who looks down on them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from bake.scenes import ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.serve.push.session import MOST_MADE
from farfield.serve.run import ServeOptions, serving
from farfield.store import MemoryStore, Store
from farfield.stream.tree import CellTree
from farfield.view.impostors import ImpostorMaker
from farfield.world.keys import DynamicImpostor
from farfield.world.world import World
from serve.test_push import Viewer, session, welcomed

ABOVE = {
    "type": "view", "eye": [40.0, -10.0, 45.0], "forward": [0.0, 0.7071, -0.7071], "fov": 60.0, "size": [320, 240],
    "farGeometry": True, "dynamicImpostors": True,
}  # fmt: skip


@pytest.fixture(scope="module")
def trees() -> Store:
    """Some trees on a plain."""
    store = MemoryStore()
    places = [(20.0, 24.0, 0.0), (40.0, 30.0, 0.0), (52.0, 12.0, 0.0)]
    scene = scene_of((ground(0.0, 64.0), [(0.0, 0.0, 0.0)]), (tree(SHAPES[2], 6_000, 2), places))
    bake(scene, store, BakeOptions(leaf_size=32.0, resolution=64, directions="5", workers=1))
    return store


@pytest.fixture
def url(trees: Store) -> Iterator[str]:
    with serving(trees, ServeOptions(port=0)) as url:
        yield url


def heard(url: str, view: dict[str, Any], **hello: Any) -> Viewer:
    """What comes within a while."""
    with session(url, token="", **hello) as viewer:
        welcomed(viewer)
        viewer.say(**view)
        viewer.hear(1.5)
        return viewer


def made(viewer: Viewer) -> dict[str, bytes]:
    """The images that were made on demand."""
    return {key: value for key, value in viewer.values.items() if key.startswith("impostor/")}


def test_who_looks_down_is_sent_images_from_there(url: str, trees: Store) -> None:
    found = made(heard(url, ABOVE))
    assert found
    maker = ImpostorMaker(trees, CellTree.of(World.open(trees)).instances)
    for key, value in found.items():
        named = DynamicImpostor.of(key)
        assert named is not None
        assert named.tilt > 4
        assert value == maker.image(named)
    # Who has them, from a session before, is not sent them again.
    assert not made(heard(url, ABOVE, holds=list(found))).keys() & found.keys()


def test_who_draws_none_or_looks_from_the_side_is_sent_none(url: str) -> None:
    assert not made(heard(url, ABOVE | {"dynamicImpostors": False}))
    assert not made(heard(url, ABOVE | {"eye": [40.0, -10.0, 8.0], "forward": [0.0, 1.0, 0.0]}))


def test_a_server_that_is_busy_makes_no_more(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ImpostorMaker, "is_busy", property(lambda _: True))
    viewer = heard(url, ABOVE)
    assert viewer.values
    assert not made(viewer)


def test_a_mesh_that_is_damaged_costs_its_images_alone(trees: Store) -> None:
    store = MemoryStore()
    for key in trees.list():
        store.put(key, b"nothing" if key.startswith("mesh/") else trees.get(key))
    with serving(store, ServeOptions(port=0)) as url:
        viewer = heard(url, ABOVE)
        assert viewer.idle == 1
        assert any(key.startswith("impostor/") for key in viewer.missing)
        assert not made(viewer)
        # Once, and what was never there is not taken to be seen: images from the side come instead.
        assert sum(key.startswith("impostor/") for key in viewer.missing) == 1
        images = {key for key in trees.list() if key.startswith("texture/")}
        assert images & viewer.values.keys()


def test_who_says_it_has_more_than_could_be_made_is_let_go(url: str) -> None:
    keys = [DynamicImpostor(f"{n:016x}", 64, 0, 6).key for n in range(MOST_MADE + 1)]
    with session(url, token="", holds=keys[:4000]) as viewer:
        welcomed(viewer)
        viewer.say(type="add", keys=keys[4000:8000])
        viewer.say(type="add", keys=keys[8000:MOST_MADE])
        viewer.say(**ABOVE)
        viewer.hear(0.5)
        viewer.say(type="add", keys=keys[MOST_MADE:])
        with pytest.raises(ConnectionClosed, match="holds too much"):
            viewer.hear(5.0)
