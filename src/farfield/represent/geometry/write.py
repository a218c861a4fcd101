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
from farfield.packed import pack
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.dictionary import DICTIONARY
from farfield.represent.geometry.draco import NORMAL_BITS, Lattice, Vertices, compress
from farfield.represent.geometry.glb import Z_UP_TO_Y_UP, GlbWriter
from farfield.scene.model import Material, Texture

MAGIC = b"FFGL"
"""Of a GLB that is deflated: three quarters of a small leaf are its JSON otherwise."""
LEAF_BITS = 16
"""Of positions in a leaf: at 512 pixels steps of 1/128 of a pixel's pitch, 1 mm in a leaf of 64 m."""
_TEXEL_STEPS = 4
"""Of texture coordinates in a texel."""
_FEWEST_BITS, _MOST_BITS = 10, 20
MOST_TRIANGLES = 1 << 17
"""Of a primitive: Draco finds equal vertices by a hash that degrades with many. A bake of a million buildings in one
leaf was in such calls for 13 minutes when it was stopped; in 194 pieces all of its forms take 77 s, none above 2."""
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


@dataclass(frozen=True, slots=True)
class _Rounding:
    """What vertices are rounded to."""

    lattice: Lattice
    """Of positions."""
    normal_bits: int = NORMAL_BITS
    """Of each coordinate of a normal's octahedron."""


def encode_texture(texture: Texture) -> bytes:
    """WebP of quality 80, which takes three fifths of the bytes of 90; alpha is kept exactly."""
    opaque = bool((texture.pixels[..., 3] == 255).all())
    image = Image.fromarray(texture.pixels[..., :3] if opaque else texture.pixels)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=80, method=4, exact=True)
    return out.getvalue()


def leaf_glb(
    cell: CellKey,
    size: float,
    chunk: Chunk | None,
    materials: Sequence[Material],
    placed: Sequence[PlacedMesh],
    image: Callable[[Material], str],
    *,
    bits: int = LEAF_BITS,
    normal_bits: int = NORMAL_BITS,
) -> bytes:
    """Packed GLB of a cell: its own triangles (positions relative to the lower corner) and its list of instances.

    size: of the cell, metres. image: hash of a material's image. bits: of positions. normal_bits: of each coordinate of
    a normal's octahedron. All leaves round positions alike, and all cells of a level, so what they share at their walls
    stays together.
    """
    writer = GlbWriter()
    notes: dict[str, Any] = {"cell": str(cell)}
    nodes = []
    if chunk is not None:
        # Features are numbered within the file: a float32, which glTF has for them, tells only 2^24 numbers apart.
        ids, numbers = np.unique(chunk.objects, return_inverse=True)
        numbered = replace(chunk, objects=numbers.astype(np.uint32))
        rounding = _Rounding(Lattice((0.0, 0.0, 0.0), size, bits), normal_bits)
        nodes = _add_mesh(writer, numbered, materials, rounding, lambda one: _LEAF_TEXTURES + image(one))
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
    return pack(MAGIC, *writer.pack(), dictionary=DICTIONARY)


def mesh_glb(
    chunk: Chunk,
    step: float,
    materials: Sequence[Material],
    image: Callable[[Material], str],
    *,
    normal_bits: int = NORMAL_BITS,
) -> bytes:
    """Packed GLB of a shared mesh, in its own frame, z up below the root node.

    step: metres that positions are rounded to, at most. normal_bits: of each coordinate of a normal's octahedron.
    """
    lower, upper = chunk.bounds.astype(np.float64)
    size = float(max((upper - lower).max(), step))
    rounding = _Rounding(Lattice((lower[0], lower[1], lower[2]), size, _bits(size / step)), normal_bits)
    writer = GlbWriter()
    nodes = _add_mesh(writer, chunk, materials, rounding, lambda one: _MESH_TEXTURES + image(one))
    writer.json["scenes"] = [{"nodes": nodes}]
    return pack(MAGIC, *writer.pack(), dictionary=DICTIONARY)


def _add_mesh(
    writer: GlbWriter, chunk: Chunk, materials: Sequence[Material], rounding: _Rounding, uri: Callable[[Material], str]
) -> list[int]:
    writer.uses("EXT_mesh_features")
    primitives = []
    a, b, c = chunk.triangles.T
    # Draco refuses triangles of fewer than three vertices, all of a primitive for one.
    whole = (a != b) & (b != c) & (c != a)
    for number in np.unique(chunk.materials[whole]):
        chosen = np.flatnonzero(whole & (chunk.materials == number))
        material = materials[int(number)]
        index = writer.material(material, None if material.texture is None else uri(material))
        for piece in np.array_split(chosen, -(-len(chosen) // MOST_TRIANGLES)):
            primitives.append(_primitive(writer, chunk, piece, material, rounding) | {"material": index})
    if not primitives:
        return []
    writer.json["meshes"] = [{"primitives": primitives}]
    writer.json["nodes"] = [{"mesh": 0, "matrix": Z_UP_TO_Y_UP}]
    return [0]


def _primitive(
    writer: GlbWriter, chunk: Chunk, chosen: NDArray[np.int64], material: Material, rounding: _Rounding
) -> dict[str, Any]:
    """One primitive; a vertex shared by triangles of two objects is doubled so that it has one feature id."""
    corners = chunk.triangles[chosen].astype(np.int64)
    ids = np.repeat(chunk.objects[chosen].astype(np.int64), 3)
    keys, triangles = np.unique(corners.ravel() + (ids << 32), return_inverse=True)
    vertices, owners = keys & 0xFFFFFFFF, keys >> 32
    texture = material.texture if len(chunk.uvs) else None
    uvs = None if texture is None else chunk.uvs[vertices].astype(np.float32)
    colors = chunk.colors[vertices] if len(chunk.colors) else chunk.colors
    uv_bits = 0
    if texture is not None and uvs is not None:
        uv_bits = _bits(float(np.ptp(uvs, axis=0).max()) * max(texture.pixels.shape[:2]) * _TEXEL_STEPS)
    packed = compress(
        Vertices(
            chunk.positions[vertices].astype(np.float32),
            chunk.normals[vertices],
            owners.astype(np.uint32),
            uvs,
            _linear16(colors) if (colors != 255).any() else None,
        ),
        triangles.reshape(-1, 3).astype(np.uint32),
        rounding.lattice,
        uv_bits,
        rounding.normal_bits,
    )
    primitive = writer.compressed(packed)
    feature = {"attribute": 0, "featureCount": len(np.unique(owners))}
    primitive["extensions"]["EXT_mesh_features"] = {"featureIds": [feature]}
    return primitive


def _bits(steps: float) -> int:
    """Of coordinates that have so many steps."""
    return int(np.clip(np.ceil(np.log2(max(steps, 1.0) + 1)), _FEWEST_BITS, _MOST_BITS))


def _linear16(colors: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """glTF vertex colours are linear light; 16 bits keep the darkest sRGB bytes apart."""
    rgb = np.round(LINEAR_OF_BYTE[colors[:, :3]] * 65535)
    return np.concatenate([rgb, colors[:, 3:].astype(np.float32) * 257], 1).astype(np.uint16)


def _columns(transforms: NDArray[np.float64]) -> NDArray[np.float32]:
    full = np.zeros((len(transforms), 4, 4), np.float64)
    full[:, :3] = transforms
    full[:, 3, 3] = 1
    return full.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
