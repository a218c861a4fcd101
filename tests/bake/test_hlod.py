"""Geometry of cells above the leaves: that it looks like what is below, and depends on nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bake.scenes import box, contents, ground, quad_mesh, scene_of, village
from farfield.bake.bake import bake
from farfield.bake.hlod import FORMS, chunk_of
from farfield.bake.likeness import Sight, sights_of
from farfield.bake.options import BakeOptions
from farfield.bake.repair import forget
from farfield.geometry.color import srgb_from_linear
from farfield.octree.grid import CellKey
from farfield.quality.metrics import psnr
from farfield.represent.chunk import Chunk, merge
from farfield.represent.geometry.read import read_leaf_glb
from farfield.represent.geometry.texture import decode_texture
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Mesh, Scene, Texture
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.view.frame import Frame
from farfield.view.geometry import GeometryPass
from farfield.view.shading import Light
from farfield.world.garbage import drop_garbage
from farfield.world.index import MOST_INSTANCES, CellEntry, GeometryLevel
from farfield.world.keys import geometry_key, texture_key
from farfield.world.verification import verify_world
from farfield.world.world import World

OPTIONS = BakeOptions(leaf_size=16.0, resolution=32, directions="5", workers=1)
STONE = Material("stone", (0.6, 0.5, 0.4, 1.0))


def hills(side: float = 46.0, steps: int = 48) -> Mesh:
    """Rolling land, a textured mesh of 4,608 triangles."""
    y, x = np.meshgrid(*[np.linspace(0, side, steps + 1)] * 2, indexing="ij")
    z = 3 * np.sin(x / 9) * np.cos(y / 7) + 4
    at = np.arange((steps + 1) ** 2, dtype=np.uint32).reshape(steps + 1, -1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    normals = np.stack([-np.cos(x / 9) * np.cos(y / 7) / 3, 3 / 7 * np.sin(x / 9) * np.sin(y / 7), np.ones_like(x)], -1)
    normals = normals.reshape(-1, 3) / np.linalg.norm(normals.reshape(-1, 3), axis=1, keepdims=True)
    pixels = np.full((128, 128, 4), 255, np.uint8)
    row, column = np.indices((128, 128))
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = 40 + row, 90 + 60 * (column // 32 % 2), 30 + column // 2
    return Mesh(
        np.stack([x, y, z], -1).reshape(-1, 3),
        np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]),
        normals.astype(np.float32),
        (Material("land", texture=Texture(pixels)),),
        np.zeros(2 * steps * steps, np.uint16),
        uvs=np.stack([x, y], -1).reshape(-1, 2).astype(np.float32) / np.float32(side),
    )


def town(*more: tuple[Mesh, list[tuple[float, float, float]]]) -> Scene:
    """Land, a house with corners of its own colours, an unlit sign."""
    house = box((20.0, 20.0, 0.0), (27.0, 29.0, 12.0), STONE)
    colors = np.full((len(house.positions), 4), 255, np.uint8)
    colors[::4, 1:3] = 90
    sign = quad_mesh(
        np.array([[[33.0, 40, 2], [41.0, 40, 2], [41.0, 40, 9], [33.0, 40, 9]]]),
        Material("sign", (1.0, 0.2, 0.1, 1.0), unlit=True),
    )
    placed = [(mesh, [(0.0, 0.0, 0.0)]) for mesh in (hills(), replace(house, colors=colors), sign)]
    return scene_of(*placed, *more)


@pytest.fixture(scope="module")
def store() -> MemoryStore:
    """A baked town."""
    found = MemoryStore()
    bake(town(), found, OPTIONS)
    return found


@pytest.fixture
def world(store: MemoryStore) -> World:
    """The same, opened."""
    return World.open(store)


def read(store: Store, cell: CellKey, form: GeometryLevel) -> Mesh:
    """The triangles of a form."""
    key = geometry_key(cell, form.hash)
    mesh = read_leaf_glb(store.get(key), key, lambda name: decode_texture(store.get(texture_key(name)), name)).mesh
    assert mesh is not None
    return mesh


def upper(world: World) -> Iterator[CellEntry]:
    """Entries of all cells above the leaves."""
    return (entry for entry in world.cells() if entry.cell.level)


def below(world: World, entry: CellEntry, corner: np.ndarray) -> tuple[Chunk, list[Material]]:
    """The full geometry of all leaves below a cell, metres from a corner."""
    chunks: list[Chunk] = []
    materials: list[Material] = []
    pending = [entry.cell]
    while pending:
        found = world.entry(pending.pop())
        pending += [CellKey.parse(child) for child in found.children]
        if found.cell.level == 0 and found.geometry and found.geometry.triangles:
            mesh = read(world.store, found.cell, found.geometry)
            chunk = chunk_of(mesh)
            positions = (chunk.positions + (world.grid.bounds(found.cell)[0] - corner)).astype(np.float32)
            chunks.append(replace(chunk, positions=positions, materials=chunk.materials + np.uint32(len(materials))))
            materials += mesh.materials
    return merge(chunks), materials


def drawn(sight: Sight, chunk: Chunk, materials: list[Material], corner: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 sRGB, before grey."""
    frame, light = Frame.empty(sight.camera, (160, 160), 2), Light()
    moved = replace(chunk, positions=(chunk.positions + (corner - sight.eye)).astype(np.float32))
    GeometryPass(frame, light).draw(moved, MaterialTable.build(materials))
    picture = frame.develop(light)
    alpha = picture.alpha[..., None]
    return np.round(255 * srgb_from_linear(alpha * picture.color + (1 - alpha) * 0.5)).astype(np.uint8)


