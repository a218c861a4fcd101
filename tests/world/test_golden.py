"""The world that version 1 wrote: every later version must read it, and read the same from it."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from farfield.geometry.cameras import Camera
from farfield.represent.geometry.read import read_leaf_glb, read_mesh_glb
from farfield.represent.orthoview.object_tile import decode_object_tile
from farfield.scene.model import Texture
from farfield.store.memory import MemoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world import keys
from farfield.world.verification import verify_world
from farfield.world.world import World

GOLDEN = Path(__file__).parents[1] / "fixtures/world-v1.zip"


@pytest.fixture(scope="module")
def golden() -> World:
    """The world in memory."""
    store = MemoryStore()
    with zipfile.ZipFile(GOLDEN) as archive:
        for name in archive.namelist():
            store.put(name, archive.read(name))
    return World.open(store)


def test_its_manifest(golden: World) -> None:
    manifest = golden.manifest
    assert (manifest.version, manifest.name, manifest.depth_layers) == (1, "golden", 2)
    assert manifest.grid.corner == (4.0, 6.0, -0.125)
    assert manifest.grid.axis_levels == (1, 1, 0)
    assert [d.number for d in manifest.directions] == [4, 10, 13, 15, 21, 26]
    assert manifest.credits == ("made for tests",)


def test_every_value_is_whole(golden: World) -> None:
    found = verify_world(golden)
    assert not found.faults
    assert found.cells == golden.manifest.statistics.cells


def test_its_cells_reach_below_zero(golden: World) -> None:
    assert {key[1:3] for key in golden.roots} == {(-1, -1), (-1, 0), (0, -1), (0, 0)}
    assert any(entry.cell.x < 0 for entry in golden.cells())


def test_its_tiles_hold_what_they_held(golden: World) -> None:
    """Sums over all tiles, as the version that wrote them read them."""
    sums = np.zeros(4, np.int64)
    for entry in golden.cells():
        for direction, layer, _ in entry.tiles:
            tile = golden.tile(entry, direction, layer).layer
            planes = (tile.valid, tile.depth, tile.coverage, tile.normal[tile.valid])
            sums += np.array([int(plane.sum()) for plane in planes])
    assert sums.tolist() == SUMS


def test_its_object_ids(golden: World) -> None:
    ids = set()
    for entry in golden.cells():
        for direction, layer, _ in entry.tiles:
            if layer == 0:
                tile = golden.tile(entry, direction, 0).layer
                data = golden.store.get(keys.objects_key(entry.cell, direction, 0, entry.hash))
                ids |= set(np.unique(decode_object_tile(data, tile)).tolist())
    # Faces that none of the six directions sees are in no picture.
    assert len(ids - {0}) > 30
    assert max(ids) <= golden.manifest.statistics.objects


def test_its_near_geometry(golden: World) -> None:
    white = Texture(np.full((1, 1, 4), 255, np.uint8))
    own = placed = 0
    for entry in golden.cells():
        if entry.geometry is not None:
            data = golden.store.get(keys.geometry_key(entry.cell, entry.geometry.hash))
            leaf = read_leaf_glb(data, entry.key, lambda _: white)
            own += 0 if leaf.mesh is None else len(leaf.mesh.triangles)
            placed += sum(len(p.objects) for p in leaf.placed)
            for p in leaf.placed:
                mesh = read_mesh_glb(golden.store.get(keys.mesh_key(p.mesh)), p.mesh, lambda _: white)
                assert len(mesh.triangles) == 10
    assert (own, placed) == GEOMETRY


def test_its_picture_is_covered(golden: World) -> None:
    camera = Camera((7.0, -6.0, 12.0), (7.0, 7.0, 0.0), 60.0)
    picture = render_world(golden, camera, (96, 72), RenderOptions(near_radius=0.0))
    assert 0.3 < float(picture.alpha.mean()) < 0.8


SUMS = [18312, 1289803, 273966, 1164308]
"""Valid pixels, and their depth, coverage and normal codes."""
GEOMETRY = (54, 15)
"""Triangles of the leaves' own, and entries of instances."""
