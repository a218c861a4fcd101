"""Mesh sources in words of JSON, so that a world remembers what it was baked from."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from farfield.scene.gltf.read import GltfMesh
from farfield.scene.model import MeshSource
from farfield.scene.procedural.ground import GroundPlane
from farfield.scene.stored.footprints import StoredFootprints
from farfield.scene.stored.piece import StoredPiece
from farfield.scene.surfaces.obj import parse_obj
from farfield.scene.surfaces.ply import parse_ply
from farfield.scene.surfaces.source import FileMesh
from farfield.scene.surfaces.stl import parse_stl
from farfield.store.contract import Store

_PARSERS = {"obj": parse_obj, "ply": parse_ply, "stl": parse_stl}

Words = dict[str, Any]


def words_of(source: MeshSource) -> Words | None:
    """The source in words; None for one that is in memory alone."""
    match source:
        case StoredFootprints():
            names = ("chunk", "family", "level", "prefix", "count", "facades")
            return {"kind": "footprints", **{name: getattr(source, name) for name in names}}
        case StoredPiece():
            return {"kind": "piece", "chunk": source.chunk, "name": source.name}
        case GltfMesh():
            return {"kind": "gltf", "path": _absolute(source.path), "index": source.index, "name": source.name}
        case FileMesh():
            parser = next(name for name, parse in _PARSERS.items() if parse is source.parse)
            return {"kind": parser, "path": _absolute(source.path)}
        case GroundPlane():
            return {"kind": "ground", **dataclasses.asdict(source)}
    return None


def source_of(words: Words, store: Store) -> MeshSource:
    """The source again. Raises KeyError, TypeError or ValueError for words that `words_of` never gave."""
    facts = dict(words)
    kind = facts.pop("kind")
    if kind == "footprints":
        return StoredFootprints(store, **facts)
    if kind == "piece":
        return StoredPiece(store, **facts)
    if kind == "gltf":
        return GltfMesh(Path(facts["path"]), int(facts["index"]), str(facts["name"]))
    if kind == "ground":
        color = facts.pop("color")
        return GroundPlane(**facts, color=None if color is None else tuple(color))
    return FileMesh(Path(facts["path"]), _PARSERS[kind])


def print_of(source: MeshSource) -> list[int] | None:
    """What changes with a source's file: bytes and time of change; [] for what cannot change; None: cannot be told.

    A .gltf has its buffers in other files.
    """
    path = getattr(source, "path", None)
    if path is None:
        return []
    try:
        facts = path.stat()
    except OSError:
        return None
    return None if path.suffix.lower() in (".gltf", ".obj") else [facts.st_size, facts.st_mtime_ns]


def _absolute(path: Path) -> str:
    return str(path.absolute())
