"""The pieces of a mesh together are the mesh as it is when it is loaded whole, to the bit."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from farfield.errors import CorruptTileError, InputError, StoreError
from farfield.progress import NoProgress
from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.gltf import materials, primitives
from farfield.scene.model import Mesh, MeshSource
from farfield.scene.read import read_scene
from farfield.scene.shading import ALWAYS_FLAT, CREASE_COSINE
from farfield.scene.stored import order, rings
from farfield.scene.stored.container import SceneChunk, encode_chunk
from farfield.scene.stored.piece import PIECE, StoredPiece, decode_piece, encode_piece
from farfield.scene.stored.pieces import Pieces, write_pieces
from farfield.scene.stored.sorting import SortedRecords
from farfield.scene.streams import MeshStream, StreamedSource
from farfield.scene.surfaces import ply, stl
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from farfield.world.keys import chunk_key
from scene.small_gltf import GltfFile
from scene.stored.large import HeldStream, rows_of, stone, write_ply, write_stl, write_stone

MOST = 200


def split(source: MeshSource, store: Store, most: int = MOST) -> Pieces:
    assert isinstance(source, StreamedSource)
    stream = source.stream()
    assert stream is not None
    return write_pieces(stream, store, source.name, NoProgress(), most)


def meshes_of(pieces: Pieces, store: Store) -> list[Mesh]:
    return [StoredPiece(store, chunk, "").load() for chunk, _ in pieces.pieces]


@pytest.fixture
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is read and sorted in very small parts."""
    for module in (order, stl, primitives):
        monkeypatch.setattr(module, "BATCH", 64)
    monkeypatch.setattr(ply, "_READ", 500)
    for user in (order, rings):
        monkeypatch.setattr(user, "SortedRecords", partial(SortedRecords, rows=150))


def plain_ply(folder: Path) -> Path:
    return write_stone(folder / "a.ply", 12)


def big_endian_ply_with_everything(folder: Path) -> Path:
    """Quads among the triangles, colours, texture coordinates, and normals of which some are missing."""
    points, faces = stone(9)
    chance = np.random.default_rng(5)
    columns = dict(zip("xyz", points.T, strict=True))
    normals = points.astype(np.float32).copy()
    normals[::5] = 0
    columns |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    columns |= {name: chance.random(len(points)).astype(np.float32) for name in "st"}
    columns |= {name: chance.integers(0, 256, len(points)).astype(np.uint8) for name in ("red", "green", "blue")}
    quads = [(*face, face[0] - 1) if face[0] % 3 == 1 else tuple(face) for face in faces.tolist()]
    return write_ply(folder / "a.ply", columns, quads, ">")


def damaged_ply(folder: Path) -> Path:
    """Vertices that are not there, NaN, and far away; triangles without area."""
    points, faces = stone(10)
    points[3], points[40], points[77] = np.nan, np.inf, 6e7
    faces[5], faces[90] = [1, 2, len(points)], [1, 1, 2]
    return write_ply(folder / "a.ply", dict(zip("xyz", points.astype(np.float32).T, strict=True)), faces)


def some_stl(folder: Path) -> Path:
    points, faces = stone(10)
    return write_stl(folder / "a.stl", points[faces])


def glb(folder: Path) -> Path:
    """Four surfaces: textured with normals, without normals, a strip, a fan that is not indexed."""
    points, faces = stone(8)
    single, chance = points.astype(np.float32), np.random.default_rng(2)
    file = GltfFile()
    picture = folder / "picture.png"
    Image.fromarray(chance.integers(0, 256, (4, 4, 3), dtype=np.uint8)).save(picture)
    file.json["images"] = [{"bufferView": file.view(picture.read_bytes()), "mimeType": "image/png"}]
    file.json["textures"] = [{"source": 0}]
    texture = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 3]}}}
    file.material(pbrMetallicRoughness={"baseColorTexture": texture}, alphaMode="MASK", name="bark")
    file.material(pbrMetallicRoughness={"baseColorFactor": [1, 0.5, 0, 1]})
    positions = file.accessor(single)
    uvs = file.accessor(chance.random((len(points), 2)).astype(np.float32))
    colors = file.accessor(chance.integers(0, 256, (len(points), 4)).astype(np.uint8), normalized=True)
    indices = file.accessor(faces.astype(np.uint32).ravel())
    textured = {"POSITION": positions, "NORMAL": file.accessor(single), "TEXCOORD_0": uvs, "COLOR_0": colors}
    file.json["meshes"] = [
        {
            "primitives": [
                {"attributes": textured, "indices": indices, "material": 0},
                {"attributes": {"POSITION": positions}, "indices": indices, "material": 1},
                {"attributes": {"POSITION": positions}, "indices": indices, "mode": 5},
                {"attributes": {"POSITION": positions, "NORMAL": file.accessor(single)}, "mode": 6, "material": 0},
            ]
        }
    ]
    file.node(mesh=0)
    return file.write(folder / "a.glb")


