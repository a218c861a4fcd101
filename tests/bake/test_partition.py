"""Meshes above a limit are split before they are baked; the pictures are those of the whole."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bake.scenes import ground, scene_of, village
from farfield.bake import partition
from farfield.bake import partition as partitioning
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.bake.partition import LIMIT, split_large
from farfield.errors import InputError
from farfield.progress import NoProgress
from farfield.represent.geometry.read import read_leaf_glb
from farfield.scene.assembly import join, place
from farfield.scene.model import Scene, Texture
from farfield.scene.read import read_scene
from farfield.scene.stored import order, rings
from farfield.scene.stored.piece import StoredPiece
from farfield.scene.stored.sorting import SortedRecords
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.world.garbage import drop_garbage
from farfield.world.keys import geometry_key
from farfield.world.world import World
from scene.stored.large import stone, write_ply, write_stl, write_stone

OPTIONS = BakeOptions(leaf_size=0.5, resolution=32, directions="9", workers=1)
MOST = 300
SMALL = {"limit": 10_000, "most": MOST}


class Notes(NoProgress):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def start(self, total: int | None, what: str) -> None:
        self.said.append(what)

    def note(self, text: str) -> None:
        self.said.append(text)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A mesh of 1,728 triangles."""
    return write_stone(tmp_path / "stone.ply", 12)


