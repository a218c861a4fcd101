"""Levels of near geometry: what a bake makes of dense meshes, and that all of it is found again."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bake.scenes import ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import psnr
from farfield.scene.procedural.blobs import blob
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.copying import copy_world
from farfield.world.garbage import drop_garbage
from farfield.world.reach import form_values
from farfield.world.targets import StoreTarget
from farfield.world.verification import verify_world
from farfield.world.world import World

CAMERA, SIZE = Camera((6.0, -9.0, 6.0), (6.0, 6.0, 1.0)), (120, 90)


@pytest.fixture(scope="module")
def world() -> World:
    """Two copies of a body of 20,000 triangles, and one of another that stands alone: a mesh of its own, too."""
    store = MemoryStore()
    scene = scene_of(
        (ground(0.0, 16.0), [(0.0, 0.0, 0.0)]),
        (blob(20_000, 3.0, 1), [(4.0, 4.0, 1.5), (10.0, 5.0, 1.5)]),
        (blob(12_000, 2.0, 2), [(7.0, 9.0, 1.0)]),
    )
    bake(scene, store, BakeOptions(leaf_size=16.0, resolution=64, directions="5", workers=1))
    return World.open(store)


def leaf(world: World) -> int:
    """Number in the tree of the leaf with most instances."""
    tree = CellTree.of(world)
    near = [(entry.geometry.instances, n) for n, entry in enumerate(tree.entries) if entry.geometry]
    return max(near)[1]


def test_each_level_takes_less_and_errs_more(world: World) -> None:
    near = CellTree.of(world).entries[leaf(world)].geometry
    assert near is not None
    assert near.errors == ()
    assert len(near.levels) >= 2
    sizes = [form.bytes + sum(size for _, size in (*form.meshes, *form.textures)) for form in near.forms]
    assert all(coarse <= 0.7 * fine for fine, coarse in pairwise(sizes))
    for fine, coarse in pairwise(near.levels):
        assert all(a <= b for a, b in zip(fine.errors, coarse.errors, strict=True))
    for form in near.levels:
        # From nearer it is seen better.
        assert list(form.errors) == sorted(form.errors)
        assert len(form.meshes) == 2


def test_errors_between_those_that_are_told(world: World) -> None:
    tree, number = CellTree.of(world), leaf(world)
    near = tree.entries[number].geometry
    assert near is not None
    pitch = world.grid.pitch(0)
    widths = np.array([pitch * 10, pitch, pitch / 2, pitch / 4, pitch / 16, pitch / 1000])
    found = tree.errors_at(tree.forms(number).errors, widths)
    assert (found[0] == 0).all()
    a, b, c = (error / 255 for error in near.levels[0].errors)
    assert np.allclose(found[1], [a, a, (a + b) / 2, b, c, c])


def test_all_forms_belong_to_the_world(world: World) -> None:
    entry = CellTree.of(world).entries[leaf(world)]
    assert entry.geometry is not None
    keys = {key for form in entry.geometry.forms for key, _ in form_values(entry.cell, form)}
    assert verify_world(world).faults == ()
    copy = MemoryStore()
    copy_world(world.store, StoreTarget(copy))
    assert keys <= set(copy.list())
    assert drop_garbage(copy).keys == 0
    assert keys <= set(copy.list())
    coarsest = form_values(entry.cell, entry.geometry.levels[-1])[-1][0]
    copy.put(coarsest, b"damaged")
    assert [fault.key for fault in verify_world(World.open(copy)).faults] == [coarsest]


def test_a_level_that_is_not_kept_leaves_nothing_behind() -> None:
    """Of two meshes the larger has no levels, so the first level of the other saves too little."""
    houses = blob(12_000, 2.0, 2)
    owners = (np.arange(len(houses.triangles)) // 12).astype(np.uint32)
    houses = replace(houses, triangle_object=owners, object_count=int(owners.max()) + 1)
    scene = scene_of(
        (houses, [(4.0, 4.0, 3.0), (10.0, 5.0, 3.0)]), (blob(4_000, 2.0, 1), [(4.0, 9.0, 3.0), (10.0, 9.0, 3.0)])
    )
    store = MemoryStore()
    bake(scene, store, BakeOptions(leaf_size=16.0, resolution=64, directions="5", workers=1))
    tree = CellTree.of(World.open(store))
    assert [len(entry.geometry.levels) for entry in tree.entries if entry.geometry] == [0]
    assert drop_garbage(store, dry=True).keys == 0


def test_who_has_a_level_sees_it(world: World) -> None:
    entry = CellTree.of(world).entries[leaf(world)]
    assert entry.geometry is not None
    pictures = []
    for form in entry.geometry.forms:
        options = RenderOptions(
            supersampling=2, near_radius=100.0, held={key for key, _ in form_values(entry.cell, form)}
        )
        pictures.append(render_world(world, CAMERA, SIZE, options))
    triangles = [picture.statistics.triangles for picture in pictures]
    assert triangles == sorted(triangles, reverse=True)
    assert triangles[0] > 3 * triangles[-1]
    full, *coarse = (picture.pixels(np.array([0.2, 0.3, 0.5])) for picture in pictures)
    quality = [psnr(full, one) for one in coarse]
    assert quality[0] > 30
    assert quality == sorted(quality, reverse=True)
