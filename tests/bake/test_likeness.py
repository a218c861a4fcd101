"""Errors that a bake tells of pictures: how much they look like what they show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bake.scenes import ground, scene_of
from e2e.world import town
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.scene.model import Mesh, Texture
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree
from farfield.world.index import CellEntry
from farfield.world.world import World


def baked(mesh: Mesh) -> World:
    store = MemoryStore()
    options = BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1)
    bake(scene_of((mesh, [(0.0, 0.0, 0.0)])), store, options)
    return World.open(store)


def leaf(world: World) -> CellEntry:
    """The leaf that shows most."""
    leaves = [entry for entry in CellTree.of(world).entries if entry.cell.level == 0]
    return max(leaves, key=lambda entry: sum(size for _, _, size in entry.tiles))


def textured(pixels: np.ndarray) -> Mesh:
    plane = ground(0.0, 16.0, color=(1.0, 1.0, 1.0))
    (material,) = plane.materials
    uvs = (plane.positions[:, :2] / 16.0).astype(np.float32)
    return replace(plane, uvs=uvs, materials=(replace(material, texture=Texture(pixels)),))


def noise(side: int, contrast: int) -> np.ndarray:
    pixels = np.full((side, side, 4), 255, np.uint8)
    pixels[..., :3] = np.random.default_rng(1).integers(128 - contrast, 128 + contrast, (side, side, 1))
    return pixels


def test_of_what_is_plain_there_are_hardly_any() -> None:
    # A hundredth of the light, by which it is rounded, is .04 by FLIP's power.
    assert max(leaf(baked(ground(0.0, 16.0))).errors) < 20


def test_what_pictures_are_too_coarse_for_is_missed_from_near() -> None:
    # More than a texel for each pixel of a picture; then one for eight.
    fine, coarse = (leaf(baked(textured(noise(side, 120)))).errors for side in (96, 8))
    assert fine[1] > fine[0] + 6
    assert fine[1] > coarse[1] + 6
    assert list(fine) == sorted(fine)


@pytest.fixture(scope="module")
def whole() -> World:
    store = MemoryStore()
    bake(town(), store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    return World.open(store)


def test_cells_above_lose_what_stands_on_the_ground(whole: World) -> None:
    tree = CellTree.of(whole)
    for entry in tree.entries:
        assert len(entry.losses) == len(entry.children)
        assert not entry.errors or len(entry.errors) == 3
    leaves = np.flatnonzero((tree.levels == 0) & tree.has_pictures)
    shows = np.array([sum(size for _, _, size in tree.entries[leaf].tiles) for leaf in leaves])
    order = np.argsort(shows)
    # Slivers of the ground are the same in coarser pictures, houses are not.
    plain, built = np.split(tree.losses[leaves[order]], [len(order) // 3])
    assert plain.mean() < 0.5 * built.mean()
    assert 0.04 < np.median(built) < 0.4


def test_who_bakes_it_makes_no_difference(whole: World) -> None:
    store = MemoryStore()
    options = BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1, scheduler=None)
    bake(town(), store, options)
    again = CellTree.of(World.open(store))
    assert [entry.errors for entry in again.entries] == [entry.errors for entry in CellTree.of(whole).entries]


def test_worlds_that_do_not_tell_are_taken_for_others() -> None:
    tree = CellTree.of(baked(ground(0.0, 16.0)))
    entries = [CellEntry(entry.key, entry.bounds, entry.error) for entry in tree.entries]
    untold = CellTree(tree.grid, entries, tree.parents.tolist())
    assert (np.diff(untold.told, axis=1) > 0).all()
    assert (untold.told > 0.05).all()
