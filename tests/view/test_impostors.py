"""Images made on demand: what they show where, what is kept of them, and what becomes of damage."""

from __future__ import annotations

import io
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from bake.scenes import ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.errors import CorruptTileError
from farfield.geometry.cameras import Camera
from farfield.represent.geometry.board import TILTS, TURNS, dynamic_angle
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree, Instances
from farfield.view import impostors
from farfield.view.impostors import ImpostorMaker
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.keys import DynamicImpostor
from farfield.world.world import World

PLACE = (40.0, 24.0, 0.0)


@pytest.fixture(scope="module")
def world() -> World:
    """A tree on a plain."""
    store = MemoryStore()
    scene = scene_of((ground(0.0, 64.0), [(0.0, 0.0, 0.0)]), (tree(SHAPES[2], 6_000, 2), [PLACE]))
    bake(scene, store, BakeOptions(leaf_size=32.0, resolution=64, directions="5", workers=1))
    return World.open(store)


@pytest.fixture(scope="module")
def instances(world: World) -> Instances:
    return CellTree.of(world).instances


def name_of(instances: Instances) -> str:
    """Of the tree."""
    (name,) = (forms.values[0].cell for forms in instances.forms)
    return name


@pytest.mark.parametrize(("turn", "tilt", "aside"), [(0, 6, 0), (3, 6, 7), (10, 7, -7), (5, 3, 0), (0, TILTS, 0)])
def test_the_tree_is_seen_where_it_stands(
    world: World, instances: Instances, turn: int, tilt: int, aside: float
) -> None:
    """From 70 m, `aside` degrees beside what the image was made for."""
    azimuth, elevation = dynamic_angle(turn, tilt) + np.radians([aside, -abs(aside)])
    middle = np.array([PLACE[0], PLACE[1], instances.bounds[0, [2, 5]].mean()])
    level = np.cos(elevation)
    eye = middle + 70 * np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]) + 1e-3
    camera = Camera((eye[0], eye[1], eye[2]), (middle[0], middle[1], middle[2]), 30.0)
    number, held = int(instances.objects[0]), {DynamicImpostor(name_of(instances), 192, turn, tilt).key}

    def seen(options: RenderOptions) -> np.ndarray:
        picture = render_world(world, camera, (160, 160), options)
        assert picture.ids is not None
        return np.asarray(picture.ids == number)

    shown = seen(RenderOptions(supersampling=2, held=held, ids=True))
    # From below the ground is before it.
    true = seen(RenderOptions(supersampling=2, near_radius=float("inf"), ids=True))
    if tilt > TILTS // 2:
        assert true.sum() > 500
        assert 0.75 < shown.sum() / true.sum() < 1.3
        assert (shown & true).sum() / (shown | true).sum() > 0.6
    else:
        assert shown.sum() > 800


def test_images_have_the_rows_that_are_asked_for(world: World, instances: Instances) -> None:
    maker = ImpostorMaker(world.store, instances)
    size = instances.boxes[0, 1] - instances.boxes[0, 0]
    for rows in (192, 64, 20):
        with Image.open(io.BytesIO(maker.image(DynamicImpostor(name_of(instances), rows, 0, 6)))) as image:
            # From 45 degrees above along x.
            assert abs(image.height - rows * (size[0] + size[2]) / 2**0.5 / size[2]) <= 1
            assert abs(image.width - rows * size[1] / size[2]) <= 1


def test_what_was_made_is_remembered_as_long_as_there_is_room(
    world: World, instances: Instances, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, made = ImpostorMaker(world.store, instances), []
    draw = impostors.impostor_image
    monkeypatch.setattr(impostors, "impostor_image", lambda *given: made.append(1) or draw(*given))
    every = [DynamicImpostor(name_of(instances), 20, turn, 6) for turn in range(TURNS)]
    first = [maker.image(one) for one in every]
    assert [maker.image(one) for one in every] == first
    assert len(made) == TURNS
    assert len({*first}) == TURNS
    monkeypatch.setattr(impostors, "MOST_BYTES", 3 * max(map(len, first)))
    maker.image(every[0])
    assert maker.image(every[-1]) == first[-1]
    assert len(made) == TURNS
    assert maker.image(every[1]) == first[1]
    assert len(made) == TURNS + 1


def test_many_may_ask_at_once(world: World, instances: Instances) -> None:
    maker = ImpostorMaker(world.store, instances)
    wanted = [DynamicImpostor(name_of(instances), 20, turn % TURNS, 5) for turn in range(4 * TURNS)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(maker.image, wanted))
    assert found[:TURNS] * 4 == found
    assert not maker.is_busy


def test_damage_is_told(world: World, instances: Instances) -> None:
    with pytest.raises(CorruptTileError, match="no such mesh"):
        ImpostorMaker(world.store, instances).image(DynamicImpostor("0" * 16, 20, 0, 6))
    (forms,) = instances.forms
    for key in forms.values[0].keys:
        store = MemoryStore()
        for other in world.store.list():
            store.put(other, b"nothing" if other == key else world.store.get(other))
        maker = ImpostorMaker(store, instances)
        for _ in range(2):
            with pytest.raises(CorruptTileError):
                maker.image(DynamicImpostor(name_of(instances), 20, 0, 6))
            store.delete(key)
        assert not maker.is_busy


@pytest.mark.parametrize(
    "key", ["impostor/", "impostor/x-20-0-6", "mesh/" + "a" * 16, "impostor/" + "a" * 16 + "-20-16-6"]
)
def test_other_keys_are_none(key: str) -> None:
    assert DynamicImpostor.of(key) is None
    named = DynamicImpostor("ab" * 8, 64, 15, 8)
    assert DynamicImpostor.of(named.key) == named
