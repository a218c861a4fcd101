"""From a glTF mesh's primitives to one Mesh, z up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import srgb_from_linear
from farfield.scene.cleaning import RawSurface, assemble, merge
from farfield.scene.gltf.accessors import accessor_array, accessor_floats, normalised
from farfield.scene.gltf.container import Document
from farfield.scene.gltf.draco import decode_primitive
from farfield.scene.gltf.materials import GltfMaterial, material_of, transformed_uvs
from farfield.scene.model import Mesh
from farfield.scene.shading import ALWAYS_FLAT, CREASE_COSINE

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def drawable(primitive: dict[str, Any]) -> bool:
    """True for triangles, strips and fans; points and lines are not surfaces."""
    return primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN) and "POSITION" in primitive["attributes"]


def mesh_of(document: Document, index: int, where: str) -> Mesh:
    """All triangles of a glTF mesh. Raises InputError when the file is damaged."""
    entry = document.item("meshes", index)
    parts = [_part(document, primitive, where) for primitive in entry["primitives"] if drawable(primitive)]
    return merge(parts)


def _part(document: Document, primitive: dict[str, Any], where: str) -> Mesh:
    attributes, triangles = _arrays(document, primitive)
    found = material_of(document, primitive.get("material"))
    normals = attributes.get("NORMAL")
    raw = RawSurface(
        positions=_z_up(attributes["POSITION"]),
        triangles=triangles,
        normals=None if normals is None else _z_up(normals),
        uvs=_uvs(attributes, found),
        colors=_colors(attributes.get("COLOR_0")),
        materials=(found.material,),
        crease_cosine=ALWAYS_FLAT if normals is None else CREASE_COSINE,
    )
    mesh = assemble(raw, where)
    return replace(mesh, warnings=(found.warning, *mesh.warnings)) if found.warning else mesh


def _arrays(document: Document, primitive: dict[str, Any]) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.int64]]:
    """Attributes as (n, k) float64, and (m, 3) triangles."""
    accessors = primitive["attributes"]
    compressed = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
    if compressed is not None:
        stored, faces = decode_primitive(document, compressed)
        scaled = {name: _scaled(document, accessors[name], values) for name, values in stored.items()}
        return scaled, faces.astype(np.int64)
    wanted = [name for name in accessors if name in ("POSITION", "NORMAL", "COLOR_0") or name.startswith("TEXCOORD_")]
    attributes = {name: accessor_floats(document, accessors[name]) for name in wanted}
    if "indices" in primitive:
        corners = accessor_array(document, primitive["indices"])[:, 0].astype(np.int64)
    else:
        corners = np.arange(len(attributes["POSITION"]))
    return attributes, _triangles(corners, primitive.get("mode", _TRIANGLES))


def _scaled(document: Document, accessor: int, values: NDArray[Any]) -> NDArray[np.float64]:
    if document.item("accessors", accessor).get("normalized", False):
        return normalised(values)
    return values.astype(np.float64)


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(m, 3): triangles of a list, strip or fan of corners."""
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == _FAN:
        return np.stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]], -1)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], -1)
    strip[1::2] = strip[1::2, ::-1]
    return strip


def _z_up(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3): y up -> z up; x stays."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], -1)


def _uvs(attributes: dict[str, NDArray[np.float64]], found: GltfMaterial) -> NDArray[np.float32] | None:
    uvs = attributes.get(f"TEXCOORD_{found.texcoord}")
    if uvs is None or found.material.texture is None:
        return None
    return transformed_uvs(uvs, found).astype(np.float32)


def _colors(linear: NDArray[np.float64] | None) -> NDArray[np.uint8] | None:
    """glTF's linear vertex colours -> (n, 4) uint8 sRGB with straight alpha; None when they are all white."""
    if linear is None:
        return None
    out = np.full((len(linear), 4), 255, np.uint8)
    out[:, :3] = np.floor(srgb_from_linear(np.nan_to_num(linear[:, :3])) * 255 + 0.5)
    if linear.shape[1] == 4:
        out[:, 3] = np.floor(np.clip(np.nan_to_num(linear[:, 3]), 0, 1) * 255 + 0.5)
    return None if (out == 255).all() else out