@pytest.mark.parametrize("make", [plain_ply, big_endian_ply_with_everything, damaged_ply, some_stl, glb])
def test_pieces_are_the_whole(make: Callable[[Path], Path], tmp_path: Path, small_batches: None) -> None:
    source = read_scene([make(tmp_path)]).meshes[0]
    whole, store = source.load(), MemoryStore()
    pieces = split(source, store)
    found = meshes_of(pieces, store)
    assert len(found) > 4
    assert max(len(mesh.triangles) for mesh in found) <= MOST
    np.testing.assert_array_equal(rows_of(found), rows_of([whole]))
    assert pieces.warnings == whole.warnings
    kept = {name for name, _ in pieces.pieces + pieces.textures}
    assert set(store.list()) == {chunk_key(name) for name in kept}


def test_whatever_the_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same chunks, and so the same world, on a machine of any size."""
    source = read_scene([glb(tmp_path)]).meshes[0]
    at_once = split(source, MemoryStore())
    for size in (6, 100):
        for module in (order, stl, primitives):
            monkeypatch.setattr(module, "BATCH", size)
        monkeypatch.setattr(order, "SortedRecords", partial(SortedRecords, rows=size))
        assert split(source, MemoryStore()) == at_once


@st.composite
def surfaces(draw: st.DrawFn) -> RawSurface:
    """Anything that a file may hold: few distinct places, so that much of it coincides."""
    count = draw(st.integers(1, 14))
    place = st.sampled_from([0.0, 1.0, 2.0, 2.5, -7.0, 1e-9, 3e4, np.nan, np.inf, 4e7])
    positions = draw(st.lists(st.tuples(place, place, place), min_size=count, max_size=count))
    corner = st.integers(-1, count)
    triangles = draw(st.lists(st.tuples(corner, corner, corner), max_size=30))
    normals = None
    if draw(st.booleans()):
        component = st.sampled_from([0.0, 1.0, -0.5, np.nan])
        normals = np.array(draw(st.lists(st.tuples(component, component, component), min_size=count, max_size=count)))
    crease = draw(st.sampled_from([CREASE_COSINE, ALWAYS_FLAT, -1.0]))
    return RawSurface(
        np.array(positions, np.float64), np.array(triangles, np.int64).reshape(-1, 3), normals, crease_cosine=crease
    )


@settings(max_examples=300, deadline=None)
@given(surfaces(), st.integers(1, 9), st.integers(1, 40))
def test_any_surface(raw: RawSurface, most: int, batch: int) -> None:
    whole, store = assemble(raw, "x"), MemoryStore()
    pieces = write_pieces(MeshStream((HeldStream(raw, batch),), ()), store, "x", NoProgress(), most)
    found = meshes_of(pieces, store)
    assert pieces.warnings == whole.warnings
    assert sum(len(mesh.triangles) for mesh in found) == len(whole.triangles)
    assert all(1 <= len(mesh.triangles) <= most for mesh in found)
    if len(whole.triangles):
        np.testing.assert_array_equal(rows_of(found), rows_of([whole]))


def test_a_change_in_one_place_changes_few_pieces(tmp_path: Path) -> None:
    """So that an update bakes few cells again."""
    points, faces = stone(40)
    changed = points.copy()
    changed[np.argmax(points @ [1, 2, 3])] *= 1.01
    # One triangle more at the beginning moves all others on in the file.
    more = np.concatenate([faces[np.argmin(points[faces[:, 0]] @ [1, 2, 3])][None, ::-1], faces])
    found = []
    for number, (own, kept) in enumerate([(points, faces), (changed, faces), (points, more)]):
        file = write_ply(tmp_path / f"{number}.ply", dict(zip("xyz", own.astype(np.float32).T, strict=True)), kept)
        found.append({name for name, _ in split(read_scene([file]).meshes[0], MemoryStore(), 500).pieces})
    before, *after = found
    assert len(before) > 40
    assert all(1 <= len(before - names) <= 4 for names in after)


def test_pieces_are_compact() -> None:
    points, faces = stone(40)
    store = MemoryStore()
    stream = MeshStream((HeldStream(RawSurface(points, faces)),), ())
    found = meshes_of(write_pieces(stream, store, "x", NoProgress(), 500), store)
    sides = [np.ptp(mesh.positions, axis=0).max() for mesh in found]
    assert np.median(sides) < 0.6, "of a ball two across in some 60 pieces"


def test_more_triangles_in_one_place_than_a_piece_holds() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]])
    raw = RawSurface(corners, np.array([[0, 1, 2]] * 25 + [[1, 2, 3]]))
    store = MemoryStore()
    pieces = write_pieces(MeshStream((HeldStream(raw),), ()), store, "x", NoProgress(), 10)
    assert sorted(len(mesh.triangles) for mesh in meshes_of(pieces, store)) == [1, 5, 10, 10]


def test_a_texture_is_stored_and_held_once(tmp_path: Path) -> None:
    store = DirectoryStore(tmp_path / "world")
    pieces = split(read_scene([glb(tmp_path)]).meshes[0], store)
    assert len(pieces.textures) == 1
    sources = [StoredPiece(store, chunk, f"piece {k}") for k, (chunk, _) in enumerate(pieces.pieces)]
    elsewhere = pickle.loads(pickle.dumps(sources))
    textures = {m.texture for source in sources + elsewhere for m in source.load().materials if m.texture is not None}
    meshes = [source.load() for source in elsewhere]
    held = {id(m.texture) for mesh in meshes for m in mesh.materials if m.texture is not None}
    assert len(held) == 1
    assert {texture.pixels.shape for texture in textures} == {(4, 4, 4)}


def test_only_headers_are_read_to_see_how_large_a_mesh_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Decoded textures of all meshes of a scene would fill the memory of the process that asks."""

    def decoded(*_: object) -> None:
        pytest.fail("a texture was decoded")

    source = read_scene([glb(tmp_path)]).meshes[0]
    monkeypatch.setattr(materials, "decode_image", decoded)
    assert isinstance(source, StreamedSource)
    stream = source.stream()
    assert stream is not None
    points, faces = stone(8)
    strip, fan = len(faces) * 3 - 2, len(points) - 2
    assert stream.loaded_bytes == 4 * 48 * len(points) + 14 * (2 * len(faces) + strip + fan)


