"""Impostors of meshes that leaves list: images from round about, what they show and where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from bake.scenes import ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.represent.geometry.impostor import ROWS, SIDES
from farfield.represent.geometry.texture import decode_texture
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.copying import copy_world
from farfield.world.garbage import drop_garbage
from farfield.world.index import InstancedMesh
from farfield.world.keys import texture_key
from farfield.world.targets import StoreTarget
from farfield.world.verification import verify_world
from farfield.world.world import World

PLACE = (40.0, 24.0, 0.0)
"""Of a tree in leaves of 32 m."""


@pytest.fixture(scope="module")
def world() -> World:
    """A tree and a body of few bytes."""
    store = MemoryStore()
    scene = scene_of(
        (ground(0.0, 64.0), [(0.0, 0.0, 0.0)]),
        (tree(SHAPES[2], 6_000, 2), [PLACE]),
        (blob(600, 2.0, 1), [(10.0, 10.0, 1.0)]),
    )
    bake(scene, store, BakeOptions(leaf_size=32.0, resolution=64, directions="5", workers=1))
    return World.open(store)


def listed(world: World) -> list[InstancedMesh]:
    return [mesh for entry in world.cells() for mesh in entry.instances]


def test_what_takes_many_bytes_has_images_from_all_sides(world: World) -> None:
    plain, leafy = sorted(listed(world), key=lambda mesh: mesh.levels[0].bytes)
    for one in plain.impostors:
        # What a level shows as well for as many bytes is left out.
        most = np.mean([size for _, size in one.images])
        assert all(level.bytes > most or (level.errors or (0,)) > one.errors for level in plain.levels)
    assert all(one.rows < 192 for one in plain.impostors)
    assert [one.rows for one in leafy.impostors] == list(ROWS)
    size = np.subtract(leafy.bounds[1], leafy.bounds[0])
    for one in leafy.impostors:
        assert len(one.images) == SIDES
        for side, (name, count) in enumerate(one.images):
            data = world.store.get(texture_key(name))
            assert len(data) == count
            pixels = decode_texture(data, name).pixels
            turn = 2 * np.pi * side / SIDES
            width = abs(np.sin(turn)) * size[0] + abs(np.cos(turn)) * size[1]
            assert pixels.shape[0] == one.rows
            assert abs(pixels.shape[1] - width / size[2] * one.rows) <= 1
            assert set(np.unique(pixels[..., 3])) == {0, 255}
            solid = pixels[..., 3] > 0
            if one.rows == ROWS[0] and side % 2 == 0:
                # The box is round the tree, twigs that fill no pixel apart.
                rows, columns = (np.flatnonzero(solid.any(axis=axis)) for axis in (1, 0))
                assert np.ptp(rows) > 0.9 * solid.shape[0]
                assert np.ptp(columns) > 0.9 * solid.shape[1]
            # Leaves are green; the image before and behind are not the same but mirror each other's outline.
            assert (pixels[solid][:, 1] > pixels[solid][:, 2]).mean() > 0.9
        assert 0 < one.errors[0] <= one.errors[1] <= one.errors[2]
    for fine, coarse in zip(leafy.impostors[:-1], leafy.impostors[1:], strict=True):
        assert sum(size for _, size in coarse.images) < 0.6 * sum(size for _, size in fine.images)
        assert all(a <= b for a, b in zip(fine.errors, coarse.errors, strict=True))


def test_they_belong_to_the_world(world: World) -> None:
    keys = {texture_key(name) for mesh in listed(world) for one in mesh.impostors for name, _ in one.images}
    copy = MemoryStore()
    copy_world(world.store, StoreTarget(copy))
    assert all(copy.exists(key) for key in keys)
    drop_garbage(copy)
    assert all(copy.exists(key) for key in keys)
    assert not verify_world(World.open(copy)).faults
    copy.delete(max(keys))
    assert verify_world(World.open(copy)).faults


@pytest.mark.parametrize("turn", [0, 45, 100, 190, 280])
def test_who_has_the_images_alone_sees_the_tree_where_it_stands(world: World, turn: int) -> None:
    tree = CellTree.of(world)
    angle = np.radians(turn)
    eye = (PLACE[0] + 70 * float(np.cos(angle)), PLACE[1] + 70 * float(np.sin(angle)), 6.0)
    camera, size = Camera(eye, (PLACE[0], PLACE[1], 9.0), 30.0), (120, 160)
    boards = [tree.instances.boards.of_mesh(mesh) for mesh in tree.instances.mesh.tolist()]
    (own,) = (n for n, sizes in enumerate(boards) if len(sizes) == len(ROWS))
    held = {key for sides in boards[own] for one in sides for key in one.keys}
    assert len(held) == SIDES * len(ROWS)
    number = int(tree.instances.objects[own])

    def seen(options: RenderOptions) -> np.ndarray:
        picture = render_world(world, camera, size, options)
        assert picture.ids is not None
        return np.asarray(picture.ids == number)

    shown = seen(RenderOptions(supersampling=2, held=held, ids=True))
    true = seen(RenderOptions(supersampling=2, near_radius=float("inf"), ids=True))
    assert true.sum() > 1_000
    # A crown of leaves is not the same from beside its side: but as large, and in the same place.
    assert 0.75 < shown.sum() / true.sum() < 1.3
    assert (shown & true).sum() / (shown | true).sum() > 0.6
