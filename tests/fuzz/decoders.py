"""The table of every decoder of the package. One more is one more function here, named in DECODERS."""

from __future__ import annotations

import base64
import io
import json
import zipfile
import zlib
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from farfield.bake.cell import decode_record
from farfield.geometry.cameras import Camera
from farfield.geometry.directions import TOP, principal
from farfield.octree.grid import CellKey, Grid
from farfield.represent.blockmap.blockmap import BlockMap
from farfield.represent.blockmap.coding import decode_blockmap, decode_objects
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.read import LeafGeometry, read_leaf_glb, read_mesh_glb
from farfield.represent.geometry.texture import decode_texture
from farfield.represent.geometry.write import MAGIC, PlacedMesh, encode_texture, leaf_glb, mesh_glb
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import OBJECTS, decode_object_tile, encode_object_tile
from farfield.represent.orthoview.quality import quality
from farfield.represent.orthoview.tile import COLOR, COVERAGE, DEPTH, FLAGS, NORMAL, UNLIT, decode_tile, encode_tile
from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.model import Material, Mesh, Texture
from farfield.scene.stored.piece import decode_piece, encode_piece
from farfield.scene.stored.piece import decode_texture as decode_stored_texture
from farfield.scene.stored.piece import encode_texture as encode_stored_texture
from farfield.serve.batch import decode_keys
from farfield.store.archive.layout import (
    DIRECTORY_MEMORY,
    HEADER_BYTES,
    MAX_DIRECTORY_BYTES,
    Entry,
    Header,
    Span,
    decode_directory,
    decode_header,
    encode_directory,
    encode_header,
)
from farfield.store.archive.order import rank
from farfield.store.memory import MemoryStore
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.geometry import Batches, GeometryPass
from farfield.view.shading import Light
from farfield.world import keys
from farfield.world.index import MAXIMUM_BYTES, decode_index
from farfield.world.manifest import KEY, decode_manifest, with_servers
from farfield.world.servers import RULE, ServersRecord
from farfield.world.world import World
from fuzz import scene_decoders
from fuzz.shells import (
    BARE,
    BARE_JSON,
    BLOCKMAP_OBJECTS,
    BLOCKMAP_OBJECTS_STREAM,
    CHUNK_BODY,
    CHUNK_JSON,
    DIRECTORY_COLUMNS,
    GLB_BODY,
    GLB_JSON,
    HEADER,
    INDEX_TEXT,
    PACKED,
    PACKED_STREAM,
    PNG,
    SEALED,
    blockmap_stream,
    plain_glb,
    plane,
    tables,
)
from fuzz.table import Decoder
from represent.random_layers import random_layer

GOLDEN = Path(__file__).parents[1] / "fixtures/world-v1.zip"
_ROOM = 256 << 10
"""Bytes that any decoder may take besides: objects of the interpreter, messages."""
_GRID = Grid(4.0, 16, (0.0, 0.0, 0.0), (1, 1, 1))
_CAMERA = Camera((9.0, -8.0, 7.0), (1.0, 1.0, 1.0), 60.0)
_WHITE = Texture(np.full((2, 2, 4), 255, np.uint8))
_LAYER = random_layer(7, 13, 11, objects=True)