def test_every_cell_has_forms_that_look_like_what_is_below(world: World) -> None:
    entries = list(upper(world))
    assert len(entries) > 4
    for entry in entries:
        assert entry.geometry is not None
        corner = world.grid.bounds(entry.cell)[0]
        truth = below(world, entry, corner)
        before = (-1,)
        for number, form in enumerate(entry.geometry.forms):
            assert form.errors[0] >= before[0]
            assert form.errors == tuple(sorted(form.errors))
            before = form.errors
            mesh = read(world.store, entry.cell, form)
            assert len(mesh.triangles) == form.triangles == form.drawn
            assert (form.instances, form.meshes, mesh.object_count) == (0, (), 1)
            for sight in sights_of(world.grid, entry.cell, entry.bounds):
                shown = drawn(sight, chunk_of(mesh), list(mesh.materials), corner)
                assert psnr(drawn(sight, *truth, corner), shown) > (27, 22, 18)[number]


def test_forms_stay_in_their_cells_and_get_smaller(world: World) -> None:
    finest = [world.grid.resolution**2 // 8 // 4**number for number in range(3)]
    for entry in upper(world):
        assert entry.geometry is not None
        size = world.grid.cell_size(entry.cell.level)
        sizes = [form.bytes + sum(size for _, size in form.textures) for form in entry.geometry.forms]
        assert sizes == sorted(sizes, reverse=True)
        for most, form in zip(finest, entry.geometry.forms, strict=False):
            assert form.triangles <= 1.1 * most
            positions = read(world.store, entry.cell, form).positions
            assert positions.min() >= 0
            assert (positions <= size * (1 + 1e-6)).all()


def test_neighbours_meet(world: World) -> None:
    """Corners on a wall between two cells of a level are those of both."""
    checked = 0
    for entry in upper(world):
        grid, key = world.grid, entry.cell
        beside = key._replace(x=key.x + 1)
        try:
            other = world.entry(beside)
        except KeyError:
            continue
        assert entry.geometry is not None
        assert other.geometry is not None
        both = entry.geometry.forms, other.geometry.forms
        # Of cells that lack a form the others are not those of the same fineness.
        each = 1 if any(len(forms) < FORMS for forms in both) else FORMS
        for one, two in zip(*(forms[:each] for forms in both), strict=True):
            width = grid.cell_size(key.level)[0]
            left, right = (read(world.store, cell, form).positions for cell, form in ((key, one), (beside, two)))
            on_left = np.unique(left[left[:, 0] > width * (1 - 1e-6)][:, 1:].round(4), axis=0)
            on_right = np.unique(right[right[:, 0] == 0][:, 1:].round(4), axis=0)
            np.testing.assert_array_equal(on_left, on_right)
            checked += len(on_left)
    assert checked > 10


def test_what_is_unlit_stays_so(world: World) -> None:
    entry = world.entry(world.roots[0])
    assert entry.geometry is not None
    materials = read(world.store, entry.cell, entry.geometry).materials
    assert {material.unlit for material in materials} == {False, True}
    assert any(material.texture is not None for material in materials)


def test_without_what_is_cut_out_by_alpha_and_above_it() -> None:
    store = MemoryStore()
    bake(village(), store, replace(OPTIONS, leaf_size=4.0))
    world = World.open(store)
    cells = {entry.cell: entry for entry in world.cells()}
    cut = set()
    for key, entry in cells.items():
        materials = read(store, key, entry.geometry).materials if entry.geometry and entry.geometry.triangles else ()
        if any(material.alpha_cutoff is not None for material in materials):
            cut.update(world.grid.ancestor(key, level) for level in range(1, world.grid.top_level + 1))
    assert cut
    for key, entry in cells.items():
        if key.level:
            assert (entry.geometry is None) == (key in cut)
    assert any(entry.geometry for key, entry in cells.items() if key.level)


def test_listed_instances_are_left_out_and_crowds_forbid_it() -> None:
    lamp = box((0.0, 0.0, 0.0), (0.5, 0.5, 3.0), STONE)
    few, many = ([(float(x), float(y), 9.0) for x in range(2, count) for y in range(2, count)] for count in (4, 8))
    assert len(few) <= MOST_INSTANCES < len(many)
    for places, forbidden in ((few, False), (many, True)):
        store = MemoryStore()
        bake(town((lamp, places)), store, OPTIONS)
        world = World.open(store)
        for entry in upper(world):
            holds = world.grid.ancestor(CellKey(0, 0, 0, 0), entry.cell.level) == entry.cell
            assert (entry.geometry is None) == (forbidden and holds)
        root = world.entry(world.roots[0])
        if root.geometry:
            # The lamps stand out above the house.
            top = read(store, root.cell, root.geometry).positions[:, 2].max() + world.grid.bounds(root.cell)[0, 2]
            assert top < 12.1


def test_no_geometry_where_none_is_wanted() -> None:
    store = MemoryStore()
    bake(scene_of((ground(0.0, 60.0), [(0.0, 0.0, 0.0)])), store, replace(OPTIONS, geometry=False))
    assert not any(entry.geometry for entry in World.open(store).cells())


class KilledError(Exception):
    """The bake is ended here."""


class FailingStore(MemoryStore):
    """Ends the bake after some values."""

    writes = 0

    def put(self, key: str, data: bytes) -> None:
        """As a store does."""
        if self.writes == 0:
            raise KilledError
        self.writes -= 1
        super().put(key, data)


def everything(store: Store) -> dict[str, bytes]:
    """All values but those that tell when they were made."""
    return {key: store.get(key) for key in store.list() if key != "world.json"}


@pytest.mark.parametrize("share", [0.4, 0.95])
def test_an_interrupted_bake_goes_on_to_the_same_bytes(store: MemoryStore, share: float) -> None:
    other = FailingStore()
    other.writes = int(share * len(list(store.list())))
    with pytest.raises(KilledError):
        bake(town(), other, OPTIONS)
    other.writes = -1
    bake(town(), other, OPTIONS)
    assert everything(other) == everything(store)


def test_workers_make_the_same_bytes(store: MemoryStore, tmp_path: Path) -> None:
    bake(town(), DirectoryStore(tmp_path), replace(OPTIONS, workers=2))
    made = {key: value for key, value in contents(tmp_path).items() if key != "world.json"}
    assert made == {key: value for key, value in everything(store).items() if not key.startswith("record/")}


def test_baked_again_with_geometry_that_no_picture_shows() -> None:
    def scene(width: float) -> Scene:
        shell = [box((20.0, 40.0, 0.0), (28.0, 48.0, 12.0), STONE), ground(19.0, 49.0, 0.1)]
        hidden = box((22.0, 42.0, 5.0), (22.0 + width, 44.0, 8.0), Material("hidden", (0.9, 0.1, 0.1, 1.0)))
        return scene_of(*((mesh, [(0.0, 0.0, 0.0)]) for mesh in (*shell, hidden)))

    store, straight = MemoryStore(), MemoryStore()
    options = replace(OPTIONS, depth_layers=1, object_ids=False)
    bake(scene(1.0), store, options)
    before = {entry.key: entry for entry in World.open(store).cells()}
    bake(scene(3.0), store, options)
    bake(scene(3.0), straight, options)
    after = {entry.key: entry for entry in World.open(store).cells()}
    assert {key: entry.hash for key, entry in before.items()} == {key: entry.hash for key, entry in after.items()}
    changed = [key for key, entry in after.items() if entry.geometry != before[key].geometry]
    assert [key for key in changed if not key.startswith("0/")]
    assert all(after[key].output != before[key].output for key in changed)
    assert after == {entry.key: entry for entry in World.open(straight).cells()}
    assert drop_garbage(store).keys > 0
    assert everything(store) == everything(straight)
    assert not verify_world(World.open(store)).faults


def test_what_is_damaged_is_made_again(store: MemoryStore) -> None:
    other = MemoryStore()
    for key in store.list():
        other.put(key, store.get(key))
    entry = next(entry for entry in upper(World.open(other)) if entry.geometry and entry.geometry.textures)
    assert entry.geometry is not None
    damaged = [
        geometry_key(entry.cell, entry.geometry.forms[-1].hash),
        texture_key(entry.geometry.textures[0][0]),
    ]
    for key in damaged:
        other.put(key, b"damaged")
    faults = [fault.key for fault in verify_world(World.open(other)).faults]
    assert sorted(faults) == sorted(damaged)
    forget(World.open(other), faults)
    assert bake(town(), other, OPTIONS).cells_rebuilt >= 1
    assert everything(other) == everything(store)
    assert drop_garbage(other).keys == 0