@pytest.fixture
def splits_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bake splits what is larger than a few kilobytes."""
    monkeypatch.setattr(partitioning, "split_large", partial(split_large, **SMALL))


def tiles(store: Store) -> dict[str, bytes]:
    """The pictures of a world."""
    return {key: store.get(key) for kind in ("orthoview", "objects") for key in store.list(kind)}


def test_only_large_meshes_are_split(source: Path) -> None:
    scene, store, notes = join([village(), read_scene([source])]), MemoryStore(), Notes()
    assert split_large(scene, store, notes, LIMIT) is scene
    assert list(store.list()) == []
    found = split_large(scene, store, notes, **SMALL)
    pieces = [mesh for mesh in found.meshes if isinstance(mesh, StoredPiece)]
    assert len(found.meshes) == len(scene.meshes) - 1 + len(pieces)
    assert len(pieces) > 5
    assert notes.said[:2] == [f"triangles of {source} sorted", f"pieces of {source} written"]
    assert pieces[3].name == f"{source}, piece 3"


def test_every_piece_stands_where_the_mesh_stood(source: Path) -> None:
    scene = join([village(), place(read_scene([source]), np.arange(36.0).reshape(3, 3, 4))])
    found = split_large(scene, MemoryStore(), NoProgress(), **SMALL)
    names = [mesh.name for mesh in found.meshes]
    own = scene.instances
    for row in range(len(own.mesh)):
        name = scene.meshes[own.mesh[row]].name
        rows = np.flatnonzero(found.instances.first_object == own.first_object[row])
        parts = {names[found.instances.mesh[r]] for r in rows}
        assert parts == {other for other in names if other == name or other.startswith(f"{name}, piece")}
        for r in rows:
            np.testing.assert_array_equal(found.instances.transform[r], own.transform[row])
    assert found.object_count == scene.object_count


@pytest.mark.parametrize("instances", [1, 3])
def test_the_pictures_are_those_of_the_whole(source: Path, instances: int, splits_small: None) -> None:
    transforms = np.stack([np.eye(3, 4) * (1 - 0.2 * k) for k in range(instances)])
    transforms[:, 0, 3] = 2.5 * np.arange(instances)
    scene, split = place(read_scene([source]), transforms), MemoryStore()
    result = bake(scene, split, OPTIONS)
    whole = MemoryStore()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(partitioning, "split_large", split_large)
        expected = bake(scene, whole, OPTIONS)
    assert len(tiles(whole)) > 500
    assert tiles(split) == tiles(whole)
    assert result.manifest.statistics.triangles == expected.manifest.statistics.triangles
    assert result.manifest.bounds == expected.manifest.bounds
    mine, theirs = (list(World.open(store).cells()) for store in (split, whole))
    assert [(e.key, e.hash, e.bounds, e.views) for e in mine] == [(e.key, e.hash, e.bounds, e.views) for e in theirs]
    if instances == 1:
        for entry, other in zip(mine, theirs, strict=True):
            if entry.geometry is not None and entry.cell.level == 0:
                assert other.geometry is not None
                assert entry.geometry.triangles == other.geometry.triangles
                data = split.get(geometry_key(entry.cell, entry.geometry.hash))
                leaf = read_leaf_glb(data, entry.key, lambda _: Texture(np.zeros((1, 1, 4), np.uint8)))
                assert leaf.mesh is not None
                assert len(leaf.mesh.materials) == 1, "all pieces are one draw call"


def test_workers_read_the_pieces(source: Path, tmp_path: Path, splits_small: None) -> None:
    alone, several = MemoryStore(), DirectoryStore(tmp_path / "world")
    scene = read_scene([source])
    bake(scene, alone, OPTIONS)
    bake(scene, several, replace(OPTIONS, workers=2))
    assert {key: several.get(key) for key in several.list()} == {key: alone.get(key) for key in alone.list()}


def unread(*_: object) -> None:
    pytest.fail("the file was read again")


def test_an_unchanged_file_is_not_read_again(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = MemoryStore()
    scene = read_scene([source])
    first = split_large(scene, store, NoProgress(), **SMALL)
    before = {key: store.get(key) for key in store.list()}
    with monkeypatch.context() as patch:
        patch.setattr(partition, "write_pieces", unread)
        again = split_large(scene, store, NoProgress(), **SMALL)
    assert [mesh.name for mesh in again.meshes] == [mesh.name for mesh in first.meshes]
    assert {key: store.get(key) for key in store.list()} == before


@pytest.mark.parametrize("harm", ["file", "gone", "short", "note", "most"])
def test_what_has_changed_is_read_again(source: Path, harm: str) -> None:
    store, most = MemoryStore(), MOST
    split_large(read_scene([source]), store, NoProgress(), **SMALL)
    chunk, note = next(store.list("record/chunk")), next(store.list("record/split"))
    match harm:
        case "file":
            write_stone(source, 13)
        case "gone":
            store.delete(chunk)
        case "short":
            store.put(chunk, store.get(chunk)[:-1])
        case "note":
            store.put(note, b"{")
        case "most":
            most = 200
    notes = Notes()
    found = split_large(read_scene([source]), store, notes, limit=SMALL["limit"], most=most)
    assert any("sorted" in line for line in notes.said)
    count = sum(len(mesh.load().triangles) for mesh in found.meshes)
    assert count == (12 * 13**2 if harm == "file" else 12 * 12**2)


def test_what_was_left_out_is_said_each_time(tmp_path: Path) -> None:
    points, faces = stone(12)
    points[7] = np.nan
    path = write_ply(tmp_path / "a.ply", dict(zip("xyz", points.astype(np.float32).T, strict=True)), faces)
    store = MemoryStore()
    for _ in range(2):
        notes = Notes()
        split_large(read_scene([path]), store, notes, **SMALL)
        lost = int((faces == 7).any(1).sum())
        assert f"{path}: left out {lost} triangles with vertices that are NaN or infinite" in notes.said


class EndingError(Exception):
    """Stands for whatever ends a process."""


@pytest.mark.parametrize("after", [0, 1, 4])
def test_interrupted_it_begins_again(source: Path, after: int) -> None:
    class Ending(MemoryStore):
        left = after

        def put(self, key: str, data: bytes) -> None:
            if self.left == 0:
                raise EndingError
            self.left -= 1
            super().put(key, data)

    scene, store, whole = read_scene([source]), Ending(), MemoryStore()
    with pytest.raises(EndingError):
        split_large(scene, store, NoProgress(), **SMALL)
    assert list(store.list("record/split")) == []
    store.left = 1000
    split_large(scene, store, NoProgress(), **SMALL)
    split_large(scene, whole, NoProgress(), **SMALL)
    assert {key: store.get(key) for key in store.list()} == {key: whole.get(key) for key in whole.list()}


def test_a_mesh_that_ends_early_is_left_out(source: Path, tmp_path: Path, splits_small: None) -> None:
    good = write_stone(tmp_path / "good.ply", 11)
    scene = read_scene([source, good])
    source.write_bytes(source.read_bytes()[:-3000])
    notes, store = Notes(), MemoryStore()
    bake(scene, store, OPTIONS, notes)
    assert any(line.startswith(f"left out: {source}: is truncated") for line in notes.said)
    assert World.open(store).manifest.statistics.triangles == 12 * 11**2
    with pytest.raises(InputError, match="truncated"):
        bake(replace(scene, meshes=scene.meshes[:1], instances=only(scene, 0)), MemoryStore(), OPTIONS)


def only(scene: Scene, mesh: int):  # type: ignore[no-untyped-def]
    """The instances of one mesh."""
    own = scene.instances
    rows = own.mesh == mesh
    return replace(own, mesh=own.mesh[rows], transform=own.transform[rows], first_object=own.first_object[rows])


def test_text_stays_whole_and_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene, notes = read_scene([path]), Notes()
    assert split_large(scene, MemoryStore(), notes, limit=8) is scene
    assert notes.said == [f"{path}: loaded whole, as all text; binary PLY would be read in pieces"]


def test_two_meshes_of_one_name_are_two(tmp_path: Path) -> None:
    """Names in a glTF file need not differ."""
    from scene.small_gltf import GltfFile

    file = GltfFile()
    for n in (12, 13):
        points, faces = stone(n)
        indices = file.accessor(faces.astype(np.uint32).ravel())
        file.node(mesh=file.mesh({"POSITION": file.accessor(points.astype(np.float32))}, indices=indices))
    for mesh in file.json["meshes"]:
        mesh["name"] = "stone"
    store = MemoryStore()
    found = split_large(read_scene([file.write(tmp_path / "a.glb")]), store, NoProgress(), **SMALL)
    assert sum(len(mesh.load().triangles) for mesh in found.meshes) == 12 * (12**2 + 13**2)
    assert len(list(store.list("record/split"))) == 2


def test_pieces_that_no_note_names_are_garbage(source: Path, tmp_path: Path, splits_small: None) -> None:
    other = write_stone(tmp_path / "other.ply", 13)
    store, alone = MemoryStore(), MemoryStore()
    options = replace(OPTIONS, corner=(-2.0, -2.0, -2.0))
    bake(read_scene([source, other]), store, options)
    bake(read_scene([other]), store, options)
    bake(read_scene([other]), alone, options)
    drop_garbage(store)
    assert set(store.list("record/chunk")) == set(alone.list("record/chunk"))
    assert tiles(store) == tiles(alone)
    bake(scene_of((ground(-1.0, 1.0), [(0.0, 0.0, 0.0)])), store, options)
    drop_garbage(store)
    assert [key for key in store.list() if key.startswith(("record/chunk", "record/split"))] == []


@pytest.fixture
def counted_memory() -> Iterator[None]:
    """Python and NumPy say what they allocate."""
    tracemalloc.start()
    yield
    tracemalloc.stop()


@pytest.mark.parametrize("form", ["ply", "stl"])
def test_memory_is_that_of_a_piece(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted_memory: None
) -> None:
    """110,592 triangles in pieces of 4,096, with everything that is held in parts held in parts as small."""
    points, faces = stone(96)
    if form == "ply":
        path = write_stone(tmp_path / "a.ply", 96)
    else:
        path = write_stl(tmp_path / "a.stl", points[faces])
    scene = read_scene([path])
    peaks = []
    tracemalloc.reset_peak()
    scene.meshes[0].load()
    peaks.append(tracemalloc.get_traced_memory()[1])
    for user in (order, rings):
        monkeypatch.setattr(user, "SortedRecords", partial(SortedRecords, rows=4096))
    for module in ("scene.stored.order", "scene.surfaces.stl"):
        monkeypatch.setattr(f"farfield.{module}.BATCH", 2048)
    monkeypatch.setattr("farfield.scene.surfaces.ply._READ", 1 << 14)
    del points, faces
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    split_large(scene, DirectoryStore(tmp_path / "world"), NoProgress(), limit=1 << 20, most=4096)
    peaks.append(tracemalloc.get_traced_memory()[1] - held)
    print(f"{form}: loaded whole {peaks[0] / 1e6:.1f} MB, split {peaks[1] / 1e6:.1f} MB")
    assert peaks[1] < peaks[0] / 4


LARGE = """
import atexit, sys
from pathlib import Path
from farfield.bake import bake
from farfield.cli import main
def tell():
    # Unlike what getrusage says, this is not that of the process before the exec, if that was larger.
    peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
    Path(sys.argv[0]).with_suffix(".peak").write_text(peak.split()[1])

