"""Instances that leaves list in the index: each once, where it stands, with its mesh in all its levels."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bake.scenes import box, ground, scene_of
from farfield.bake.bake import bake
from farfield.bake.instances import FEWEST_TRIANGLES, shared_meshes
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.octree.grid import Grid
from farfield.scene.model import Material, Mesh
from farfield.scene.procedural.blobs import blob
from farfield.scene.stored.scene import MeshSummary
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.copying import copy_world
from farfield.world.garbage import drop_garbage
from farfield.world.index import MOST_INSTANCES
from farfield.world.keys import mesh_key
from farfield.world.reach import level_values
from farfield.world.targets import StoreTarget
from farfield.world.verification import verify_world
from farfield.world.world import World

STONE = Material("stone", (0.6, 0.6, 0.55, 1.0))
PLACES = [(3.0, 3.0, 1.0), (9.5, 4.0, 1.0), (4.0, 7.7, 1.0)]
"""Of bodies in leaves of 8 m; the last reaches from one into another."""


@pytest.fixture(scope="module")
def world() -> World:
    """Three bodies that stand alone, a box that stands four times, and a wall of few triangles."""
    store = MemoryStore()
    bodies = [
        (blob(triangles, 2.0, n), [place])
        for n, (triangles, place) in enumerate(zip((900, 2_000, 500), PLACES, strict=True))
    ]
    scene = scene_of(
        (ground(0.0, 16.0), [(0.0, 0.0, 0.0)]),
        *bodies,
        (
            box((0.0, 0.0, 0.0), (0.5, 0.5, 1.0), STONE),
            [(1.0, 1.0, 0.0), (14.0, 1.0, 0.0), (1.0, 14.0, 0.0), (14.0, 14.0, 0.0)],
        ),
        (box((6.0, 6.0, 0.0), (10.0, 6.3, 2.0), STONE), [(0.0, 0.0, 0.0)]),
    )
    bake(scene, store, BakeOptions(leaf_size=8.0, resolution=64, directions="5", workers=1))
    return World.open(store)


def test_each_instance_stands_once_where_it_is(world: World) -> None:
    found = CellTree.of(world).instances
    assert len(found.forms) == 4
    assert len(found.leaf) == 7
    middles = (found.bounds[:, :3] + found.bounds[:, 3:]) / 2
    for place in PLACES:
        assert (np.linalg.norm(middles - place, axis=1) < 0.2).sum() == 1
    sizes = found.bounds[:, 3:] - found.bounds[:, :3]
    assert np.allclose(sorted(sizes.max(axis=1)), [1.0] * 4 + [2.0] * 3, atol=1e-3)
    assert len(set(found.objects.tolist())) == 7


def test_levels_take_less_and_err_more(world: World) -> None:
    tree = CellTree.of(world)
    bodies = [forms for forms in tree.instances.forms if len(forms.values) > 1]
    assert len(bodies) == 3
    for forms in bodies:
        sizes = [sum(value.sizes) for value in forms.values]
        assert all(coarse < 0.7 * fine for fine, coarse in pairwise(sizes))
        assert (forms.errors[0] == 0).all()
        assert (np.diff(forms.errors, axis=0) >= 0).all()
        assert forms.errors[-1].max() > 0
    assert sum(max(counts) > FEWEST_TRIANGLES for counts in tree.instances.triangles) == 3


def test_they_belong_to_the_world(world: World) -> None:
    keys = {
        key
        for entry in world.cells()
        for mesh in entry.instances
        for level in mesh.levels
        for key, _ in level_values(level)
    }
    assert all(world.store.exists(key) for key in keys)
    copy = MemoryStore()
    copy_world(world.store, StoreTarget(copy))
    assert all(copy.exists(key) for key in keys)
    assert not verify_world(World.open(copy)).faults
    drop_garbage(copy)
    assert all(copy.exists(key) for key in keys)
    copy.delete(max(keys))
    assert verify_world(World.open(copy)).faults


def test_who_has_the_meshes_alone_sees_them_where_they_stand(world: World) -> None:
    camera, size = Camera((8.0, -6.0, 5.0), (7.0, 7.0, 1.0)), (120, 90)
    tree = CellTree.of(world)

    def shown(level: int) -> np.ndarray:
        held = {key for forms in tree.instances.forms for key in forms.values[min(level, len(forms.values) - 1)].keys}
        picture = render_world(world, camera, size, RenderOptions(supersampling=2, held=held, ids=True))
        assert picture.ids is not None
        return picture.ids

    whole = render_world(world, camera, size, RenderOptions(supersampling=2, near_radius=float("inf"), ids=True)).ids
    assert whole is not None
    for level in (0, 1):
        found = shown(level)
        seen = [one for one in tree.instances.objects.tolist() if (whole == one).sum() > 8]
        assert len(seen) >= 5
        for one in seen:
            assert (found == one)[whole == one].mean() > (0.99 if level == 0 else 0.8)
        assert (found == 0).mean() > 0.8, "and no ground"


def test_what_reaches_out_of_a_leaf_is_seen_whole_beside_it(world: World) -> None:
    camera, size = Camera((14.0, 7.7, 3.0), (4.0, 7.7, 1.0)), (120, 90)
    tree = CellTree.of(world)
    row = int(np.argmin(np.abs((tree.instances.bounds[:, 1] + tree.instances.bounds[:, 4]) / 2 - 7.7)))
    home = int(tree.instances.leaf[row])
    held = set(tree.forms(home).values[0].keys)
    one = int(tree.instances.objects[row])
    options = RenderOptions(supersampling=2, ids=True, near_radius=float("inf"))
    whole, found = (render_world(world, camera, size, replace(options, held=own)).ids for own in (None, held))
    assert whole is not None
    assert found is not None
    true = whole == one
    assert true.sum() > 100
    assert (found == one)[true].mean() > 0.98


def summary(mesh: Mesh) -> MeshSummary:
    lower, upper = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return MeshSummary(np.stack([lower, upper])[None], len(mesh.triangles), "content")


def test_objects_alone_are_kept_whole() -> None:
    grid = Grid(8.0, 64, (0.0, 0.0, 0.0), (2, 2, 0))
    placed = [
        (blob(500, 2.0, 1), [(2.0, 2.0, 2.0)]),
        (blob(500, 40.0, 2), [(16.0, 16.0, 2.0)]),
        (box((0, 0, 0), (1, 1, 1), STONE), [(9.0, 9.0, 0.0)]),
        (box((0, 0, 0), (1, 1, 1), STONE), [(9.0, 9.0, 0.0), (12.0, 9.0, 0.0)]),
        *((blob(200, 0.5, n), [(20.0 + 0.1 * n, 20.0, 1.0)]) for n in range(MOST_INSTANCES + 1)),
    ]
    scene = scene_of(*placed)
    found = shared_meshes(scene.instances, [summary(mesh) for mesh, _ in placed], grid)
    # Small and dense; too large; too few triangles; placed twice; and more in a leaf than it may list.
    assert found.tolist() == [True, False, False, True, *[False] * (MOST_INSTANCES + 1)]


def test_a_leaf_that_places_too_many_lists_none() -> None:
    store = MemoryStore()
    places = [(0.4 * n, 0.4 * m, 0.0) for n in range(5) for m in range(4)]
    bake(
        scene_of((blob(300, 0.3, 1), places)),
        store,
        BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1),
    )
    world = World.open(store)
    assert not any(entry.instances for entry in world.cells())
    assert any(entry.geometry and entry.geometry.instances == len(places) for entry in world.cells())
    assert len([key for key in store.list() if key.startswith(mesh_key(""))]) >= 1