@cache
def golden() -> dict[str, bytes]:
    """The values of the world that version 1 wrote."""
    with zipfile.ZipFile(GOLDEN) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _golden(folder: str, most: int) -> tuple[bytes, ...]:
    """Some values below a folder, evenly spread."""
    names = sorted(name for name in golden() if name.startswith(folder))
    return tuple(golden()[name] for name in names[:: max(1, len(names) // most)])


def _times(factor: int) -> Callable[[bytes], int]:
    """A bound of so many bytes for each byte of the input."""
    return lambda data: factor * len(data) + _ROOM


# Orthoviews


def _orthoview() -> Decoder:
    layers = [_LAYER, random_layer(1, 1, 1), random_layer(2, 1, 70), random_layer(3, 33, 40, fill=0.3)]
    fresh = [encode_tile(layer, n, n % 2, n, quality("normal")) for n, layer in enumerate(layers)]
    coded = (DEPTH, NORMAL, COVERAGE, FLAGS, UNLIT)
    shells = (BARE, SEALED, SEALED, *map(plane, (*coded, COLOR)), *map(tables, coded))
    return Decoder("orthoview", decode_tile, (*fresh, *_golden("orthoview", 10)), shells, _tile_bound, _use_tile)


def _tile_bound(data: bytes) -> int:
    width, height = int.from_bytes(data[20:22], "little"), int.from_bytes(data[22:24], "little")
    return 64 * width * height * (max(width, height) <= 4096) + 4 * len(data) + (1 << 20) + _ROOM


def _use_tile(tile: Any) -> None:
    """Whole, and drawn: its codes are indices into tables of the drawing kernel."""
    layer: OrthoLayer = tile.layer
    valid = layer.valid
    assert valid.any()
    assert layer.color.shape == (*valid.shape, 3)
    assert layer.normal.max() < 64
    assert ((layer.coverage > 0) == valid).all()
    assert layer.coverage.max() <= 16
    assert 1 <= layer.length.min() <= layer.length.max() <= 8
    Frame.empty(_CAMERA, (24, 24), 1).splat(layer, principal(TOP), _GRID, 0, Light())


def _objects() -> Decoder:
    corpus = tuple(
        encode_object_tile(random_layer(7, 13, 11, objects=True) if n == 0 else _with_objects(n), 4, 0, 1)
        for n in range(3)
    )
    return Decoder(
        "objects",
        lambda data: decode_object_tile(data, _LAYER),
        corpus,
        (BARE, SEALED, SEALED, plane(OBJECTS), tables(OBJECTS)),
        lambda data: 32 * _LAYER.depth.size + 4 * len(data) + (1 << 20) + _ROOM,
    )


def _with_objects(seed: int) -> OrthoLayer:
    """The layer with a few ids only, as real ones have."""
    ids = np.random.default_rng(seed).integers(1, 5, _LAYER.shape, dtype=np.uint32)
    return OrthoLayer(*(ids if name == "objects" else getattr(_LAYER, name) for name in OrthoLayer.__slots__))


# BlockMaps


@cache
def _blockmap_vectors() -> tuple[dict[str, Any], ...]:
    """What scripts/write_blockmap_vectors.py wrote."""
    paths = sorted((Path(__file__).parents[1] / "vectors/blockmaps").glob("*.json"))
    return tuple(json.loads(path.read_text()) for path in paths if path.stem != "corrupt")


def _blockmap() -> Decoder:
    corpus = tuple(base64.b64decode(vector["blockmap"]) for vector in _blockmap_vectors())
    shells = (BARE, SEALED, SEALED, blockmap_stream(0), blockmap_stream(0), blockmap_stream(1), blockmap_stream(2))
    return Decoder(
        "blockmap",
        lambda data: decode_blockmap(data, ""),
        corpus,
        shells,
        lambda data: 64 * 64 * 320 + 4 * len(data) + _ROOM,
        _use_blockmap,
    )


def _use_blockmap(blockmap: BlockMap) -> None:
    """Drawn: where its walls are in its image are indices of the drawing kernel."""
    own, (rows, columns) = blockmap.unfolded, blockmap.colors.shape[:2]
    assert (own.places[..., 0] + own.across + rows <= columns).all()
    assert (own.places[..., 1] + own.places[..., 2] <= rows).all()
    frame = Frame.empty(_CAMERA, (24, 24), 1)
    draw_blockmap(frame, CastableMap.of(blockmap, np.full(3, 4.0)), np.zeros(3), Light())


def _blockmap_objects() -> Decoder:
    corpus = tuple(base64.b64decode(vector["object_ids"]) for vector in _blockmap_vectors())
    shells = (BARE, BLOCKMAP_OBJECTS, BLOCKMAP_OBJECTS, BLOCKMAP_OBJECTS_STREAM)
    return Decoder(
        "blockmap_objects",
        lambda data: decode_objects(data, ""),
        corpus,
        shells,
        lambda data: 64 * 64 * 64 + 4 * len(data) + _ROOM,
    )


# The world


def _index() -> Decoder:
    corpus = _golden("index", 4)
    return Decoder("index", lambda data: decode_index(data, ""), corpus, (BARE, INDEX_TEXT, INDEX_TEXT), _index_bound)


def _index_bound(data: bytes) -> int:
    declared = int.from_bytes(data[8:12], "little")
    return 16 * declared * (declared <= MAXIMUM_BYTES) + 4 * len(data) + _ROOM


def _manifest() -> Decoder:
    servers = ServersRecord(RULE, 1, ("https://a.example.org/city/", "./", "../b/"))
    corpus = (golden()[KEY], with_servers(golden()[KEY], servers))
    return Decoder("manifest", decode_manifest, corpus, (BARE_JSON,), _times(32))


def _walk() -> Decoder:
    """An index tile in its place in a world, which is walked through to its end."""
    store = MemoryStore()
    for name, value in golden().items():
        store.put(name, value)
    root = decode_manifest(golden()[KEY]).roots[0]
    key = keys.index_key(CellKey.parse(root.key), root.hash)

    def walk(data: bytes) -> int:
        store.put(key, data)
        world = World.open(store)
        return sum(len(world.grid.bounds(entry.cell)) for entry in world.cells())

    corpus = (golden()[key],)
    shells = (INDEX_TEXT,)
    return Decoder("walk", walk, corpus, shells, lambda data: _index_bound(data) + (1 << 20))


def _record() -> Decoder:
    names = sorted(name for name in golden() if name.startswith("record/1"))
    key = CellKey.parse(names[0].removeprefix("record/"))
    corpus = tuple(golden()[name] for name in names)
    return Decoder("record", lambda data: decode_record(data, key), corpus, (BARE_JSON,), _times(32))


def _keys() -> Decoder:
    corpus = (b'["world.json"]', b'["index/1/0/0/0-0123456789abcdef","mesh/0123456789abcdef"]')
    return Decoder("keys", decode_keys, corpus, (BARE_JSON,), _times(32))


def _archive() -> Decoder:
    """A directory of an archive; the checksum over it is its reader's business, so nothing shields it here."""
    entries, end = [], HEADER_BYTES
    for key in sorted(golden(), key=rank):
        entries.append(Entry(key, Span(end, len(golden()[key]), zlib.crc32(golden()[key]))))
        end += len(golden()[key])
    corpus = tuple(encode_directory(part) for part in (entries, entries[:1], entries[5:40]))
    shells = (BARE, DIRECTORY_COLUMNS, DIRECTORY_COLUMNS)
    return Decoder("archive", lambda data: decode_directory(data, end, ""), corpus, shells, _directory_bound)


def _directory_bound(data: bytes) -> int:
    declared = int.from_bytes(data[:4], "little")
    return DIRECTORY_MEMORY * declared * (declared <= MAX_DIRECTORY_BYTES) + 4 * len(data) + _ROOM


def _archive_header() -> Decoder:
    header = Header(Span(HEADER_BYTES, 100, 7), 5000, 40)
    corpus = (encode_header(header),)
    return Decoder("archive_header", lambda data: decode_header(data, ""), corpus, (BARE, HEADER), _times(4))


# Near geometry


def _sample_chunk(count: int, seed: int) -> Chunk:
    """Triangles of three materials with everything that vertices can have."""
    r = np.random.default_rng(seed)
    return Chunk(
        r.random((3 * count, 3), np.float32) * 4,
        np.tile(np.float32([0, 0, 1]), (3 * count, 1)),
        r.random((3 * count, 2), np.float32),
        r.integers(0, 256, (3 * count, 4), dtype=np.uint8),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
        r.integers(0, 3, count, dtype=np.uint32),
        r.integers(1, 4, count, dtype=np.uint32),
    )


NEAR = Path(__file__).parents[1] / "vectors/near"
_NEAR_SHELLS = (BARE, GLB_JSON, GLB_JSON, GLB_BODY, PACKED, PACKED_STREAM)
_MATERIALS = (
    Material("", (1.0, 1.0, 1.0, 1.0), _WHITE),
    Material("", (1.0, 0.5, 0.2, 1.0)),
    Material("", (1.0, 1.0, 1.0, 1.0), _WHITE, 0.5, unlit=True),
)


def _near_bound(data: bytes) -> int:
    """32 bytes for each of the GLB, and 256 for each of the 16 vertices and triangles that a byte may unpack to."""
    packed = data[:4] == MAGIC and len(data) >= 12
    length = min(int.from_bytes(data[8:12], "little"), 1 << 30) if packed else len(data)
    compressed = b"KHR_draco" in data or packed
    return (32 + 16 * 256 * compressed) * length + _ROOM


def _leaf() -> Decoder:
    place = PlacedMesh("0123456789abcdef", np.eye(3, 4)[None].repeat(2, 0), np.array([1, 2], np.uint32))
    fresh = leaf_glb(CellKey(0, 0, 0, 0), 8.0, _sample_chunk(5, 1), _MATERIALS, [place], lambda _: "0123456789abcdef")

    def read(data: bytes) -> LeafGeometry:
        return read_leaf_glb(data, "", lambda _: _WHITE)

    def use(leaf: LeafGeometry) -> None:
        if leaf.mesh is not None:
            _use_mesh(leaf.mesh)
        for placed in leaf.placed:
            assert placed.transforms.shape == (len(placed.objects), 3, 4)

    older = (NEAR / "version-1/leaf.bin").read_bytes()
    corpus = (plain_glb(fresh), fresh, older, *_golden("geometry", 6))
    return Decoder("leaf", read, corpus, _NEAR_SHELLS, _near_bound, use)


def _mesh() -> Decoder:
    fresh = mesh_glb(_sample_chunk(40, 2), 1e-3, _MATERIALS, lambda _: "0123456789abcdef")

    def read(data: bytes) -> Mesh:
        return read_mesh_glb(data, "", lambda _: _WHITE)

    older = (NEAR / "version-1/mesh.bin").read_bytes()
    corpus = (plain_glb(fresh), fresh, older, *_golden("mesh", 2))
    return Decoder("mesh", read, corpus, _NEAR_SHELLS, _near_bound, _use_mesh)


def _use_mesh(mesh: Mesh) -> None:
    """Whole, cut at the walls of a cell, and drawn."""
    count = len(mesh.positions)
    assert mesh.triangles.max(initial=0) < max(count, 1)
    assert len(mesh.normals) == count
    assert all(part is None or len(part) == count for part in (mesh.uvs, mesh.colors))
    if len(mesh.triangles) == 0:
        return
    blocked = BlockedMesh.from_mesh(mesh)
    batches = Batches(GeometryPass(Frame.empty(_CAMERA, (16, 16), 1), Light()))
    base = batches.add_materials(mesh.materials)
    chunks = (blocked.cell_chunk(np.eye(3, 4), _GRID, (0, 0, 0), base, 1), Chunk.whole(blocked))
    for chunk in chunks:
        if chunk is not None:
            batches.add(chunk)
    batches.flush()


def _texture() -> Decoder:
    pixels = np.random.default_rng(3).integers(0, 256, (9, 7, 4), dtype=np.uint8)
    fresh = (encode_texture(Texture(pixels)), *(_image(pixels, form) for form in ("PNG", "JPEG", "palette")))
    corpus = (*fresh, *_golden("texture", 1))
    return Decoder("texture", lambda data: decode_texture(data, ""), corpus, (BARE, PNG), _texture_bound)


def _image(pixels: np.ndarray, form: str) -> bytes:
    stream = io.BytesIO()
    if form == "palette":
        Image.fromarray(pixels[..., 0]).convert("P").save(stream, "PNG", transparency=3)
    else:
        Image.fromarray(pixels[..., :3]).save(stream, form)
    return stream.getvalue()


def _texture_bound(data: bytes) -> int:
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as image:
            width, height = image.size
    except Exception:
        width = height = 0
    return 32 * width * height * (max(width, height) <= 8192) + 16 * len(data) + _ROOM


# Parts of the scene


def _piece() -> Decoder:
    chance = np.random.default_rng(4)
    bare = RawSurface(chance.random((9, 3)), chance.integers(0, 9, (12, 3)))
    full = RawSurface(
        bare.positions.astype(np.float32).astype(np.float64),
        bare.triangles,
        uvs=chance.random((9, 2)).astype(np.float32),
        colors=chance.integers(0, 256, (9, 4)).astype(np.uint8),
        materials=(Material("bark", (0.5, 1.0, 1.0, 1.0), None, 0.5, False, True),),
    )
    corpus = (encode_piece(assemble(bare, ""), ""), encode_piece(assemble(full, ""), "0123456789abcdef"))
    shells = (BARE, CHUNK_JSON, CHUNK_JSON, CHUNK_BODY)
    return Decoder("piece", decode_piece, corpus, shells, _times(32), lambda piece: _use_mesh(piece.mesh))


def _piece_texture() -> Decoder:
    corpus = (encode_stored_texture(_WHITE), encode_stored_texture(Texture(np.zeros((3, 5, 4), np.uint8))))
    shells = (BARE, CHUNK_JSON, CHUNK_BODY)
    return Decoder("piece_texture", decode_stored_texture, corpus, shells, _times(32))


DECODERS: tuple[Callable[[], Decoder], ...] = (
    _orthoview, _objects, _blockmap, _blockmap_objects, _index, _manifest, _walk, _record, _keys, _archive,
    _archive_header, _leaf, _mesh, _texture,
    scene_decoders.footprints, scene_decoders.city, scene_decoders.scene_note, scene_decoders.attributes,
    _piece, _piece_texture,
)  # fmt: skip


@cache
def decoders() -> dict[str, Decoder]:
    """All of them by name."""
    made: Iterable[Decoder] = (make() for make in DECODERS)
    return {decoder.name: decoder for decoder in made}