if __name__ == "__main__":
    atexit.register(tell)
    if sys.argv[1] == "whole":
        bake.split_large = lambda scene, store, progress: scene
    sys.argv[1:] = ["bake", sys.argv[2], "-o", sys.argv[3], "--json", "--workers", "1",
                    "--directions", "5", "--depth-layers", "1", "--resolution", "32"]
    main()
"""


def peak_of_a_bake(folder: Path, source: Path, how: str) -> int:
    """Bytes that the process took at most, baking as users do."""
    script = folder / "large.py"
    script.write_text(LARGE)
    path = os.pathsep.join([str(Path(partition.__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, str(script), how, str(source), str(folder / how)],
        env={**os.environ, "PYTHONPATH": path}, check=True, capture_output=True,
    )  # fmt: skip
    peak = 1024 * int(script.with_suffix(".peak").read_text())
    print(f"{source.name} {how}: {peak / 1e6:.0f} MB, {json.loads(done.stdout)['seconds']:.0f} s")
    return peak


def hills(count: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """(count^2, 3) and 2 (count - 1)^2 triangles."""
    x, y = (axis.ravel() / 10 for axis in np.meshgrid(np.arange(count), np.arange(count)))
    points = np.stack([x, y, 20 * np.sin(x / 17) * np.cos(y / 23) + 0.3 * np.sin(3 * x + 2 * y)], 1)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    halves = [
        np.stack([first, first + 1, first + count + 1], 1),
        np.stack([first, first + count + 1, first + count], 1),
    ]
    return points.astype(np.float32), np.stack(halves, 1).reshape(-1, 3)


@pytest.mark.slow
def test_twelve_million_triangles_take_little_memory(tmp_path: Path) -> None:
    points, faces = hills(2450)
    source = write_ply(tmp_path / "hills.ply", dict(zip("xyz", points.T, strict=True)), faces)
    split, whole = (peak_of_a_bake(tmp_path, source, how) for how in ("split", "whole"))
    assert split < 1.1e9
    assert whole > 3 * split


@pytest.mark.slow
@pytest.mark.parametrize("form", ["stl", "glb"])
def test_other_formats_take_little_memory(form: str, tmp_path: Path) -> None:
    """3 million triangles as STL; 8 million as GLB without normals, of which each corner becomes a vertex."""
    from scene.small_gltf import GltfFile

    points, faces = hills(1230 if form == "stl" else 2000)
    source = tmp_path / f"hills.{form}"
    if form == "stl":
        write_stl(source, points[faces])
    else:
        file = GltfFile()
        attributes = {"POSITION": file.accessor(points[:, [0, 2, 1]] * np.float32([1, 1, -1]))}
        file.node(mesh=file.mesh(attributes, indices=file.accessor(faces.astype(np.uint32).ravel())))
        file.write(source)
    split, whole = (peak_of_a_bake(tmp_path, source, how) for how in ("split", "whole"))
    assert split < 1.3e9
    assert whole > 1.5 * split