@pytest.mark.parametrize("make", [plain_ply, some_stl, glb])
@pytest.mark.parametrize("share", [0.3, 0.95])
def test_files_that_are_cut_short(make: Callable[[Path], Path], share: float, tmp_path: Path) -> None:
    path = make(tmp_path)
    source = read_scene([path]).meshes[0]
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match="truncated"):
        split(source, MemoryStore())


def test_a_file_that_makes_no_sense(tmp_path: Path) -> None:
    """Whatever a reader trips over is the file's fault, so that the rest of a scene still bakes."""
    path = plain_ply(tmp_path)
    source = read_scene([path]).meshes[0]
    path.write_bytes(path.read_bytes().replace(b"list uchar", b"list  char").replace(b"\x03", b"\xff"))
    with pytest.raises(InputError, match="damaged: a face of -1 corners"):
        split(source, MemoryStore())


def test_no_room_for_temporary_files(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="TMPDIR"):
        SortedRecords(tmp_path / "gone" / "records", order.TRIANGLE)


def test_a_damaged_piece_is_never_left_out_in_silence(tmp_path: Path) -> None:
    store = MemoryStore()
    pieces = split(read_scene([plain_ply(tmp_path)]).meshes[0], store)
    key = chunk_key(pieces.pieces[0][0])
    store.put(key, store.get(key)[:-9] + bytes(9))
    with pytest.raises(CorruptTileError, match=key):
        StoredPiece(store, pieces.pieces[0][0], "x").load()


def _changed(chunk: SceneChunk, name: str, array: NDArray[np.generic] | None) -> bytes:
    arrays = {k: v for k, v in chunk.arrays.items() if k != name}
    return encode_chunk(replace_arrays(chunk, arrays if array is None else arrays | {name: array}))


def replace_arrays(chunk: SceneChunk, arrays: dict[str, NDArray[np.generic]]) -> SceneChunk:
    return SceneChunk(chunk.kind, chunk.about, arrays)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("positions", None),
        ("normals", None),
        ("triangles", None),
        ("positions", np.full((3, 3), np.nan, np.float32)),
        ("positions", np.zeros((2, 3), np.float32)),
        ("positions", np.zeros((), np.float32)),
        ("triangles", np.array([[0, 1, 3]], np.uint32)),
        ("triangles", np.array([0, 1, 2], np.uint32)),
        ("triangles", np.array([[0, 1, 2]], np.int64)),
        ("uvs", np.zeros((3, 3), np.float32)),
        ("colors", np.zeros((4, 4), np.uint8)),
    ],
)
def test_what_a_piece_may_not_hold(name: str, array: NDArray[np.generic] | None) -> None:
    mesh = assemble(RawSurface(np.eye(3), np.array([[0, 1, 2]])), "x")
    chunk = SceneChunk(
        PIECE,
        {"material": {"name": "", "base_color": [1, 1, 1, 1], "alpha_cutoff": None, "double_sided": True,
                      "unlit": False, "texture": ""}},
        {"positions": mesh.positions, "normals": mesh.normals, "triangles": mesh.triangles},
    )  # fmt: skip
    assert len(decode_piece(encode_chunk(chunk)).mesh.triangles) == 1
    with pytest.raises(CorruptTileError, match="damaged"):
        decode_piece(_changed(chunk, name, array))
    with pytest.raises(CorruptTileError, match="damaged"):
        decode_piece(encode_chunk(SceneChunk(PIECE, {"material": {"name": 3}}, chunk.arrays)))


def test_positions_of_double_precision_stay() -> None:
    points = np.array([[0.1, 0, 0], [1e6 + 1 / 3, 0, 0], [0, 1e6 + 1 / 7, 0]])
    mesh = assemble(RawSurface(points, np.array([[0, 1, 2]])), "x")
    for own, size in ((mesh, 8), (replace(mesh, positions=np.round(points)), 4)):
        data = encode_piece(own, "")
        np.testing.assert_array_equal(decode_piece(data).mesh.positions, own.positions)
        assert len(data) < 420 + 9 * size
