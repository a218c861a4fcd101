"""Cells above the leaves drawn by geometry of their own, in the place of their pictures and as what stands in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bake.scenes import box, checkered, quad_mesh, scene_of
from e2e.world import ROOF
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.octree.grid import CellKey
from farfield.scene.model import Material, Mesh, Scene
from farfield.store import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view import kinds
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

SIZE = (120, 90)
NEAR, FAR = Camera((-40.0, -42.0, 14.0), (0.0, 0.0, 2.0)), Camera((-360.0, -370.0, 120.0), (0.0, 0.0, 2.0), 12.0)
ROOT = CellKey(2, 0, 0, 0)


def hills() -> Mesh:
    """64 m x 64 m, checkered."""
    x, y = np.meshgrid(np.arange(-32.0, 32.0, 2.0), np.arange(-32.0, 32.0, 2.0))
    at = np.stack([x.ravel(), y.ravel()], axis=1)[:, None] + 2.0 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    height = 2 + np.sin(at[..., 0] / 7) + np.cos(at[..., 1] / 5)
    mesh = quad_mesh(np.concatenate([at, height[..., None]], axis=2), Material("ground", texture=checkered()))
    return replace(mesh, uvs=(at / 16).reshape(-1, 2).astype(np.float32), triangle_object=None, object_count=1)


def scene() -> Scene:
    """Hills, and two houses, which the index lists."""
    house = box((0.0, 0.0, 0.0), (5.0, 6.0, 9.0), ROOF)
    return scene_of((hills(), [(0.0, 0.0, 0.0)]), (house, [(-20.0, -20.0, 1.0), (10.0, 4.0, 1.0)]))


@pytest.fixture(scope="module")
def world() -> World:
    store = MemoryStore()
    bake(scene(), store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    return World.open(store)


def drawn(world: World, held: set[str] | None, camera: Camera = NEAR, far: bool = True) -> Picture:
    options = RenderOptions(supersampling=2, held=held, near_radius=1.0, far_geometry=far)
    return render_world(world, camera, SIZE, options)


def true(world: World, camera: Camera) -> Picture:
    return render_world(world, camera, SIZE, RenderOptions(supersampling=2, near_radius=np.inf))


def keys(world: World, *beginnings: str) -> set[str]:
    return {key for key in world.store.list() if key.startswith(beginnings)}


def merged(world: World, *cells: CellKey) -> set[str]:
    """The geometry of cells above leaves, and the images of it."""
    found = set()
    for cell in cells:
        geometry = world.entry(cell).geometry
        assert geometry is not None
        for form in geometry.forms:
            found |= {f"geometry/{cell}-{form.hash}", *(f"texture/{name}" for name, _ in form.textures)}
    return found


def error(one: Picture, other: Picture) -> float:
    return float(np.abs(one.color - other.color).mean())


@pytest.mark.parametrize("camera", [NEAR, FAR])
def test_a_cell_above_shows_all_below(world: World, camera: Camera) -> None:
    found, whole = drawn(world, merged(world, ROOT), camera), true(world, camera)
    assert found.statistics.triangles > 0
    assert found.statistics.cells == 0
    ground = drawn(world, merged(world, ROOT) | keys(world, "mesh"), camera)
    assert error(ground, whole) < 0.15 * error(drawn(world, set(), camera), whole)
    assert np.mean((ground.alpha > 0.5) == (whole.alpha > 0.5)) > 0.98
    # Houses are no part of it.
    assert error(ground, whole) < 0.8 * error(found, whole)


def test_it_stands_in_where_something_is_missing_and_nowhere_else(world: World) -> None:
    pictures = keys(world, "orthoview/0/")
    left = {key for key in pictures if key.split("/")[2] in ("0", "1")}
    assert set() < left < pictures
    whole = drawn(world, pictures, far=False)
    with_it, without = drawn(world, left | merged(world, ROOT)), drawn(world, left)
    assert np.mean((with_it.alpha > 0.5) == (whole.alpha > 0.5)) > 0.97
    is_there = (without.alpha > 0.99) & (np.abs(without.color - whole.color).max(axis=2) < 1e-4)
    assert is_there.mean() > 0.1
    same = np.abs(with_it.color - without.color).max(axis=2) < 0.02
    assert same[is_there].mean() > 0.98
    assert drawn(world, left | merged(world, ROOT), far=False).statistics.triangles == 0


def test_the_nearest_cell_above_stands_in(world: World) -> None:
    below = [key for key in world.children(ROOT) if world.entry(key).geometry]
    assert len(below) == 4
    root, finer = drawn(world, merged(world, ROOT)), drawn(world, merged(world, ROOT, *below))
    assert error(finer, true(world, NEAR)) < error(root, true(world, NEAR))


def test_whole_pictures_show_houses_as_well(world: World) -> None:
    """So they are drawn as long as houses cannot be."""
    pictures = keys(world, f"orthoview/{ROOT}/")
    both = drawn(world, pictures | merged(world, ROOT), FAR)
    assert both.statistics.triangles == 0
    assert np.array_equal(both.color, drawn(world, pictures, FAR).color)
    with_houses = drawn(world, pictures | merged(world, ROOT) | keys(world, "mesh"), FAR)
    assert with_houses.statistics.triangles > 0
    assert with_houses.statistics.cells == 0


def test_pictures_of_cells_above_stay_where_ground_alone_shows_less(world: World) -> None:
    """Here houses take less of what is to be seen than in a city, so they are told to take more."""
    below = [number for number, entry in enumerate(CellTree.of(world).entries) if entry.cell.level == ROOT.level - 1]
    seen = kinds.Kinds(world, np.array(NEAR.eye), 500.0, 10.0)
    is_town = seen._tree.listed > 0.08
    seen._tree.listed[is_town] = 0.9
    cells = [seen._tree.entries[number].cell for number in below]
    ground = merged(world, *cells)
    assert {bool(is_town[number]) for number in below} == {True, False}
    stands = [seen.stands_in(cell, ground | keys(world, f"orthoview/{ROOT}/")) is not None for cell in cells]
    assert stands == [not is_town[number] for number in below]
    assert all(seen.stands_in(cell, ground) is not None for cell in cells)


def test_pictures_that_show_houses_much_better_stay(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = keys(world, f"orthoview/{ROOT}/")
    held = pictures | merged(world, ROOT) | keys(world, "mesh")
    for more, cells in ((0.25, 0), (-1.0, 1)):
        monkeypatch.setattr(kinds, "MORE", more)
        assert drawn(world, held, FAR).statistics.cells == cells


def test_instances_give_way_to_pictures_that_show_more_of_them(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    cell = next(entry.cell for entry in world.cells() if entry.instances)
    seen = kinds.Kinds(world, np.array([-20.0, -45.0, 4.0]), 100.0, 10.0)
    meshes, pictures = keys(world, "mesh/"), sorted(keys(world, f"orthoview/{cell}/"))

    def placed(held: set[str], pictured: bool = True) -> bool:
        return bool(seen.instances_of(cell, held, is_near=False, pictured=pictured))

    assert placed(meshes | set(pictures))
    # Pictures show .47 of them, some of these .18; meshes all of it.
    monkeypatch.setattr(kinds, "MORE", -0.7)
    assert placed(meshes)
    assert not placed(meshes | set(pictures))
    assert placed(meshes | set(pictures[:1]))
    assert placed(meshes | set(pictures), pictured=False)


def test_pictures_show_no_more_from_farther(world: World) -> None:
    """Than where their pixels are as wide as the screen's; those of leaves as they are told."""
    tree, seen = CellTree.of(world), kinds.Kinds(world, np.zeros(3), 100.0, 10.0)
    for number in (int(tree.roots[0]), int(np.flatnonzero(tree.levels == 0)[0])):
        seen._tree.told[number] = 0.1, 0.4, 0.5
        pitch = tree.errors[number]
        shown = [seen._by_pictures(number, np.asarray(width * pitch)) for width in (0.5, 1.0, 2.0)]
        far = 0.75 if tree.levels[number] else 0.9
        assert shown == pytest.approx([0.6, 0.75, far])


def test_some_pictures_give_way(world: World) -> None:
    some = set(sorted(keys(world, f"orthoview/{ROOT}/"))[:1])
    assert drawn(world, some | merged(world, ROOT), FAR).statistics.cells == 0
