"""A glTF file as a Scene: only its JSON is read; every mesh loads when it is needed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farfield.errors import InputError
from farfield.scene.assembly import scene_of
from farfield.scene.faults import counted, reading
from farfield.scene.gltf.container import Document, open_document
from farfield.scene.gltf.nodes import placements
from farfield.scene.gltf.primitives import drawable, mesh_of, stream_of
from farfield.scene.model import Mesh, MeshSource, Scene
from farfield.scene.streams import MeshStream


@dataclass(frozen=True, slots=True)
class GltfMesh:
    """One mesh of a glTF file."""

    path: Path
    index: int
    name: str

    def load(self) -> Mesh:
        """Reads and decodes the mesh. Raises InputError."""
        with reading(self.name):
            return mesh_of(open_document(self.path), self.index, self.name)

    def stream(self) -> MeshStream | None:
        """See `StreamedSource.stream`."""
        with reading(self.name):
            return stream_of(open_document(self.path), self.index)


def read_gltf(path: Path) -> Scene:
    """The scene of a .gltf or .glb file: one MeshSource a mesh, one instance a node. Raises InputError."""
    document = open_document(path)
    with reading(document.where):
        placed = placements(document)
        warnings = _warnings(document)
        meshes = document.items("meshes")
        solid = [i for i, mesh in enumerate(meshes) if any(drawable(part) for part in mesh["primitives"])]
        placed = [entry for entry in placed if entry[0] in set(solid)]
        if not placed:
            raise InputError("holds no triangles", document.where, "export its meshes with it")
        used = sorted({mesh for mesh, _ in placed})
        sources: list[MeshSource] = [GltfMesh(path, index, _label(document, index)) for index in used]
        number = {index: row for row, index in enumerate(used)}
        mesh_rows = np.concatenate([np.full(len(t), number[mesh], np.int32) for mesh, t in placed])
        transforms = np.concatenate([t for _, t in placed])
        size = sum(file.stat().st_size for file in document.files())
        return scene_of(sources, mesh_rows, transforms, source_bytes=size, warnings=warnings)


def _label(document: Document, index: int) -> str:
    title = document.item("meshes", index).get("name") or index
    return document.where if len(document.items("meshes")) == 1 else f"{document.where}, mesh {title}"


def _warnings(document: Document) -> tuple[str, ...]:
    parts = [part for mesh in document.items("meshes") for part in mesh["primitives"]]
    lines = []
    if flat := sum(not drawable(part) for part in parts):
        lines.append(f"{document.where}: left out {counted(flat, 'primitive')} of points or lines")
    if document.items("skins"):
        lines.append(f"{document.where}: skinned meshes are drawn in their bind pose")
    return tuple(lines)
