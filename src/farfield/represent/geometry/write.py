"""Leaves and shared meshes as GLB."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.octree.grid import CellKey
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.glb import INDEX_TARGET, VERTEX_TARGET, Z_UP_TO_Y_UP, GlbWriter
from farfield.scene.model import Material, Texture

_LEAF_TEXTURES = "../../../../texture/"
_MESH_TEXTURES = "../texture/"


@dataclass(frozen=True, slots=True)
class PlacedMesh:
    """Instances of one shared mesh that reach into a leaf."""

    mesh: str
    """Hash of the mesh's GLB."""
    transforms: NDArray[np.float64]
    """(k, 3, 4) float64 from the mesh's frame to the leaf's."""
    objects: NDArray[np.uint32]
    """(k,) uint32 object id of the mesh's object 0."""


def encode_texture(texture: Texture) -> bytes:
    """WebP of quality 90; alpha is kept exactly."""
    opaque = bool((texture.pixels[..., 3] == 255).all())
    image = Image.fromarray(texture.pixels[..., :3] if opaque else texture.pixels)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=90, method=4, exact=True)
    return out.getvalue()


def leaf_glb(
    cell: CellKey,
    chunk: Chunk | None,
    materials: Sequence[Material],
    placed: Sequence[PlacedMesh],
    texture_hash: Callable[[Texture], str],
) -> bytes:
    """GLB of a leaf: its own triangles (positions relative to the lower corner) and its list of instances."""
    writer = GlbWriter()
    notes: dict[str, Any] = {"cell": str(cell)}
    nodes = []
    if chunk is not None:
        # Features are numbered within the file: a float32, which glTF has for them, tells only 2^24 numbers apart.
        ids, numbers = np.unique(chunk.objects, return_inverse=True)
        numbered = replace(chunk, objects=numbers.astype(np.uint32))
        nodes = _add_mesh(writer, numbered, materials, lambda t: _LEAF_TEXTURES + texture_hash(t))
        notes["objects"] = writer.accessor(ids.astype(np.uint32))
    notes["instances"] = [
        {
            "mesh": p.mesh,
            "transforms": writer.accessor(_columns(p.transforms)),
            "objects": writer.accessor(p.objects.astype(np.uint32)),
        }
        for p in placed
    ]
    writer.json["scenes"] = [{"nodes": nodes, "extras": {"farfield": notes}}]
    return writer.pack()


def mesh_glb(chunk: Chunk, materials: Sequence[Material], texture_hash: Callable[[Texture], str]) -> bytes:
    """GLB of a shared mesh, in its own frame, z up below the root node."""
    writer = GlbWriter()
    nodes = _add_mesh(writer, chunk, materials, lambda t: _MESH_TEXTURES + texture_hash(t))
    writer.json["scenes"] = [{"nodes": nodes}]
    return writer.pack()


def _add_mesh(
    writer: GlbWriter, chunk: Chunk, materials: Sequence[Material], uri: Callable[[Texture], str]
) -> list[int]:
    writer.uses("EXT_mesh_features")
    primitives = []
    for number in np.unique(chunk.materials):
        material = materials[int(number)]
        texture = material.texture
        index = writer.material(material, None if texture is None else uri(texture))
        primitives.append(_primitive(writer, chunk, chunk.materials == number, index))
    writer.json["meshes"] = [{"primitives": primitives}]
    writer.json["nodes"] = [{"mesh": 0, "matrix": Z_UP_TO_Y_UP}]
    return [0]


def _primitive(writer: GlbWriter, chunk: Chunk, chosen: NDArray[np.bool_], material: int) -> dict[str, Any]:
    """One primitive; a vertex shared by triangles of two objects is doubled so that it has one feature id."""
    corners = chunk.triangles[chosen].astype(np.int64)
    ids = np.repeat(chunk.objects[chosen].astype(np.int64), 3)
    keys, triangles = np.unique(corners.ravel() + (ids << 32), return_inverse=True)
    vertices, owners = keys & 0xFFFFFFFF, keys >> 32
    normals = np.round(chunk.normals[vertices] * 127).astype(np.int8)
    attributes = {
        "POSITION": writer.positions(chunk.positions[vertices].astype(np.float32)),
        "NORMAL": writer.accessor(normals, VERTEX_TARGET, normalized=True),
        "_FEATURE_ID_0": writer.accessor(owners.astype(np.float32), VERTEX_TARGET),
    }
    writer.uses("KHR_mesh_quantization")
    if len(chunk.uvs):
        attributes["TEXCOORD_0"] = writer.accessor(chunk.uvs[vertices].astype(np.float32), VERTEX_TARGET)
    if len(chunk.colors):
        attributes["COLOR_0"] = writer.accessor(_linear16(chunk.colors[vertices]), VERTEX_TARGET, normalized=True)
    kind = np.uint16 if len(vertices) < 65535 else np.uint32
    return {
        "attributes": attributes,
        "indices": writer.accessor(triangles.astype(kind), INDEX_TARGET),
        "material": material,
        "extensions": {"EXT_mesh_features": {"featureIds": [{"featureCount": len(np.unique(owners)), "attribute": 0}]}},
    }


def _linear16(colors: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """glTF vertex colours are linear light; 16 bits keep the darkest sRGB bytes apart."""
    rgb = np.round(LINEAR_OF_BYTE[colors[:, :3]] * 65535)
    return np.concatenate([rgb, colors[:, 3:].astype(np.float32) * 257], 1).astype(np.uint16)


def _columns(transforms: NDArray[np.float64]) -> NDArray[np.float32]:
    full = np.zeros((len(transforms), 4, 4), np.float64)
    full[:, :3] = transforms
    full[:, 3, 3] = 1
    return full.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
