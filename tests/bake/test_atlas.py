"""Atlases of leaves in a world: one image and one material for many, at every level, and above the leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bake.scenes import box, contents, ground, scene_of
from bake.test_region import BUILDINGS, REGION, changed, whole_world, write
from farfield.bake.bake import bake
from farfield.bake.context import BakeContext
from farfield.bake.options import BakeOptions
from farfield.errors import OptionError
from farfield.geometry.cameras import Camera
from farfield.pipeline import bake_sources, update_place
from farfield.quality.metrics import psnr
from farfield.represent.geometry.read import read_leaf_glb
from farfield.represent.geometry.texture import decode_texture
from farfield.scene.model import Material, Scene, Texture
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.garbage import drop_garbage
from farfield.world.keys import geometry_key, texture_key
from farfield.world.world import World

OPTIONS = BakeOptions(leaf_size=16.0, resolution=64, directions="5", workers=1)
COLORS = [(220, 40, 40), (40, 200, 60), (60, 80, 230), (230, 210, 50), (200, 60, 210), (60, 210, 210)]


def street(images: int = 6) -> Scene:
    """Boxes, each with a striped image of its own."""
    placed = [(ground(0.0, 16.0), [(0.0, 0.0, 0.0)])]
    for k in range(images):
        pixels = np.full((64, 64, 4), 255, np.uint8)
        pixels[..., :3] = COLORS[k]
        pixels[:: k + 2, :, :3] //= 2
        x, y = 1.0 + 5 * (k % 3), 2.0 + 7 * (k // 3)
        material = Material(f"wall {k}", texture=Texture(pixels))
        placed.append((box((x, y, 0.0), (x + 3, y + 3, 4.0), material), [(0.0, 0.0, 0.0)]))
    return scene_of(*placed)


def baked(side: int, images: int = 6) -> World:
    store = MemoryStore()
    bake(street(images), store, replace(OPTIONS, atlas_side=side))
    return World.open(store)


def test_one_image_one_material() -> None:
    world = baked(1024)
    tree = CellTree.of(world)
    leaf = max(
        (entry for entry in tree.entries if entry.cell.level == 0 and entry.geometry),
        key=lambda entry: entry.geometry.triangles,  # type: ignore[union-attr]
    )
    assert leaf.geometry is not None
    assert len(leaf.geometry.textures) == 1
    key = geometry_key(leaf.cell, leaf.geometry.hash)

    def image(name: str) -> Texture:
        return decode_texture(world.store.get(texture_key(name)), name)

    mesh = read_leaf_glb(world.store.get(key), key, image).mesh
    assert mesh is not None
    assert [one.texture is not None for one in mesh.materials] == [False, True]
    for level in leaf.geometry.levels:
        assert len(level.textures) == 1
    assert drop_garbage(world.store, dry=True).keys == 0


def test_it_looks_the_same() -> None:
    camera, size = Camera((8.0, -9.0, 7.0), (8.0, 8.0, 1.0)), (160, 120)
    options = RenderOptions(supersampling=2, near_radius=100.0)
    light = np.array([0.2, 0.3, 0.5])
    with_, without = (render_world(baked(side), camera, size, options).pixels(light) for side in (1024, 0))
    assert psnr(without, with_) > 33


def test_a_single_image_is_the_same_file_as_ever() -> None:
    with_, without = (baked(side, images=1).store for side in (1024, 0))
    assert isinstance(with_, MemoryStore)
    keys = [key for key in with_.list() if not key.startswith("record/")]
    assert {key: with_.get(key) for key in keys} == {key: without.get(key) for key in keys}


@pytest.mark.parametrize("fewest", [0, 1 << 30])
def test_atlases_are_forgotten_with_their_leaf(fewest: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of leaves with levels, and of those that are too small for any."""
    monkeypatch.setattr("farfield.bake.near.FEWEST_BYTES", fewest)
    made: list[BakeContext] = []
    begin = BakeContext.__init__

    def noted(self: BakeContext, *arguments: Any) -> None:
        begin(self, *arguments)
        made.append(self)

    monkeypatch.setattr(BakeContext, "__init__", noted)
    world = baked(1024)
    assert any(entry.geometry and entry.geometry.textures for entry in CellTree.of(world).entries)
    assert made
    assert not any(context._images for context in made)


def test_sides_that_make_no_sense() -> None:
    for side in (-8, 12, 1001, 16384):
        with pytest.raises(OptionError, match="not a side of an atlas"):
            BakeOptions(atlas_side=side)


def test_unique_facades_are_updated_by_region(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bytes are those of a whole bake, with chunks as small as those of unique façades."""
    monkeypatch.setattr("farfield.scene.footprints.order.UNIQUE_PER_MESH", 16)
    monkeypatch.setattr("farfield.scene.footprints.unique.FACADE_SIDE", 32)
    monkeypatch.setattr("farfield.scene.footprints.prisms.FACADE_SIDE", 32)
    (tmp_path / "scene.toml").write_text('[[source]]\npath = "town.geojson"\nfacades = "unique"\n')
    write(tmp_path / "town.geojson", BUILDINGS)
    place, options = tmp_path / "world", BakeOptions(leaf_size=64.0, resolution=32, directions="5", workers=1)
    bake_sources([tmp_path / "scene.toml"], place, options)
    write(tmp_path / "town.geojson", changed())
    update_place(place, [tmp_path / "scene.toml"], workers=1, region=REGION)
    whole = whole_world(tmp_path / "scene.toml", tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)
