"""Meshes as GLB files that name their textures by address, so that tiles share them; and putting meshes together."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.gltf.read import read_gltf
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.model import Material, Mesh, Texture

HEAD = struct.Struct("<4sIIII")
"""Magic, version, length, and length and kind of the JSON chunk."""


def write(path: Path, mesh: Mesh, addresses: Mapping[str, str]) -> None:
    """Writes a mesh. addresses: material name -> address of its texture, relative to the file."""
    named = tuple(_marked(material, k) for k, material in enumerate(mesh.materials))
    write_glb(path, replace(mesh, materials=named), GlbOptions())
    document, binary = read_document(path)
    for image, material in zip(document.get("images", []), _textured(document), strict=True):
        image.pop("bufferView")
        image |= {"uri": addresses[material["name"]], "mimeType": "image/webp"}
    write_document(path, document, binary)


def read(path: Path) -> Mesh:
    """All meshes of a file as one."""
    scene = read_gltf(path)
    parts = []
    for mesh, transform in zip(scene.instances.mesh, scene.instances.transform, strict=True):
        parts.append(placed(scene.meshes[int(mesh)].load(), transform))
    return joined(parts)


def placed(mesh: Mesh, transform: NDArray[np.float64]) -> Mesh:
    """A copy of a mesh, transformed by (3, 4): turned, shifted and evenly scaled."""
    normals = mesh.normals @ transform[:, :3].T
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    positions = mesh.positions @ transform[:, :3].T + transform[:, 3]
    return replace(mesh, positions=positions, normals=normals.astype(np.float32))


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Several meshes as one; materials of one name are taken to be the same."""
    materials: dict[str, Material] = {}
    for part in parts:
        materials |= {material.name: material for material in part.materials}
    row = {name: k for k, name in enumerate(materials)}
    before = np.cumsum([0, *(len(part.positions) for part in parts)])
    triangles = [part.triangles + start for part, start in zip(parts, before[:-1], strict=True)]
    own = [np.array([row[m.name] for m in part.materials], np.uint16)[part.triangle_material] for part in parts]
    with_uvs = any(part.uvs is not None for part in parts)
    with_colors = any(part.colors is not None for part in parts)
    return Mesh(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=np.concatenate(triangles).astype(np.uint32),
        normals=np.concatenate([part.normals for part in parts]),
        materials=tuple(materials.values()),
        triangle_material=np.concatenate(own),
        uvs=np.concatenate([_or(part.uvs, part, 2, 0) for part in parts]).astype(np.float32) if with_uvs else None,
        colors=np.concatenate([_or(part.colors, part, 4, 255) for part in parts]) if with_colors else None,
    )


def subset(mesh: Mesh, chosen: NDArray[np.bool_]) -> Mesh:
    """Some triangles of a mesh."""
    used, corners = np.unique(mesh.triangles[chosen], return_inverse=True)
    return replace(
        mesh,
        positions=mesh.positions[used],
        triangles=corners.reshape(-1, 3).astype(np.uint32),
        normals=mesh.normals[used],
        triangle_material=mesh.triangle_material[chosen],
        uvs=None if mesh.uvs is None else mesh.uvs[used],
        colors=None if mesh.colors is None else mesh.colors[used],
        triangle_object=None if mesh.triangle_object is None else mesh.triangle_object[chosen],
    )


def read_document(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk of a GLB file."""
    raw = path.read_bytes()
    length = HEAD.unpack_from(raw)[3]
    rest = raw[HEAD.size + length :]
    return json.loads(raw[HEAD.size : HEAD.size + length]), rest[8:]


def write_document(path: Path, document: dict[str, Any], binary: bytes) -> None:
    """The other way round."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = HEAD.size + len(text) + 8 + len(binary)
    head = HEAD.pack(b"glTF", 2, total, len(text), 0x4E4F534A)
    path.write_bytes(head + text + struct.pack("<II", len(binary), 0x004E4942) + binary)


def _marked(material: Material, number: int) -> Material:
    """With a pixel of its own in place of the texture, so that no two are taken for the same."""
    if material.texture is None:
        return material
    return replace(material, texture=Texture(np.full((1, 1, 4), (number, 0, 0, 255), np.uint8)))


def _textured(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Materials with a texture, in the order of their images."""
    return [m for m in document["materials"] if "baseColorTexture" in m["pbrMetallicRoughness"]]


def _or(values: NDArray[Any] | None, part: Mesh, width: int, otherwise: int) -> NDArray[Any]:
    return np.full((len(part.positions), width), otherwise, np.uint8) if values is None else values
