"""From a glTF mesh's primitives to one Mesh, z up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import srgb_from_linear
from farfield.scene.cleaning import RawSurface, assemble, merge, visible
from farfield.scene.gltf.accessors import accessor_array, accessor_count, accessor_floats, normalised
from farfield.scene.gltf.container import Document
from farfield.scene.gltf.draco import decode_primitive
from farfield.scene.gltf.materials import GltfMaterial, material_of, transformed_uvs
from farfield.scene.model import Material, Mesh
from farfield.scene.shading import ALWAYS_FLAT, CREASE_COSINE
from farfield.scene.streams import BATCH, MeshStream, Vertices, whole

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def drawable(primitive: dict[str, Any]) -> bool:
    """True for triangles, strips and fans; points and lines are not surfaces."""
    return primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN) and "POSITION" in primitive["attributes"]


def mesh_of(document: Document, index: int, where: str) -> Mesh:
    """All triangles of a glTF mesh. Raises InputError when the file is damaged."""
    return merge([_part(document, primitive, where) for primitive in _drawable(document, index)])


def stream_of(document: Document, index: int) -> MeshStream | None:
    """The same to be read a part at a time; None: some of it is compressed. Raises InputError."""
    primitives = _drawable(document, index)
    if any(_compressed(primitive) is not None for primitive in primitives):
        return None
    surfaces = tuple(PrimitiveStream(document, primitive) for primitive in primitives)
    return MeshStream(surfaces, document.files(), index, document.cache.clear)


def _drawable(document: Document, index: int) -> list[dict[str, Any]]:
    return [primitive for primitive in document.item("meshes", index)["primitives"] if drawable(primitive)]


def _compressed(primitive: dict[str, Any]) -> dict[str, Any] | None:
    extension: dict[str, Any] | None = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    return extension


class PrimitiveStream:
    """See `SurfaceStream`. Its textures are decoded when the material is asked for, not before."""

    shares_vertices = True

    def __init__(self, document: Document, primitive: dict[str, Any]) -> None:
        self._document, self._primitive = document, primitive
        self._accessors: dict[str, int] = {
            name: accessor
            for name, accessor in primitive["attributes"].items()
            if name in ("POSITION", "NORMAL", "COLOR_0") or name.startswith("TEXCOORD_")
        }
        self._indices = primitive.get("indices")
        self._mode = primitive.get("mode", _TRIANGLES)
        self.crease_cosine = CREASE_COSINE if "NORMAL" in self._accessors else ALWAYS_FLAT
        self.vertices = accessor_count(document, self._accessors["POSITION"])
        self._corners = self.vertices if self._indices is None else accessor_count(document, self._indices)
        self.faces = self._corners // 3 if self._mode == _TRIANGLES else max(0, self._corners - 2)

    @property
    def material(self) -> Material:
        """See `SurfaceStream.material`."""
        return self._found.material

    @property
    def warnings(self) -> tuple[str, ...]:
        """See `SurfaceStream.warnings`."""
        return (self._found.warning,) if self._found.warning else ()

    @property
    def _found(self) -> GltfMaterial:
        return material_of(self._document, self._primitive.get("material"))

    def rows(self, start: int, stop: int) -> Vertices:
        """See `SurfaceStream.rows`."""
        attributes = {
            name: accessor_floats(self._document, accessor, start, stop) for name, accessor in self._accessors.items()
        }
        self._document.release()
        return _vertices(attributes, self._found)

    def batches(self) -> Iterator[NDArray[np.int64]]:
        """See `SurfaceStream.batches`."""
        if self._mode == _TRIANGLES:
            for start in range(0, 3 * self.faces, 3 * BATCH):
                yield self._between(start, min(start + 3 * BATCH, 3 * self.faces)).reshape(-1, 3)
        for start in range(0, self.faces if self._mode != _TRIANGLES else 0, BATCH):
            corners = self._between(start, min(start + BATCH, self.faces) + 2)
            if self._mode == _FAN:
                first = np.full(len(corners) - 2, self._between(0, 1)[0])
                yield np.stack([first, corners[1:-1], corners[2:]], -1)
            else:
                # BATCH is even, so that the turned triangles of a strip stay the turned ones.
                yield _strip(corners)

    def _between(self, start: int, stop: int) -> NDArray[np.int64]:
        if self._indices is None:
            return np.arange(start, stop)
        corners = accessor_array(self._document, self._indices, start, stop)[:, 0].astype(np.int64)
        self._document.release()
        return corners


def _strip(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], -1)
    triangles[1::2] = triangles[1::2, ::-1]
    return triangles


def _part(document: Document, primitive: dict[str, Any], where: str) -> Mesh:
    stream = PrimitiveStream(document, primitive)
    extension = _compressed(primitive)
    raw = whole(stream) if extension is None else _decompressed(document, primitive, extension)
    mesh = assemble(replace(raw, colors=visible(raw.colors)), where)
    return replace(mesh, warnings=stream.warnings + mesh.warnings)


def _decompressed(document: Document, primitive: dict[str, Any], extension: dict[str, Any]) -> RawSurface:
    found = material_of(document, primitive.get("material"))
    stored, faces = decode_primitive(document, extension)
    accessors = primitive["attributes"]
    vertices = _vertices({name: _scaled(document, accessors[name], v) for name, v in stored.items()}, found)
    return RawSurface(
        vertices.positions,
        faces.astype(np.int64),
        vertices.normals,
        vertices.uvs,
        vertices.colors,
        (found.material,),
        crease_cosine=ALWAYS_FLAT if vertices.normals is None else CREASE_COSINE,
    )


def _vertices(attributes: dict[str, NDArray[np.float64]], found: GltfMaterial) -> Vertices:
    normals = attributes.get("NORMAL")
    return Vertices(
        positions=_z_up(attributes["POSITION"]),
        normals=None if normals is None else _z_up(normals),
        uvs=_uvs(attributes, found),
        colors=_colors(attributes.get("COLOR_0")),
    )


def _scaled(document: Document, accessor: int, values: NDArray[Any]) -> NDArray[np.float64]:
    if document.item("accessors", accessor).get("normalized", False):
        return normalised(values)
    return values.astype(np.float64)


def _z_up(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3): y up -> z up; x stays."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], -1)


def _uvs(attributes: dict[str, NDArray[np.float64]], found: GltfMaterial) -> NDArray[np.float32] | None:
    uvs = attributes.get(f"TEXCOORD_{found.texcoord}")
    if uvs is None or found.material.texture is None:
        return None
    return transformed_uvs(uvs, found).astype(np.float32)


def _colors(linear: NDArray[np.float64] | None) -> NDArray[np.uint8] | None:
    """glTF's linear vertex colours -> (n, 4) uint8 sRGB with straight alpha."""
    if linear is None:
        return None
    out = np.full((len(linear), 4), 255, np.uint8)
    out[:, :3] = np.floor(srgb_from_linear(np.nan_to_num(linear[:, :3])) * 255 + 0.5)
    if linear.shape[1] == 4:
        out[:, 3] = np.floor(np.clip(np.nan_to_num(linear[:, 3]), 0, 1) * 255 + 0.5)
    return out
