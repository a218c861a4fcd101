"""Mesh sources in words of JSON, so that a world remembers what it was baked from."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from farfield.errors import InputError
from farfield.scene.cityjson.appearance import Image
from farfield.scene.footprints.order import LEVELS
from farfield.scene.gltf.container import open_document
from farfield.scene.gltf.read import GltfMesh
from farfield.scene.model import MeshSource
from farfield.scene.options import Facades
from farfield.scene.procedural.ground import GroundPlane
from farfield.scene.stored.cities import StoredCity
from farfield.scene.stored.footprints import StoredFootprints
from farfield.scene.stored.piece import StoredPiece
from farfield.scene.surfaces.obj import parse_obj
from farfield.scene.surfaces.ply import open_ply, parse_ply
from farfield.scene.surfaces.source import FileMesh
from farfield.scene.surfaces.stl import open_stl, parse_stl
from farfield.store.contract import Store
from farfield.world.keys import content_hash
from farfield.world.limits import Count, Hash

_FORMATS = {"obj": (parse_obj, None), "ply": (parse_ply, open_ply), "stl": (parse_stl, open_stl)}

Words = dict[str, Any]


class _Footprints(msgspec.Struct):
    chunk: Hash
    family: str
    level: Annotated[int, Meta(ge=0, le=LEVELS)]
    prefix: Annotated[int, Meta(ge=0, lt=1 << 2 * LEVELS)]
    count: Count
    facades: Facades


class _City(msgspec.Struct):
    chunk: Hash
    name: str
    images: tuple[tuple[str, int, int], ...]
    facades: bool


class _Piece(msgspec.Struct):
    chunk: Hash
    name: str


class _Gltf(msgspec.Struct):
    path: str
    index: Count
    name: str


class _File(msgspec.Struct):
    path: str


class _Ground(msgspec.Struct):
    width: float
    depth: float
    pattern: str
    color: tuple[int, int, int] | None
    tile: float


def words_of(source: MeshSource) -> Words | None:
    """The source in words; None for one that is in memory alone."""
    match source:
        case StoredFootprints():
            names = ("chunk", "family", "level", "prefix", "count", "facades")
            return {"kind": "footprints", **{name: getattr(source, name) for name in names}}
        case StoredCity():
            images = [dataclasses.astuple(image) for image in source.images]
            return {"kind": "city", "chunk": source.chunk, "name": source.name, "images": images,
                    "facades": source.facades}  # fmt: skip
        case StoredPiece():
            return {"kind": "piece", "chunk": source.chunk, "name": source.name}
        case GltfMesh():
            return {"kind": "gltf", "path": _absolute(source.path), "index": source.index, "name": source.name}
        case FileMesh():
            parser = next(name for name, (parse, _) in _FORMATS.items() if parse is source.parse)
            return {"kind": parser, "path": _absolute(source.path)}
        case GroundPlane():
            return {"kind": "ground", **dataclasses.asdict(source)}
    return None


def source_of(words: Words, store: Store) -> MeshSource:
    """The source again. Raises KeyError, TypeError or ValueError for words that `words_of` never gave."""
    facts = dict(words)
    kind = facts.pop("kind")
    if kind == "footprints":
        return StoredFootprints(store, **msgspec.to_builtins(msgspec.convert(facts, _Footprints)))
    if kind == "city":
        city = msgspec.convert(facts, _City)
        return StoredCity(store, city.chunk, city.name, tuple(Image(*image) for image in city.images), city.facades)
    if kind == "piece":
        piece = msgspec.convert(facts, _Piece)
        return StoredPiece(store, piece.chunk, piece.name)
    if kind == "gltf":
        gltf = msgspec.convert(facts, _Gltf)
        return GltfMesh(Path(gltf.path), gltf.index, gltf.name)
    if kind == "ground":
        ground = msgspec.convert(facts, _Ground)
        return GroundPlane(ground.width, ground.depth, ground.pattern, ground.color, ground.tile)
    return FileMesh(Path(msgspec.convert(facts, _File).path), *_FORMATS[kind])


def print_of(source: MeshSource) -> list[int] | None:
    """What changes with a source's files: bytes and time of change, for a glTF with buffers or images beside it a hash
    of theirs as well; [] for what cannot change; None: cannot be told.
    """
    path = getattr(source, "path", None)
    if path is None:
        return []
    try:
        facts = path.stat()
    except OSError:
        return None
    if path.suffix.lower() == ".obj":  # Its materials and images are in other files.
        return None
    own = [facts.st_size, facts.st_mtime_ns]
    if not isinstance(source, GltfMesh):
        return own
    try:
        beside = open_document(path).states
    except InputError:
        return None
    # 60 bits, a number that JSON can say everywhere in 64.
    return [*own, int(content_hash(msgspec.json.encode(beside))[:15], 16)] if beside else own


def _absolute(path: Path) -> str:
    return str(path.absolute())
