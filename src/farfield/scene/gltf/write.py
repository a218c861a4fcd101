"""Writing a Mesh as GLB: one primitive a material, plain or Draco-compressed, textures as PNG or WebP."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import DracoPy
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.geometry.color import linear_from_srgb
from farfield.scene.model import Material, Mesh, Texture


@dataclass(frozen=True, slots=True)
class GlbOptions:
    """How a GLB is written."""

    draco: bool = False
    position_bits: int = 14
    """Draco: positions are rounded to the longest side / 2**bits."""
    image_format: Literal["PNG", "WEBP"] = "PNG"
    image_quality: int = 85
    """WebP, 0..100."""


@dataclass(slots=True)
class _Builder:
    json: dict[str, Any]
    options: GlbOptions
    chunk: bytearray = field(default_factory=bytearray)
    images: dict[Texture, int] = field(default_factory=dict)

    def view(self, raw: bytes) -> int:
        self.chunk += b"\0" * (-len(self.chunk) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.chunk), "byteLength": len(raw)})
        self.chunk += raw
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray[Any], stored: bool, normalized: bool = False, bounds: bool = False) -> int:
        codes = {"f4": 5126, "u4": 5125, "u1": 5121}
        entry: dict[str, Any] = {
            "componentType": codes[values.dtype.str[1:]],
            "count": len(values),
            "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]],
        }
        if normalized:
            entry["normalized"] = True
        if bounds:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        if stored:
            entry["bufferView"] = self.view(np.ascontiguousarray(values).tobytes())
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1


def write_glb(path: Path, mesh: Mesh, options: GlbOptions | None = None) -> int:
    """Writes the mesh, y up, and returns the bytes of the file. Object numbers are not kept."""
    keys = ("accessors", "bufferViews", "materials", "textures", "images")
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "farfield"}, **{key: [] for key in keys}}
    builder = _Builder(document, options or GlbOptions())
    primitives = [
        _primitive(builder, mesh, k) for k in range(len(mesh.materials)) if (mesh.triangle_material == k).any()
    ]
    document["meshes"] = [{"primitives": primitives}]
    document |= {"nodes": [{"mesh": 0, "name": path.stem}], "scenes": [{"nodes": [0]}], "scene": 0}
    document["buffers"] = [{"byteLength": len(builder.chunk)}]
    raw = _container({key: value for key, value in document.items() if value != []}, bytes(builder.chunk))
    path.write_bytes(raw)
    return len(raw)


def _primitive(builder: _Builder, mesh: Mesh, material: int) -> dict[str, Any]:
    own = mesh.triangles[mesh.triangle_material == material]
    used, corners = np.unique(own, return_inverse=True)
    arrays: dict[str, NDArray[Any]] = {
        "POSITION": _y_up(mesh.positions[used]).astype(np.float32),
        "NORMAL": _y_up(mesh.normals[used]).astype(np.float32),
    }
    if mesh.uvs is not None and mesh.materials[material].texture is not None:
        arrays["TEXCOORD_0"] = mesh.uvs[used].astype(np.float32)
    if mesh.colors is not None:
        arrays["COLOR_0"] = _linear_colors(mesh.colors[used])
    triangles = corners.reshape(-1, 3).astype(np.uint32)
    entry = _material(builder, mesh.materials[material])
    if builder.options.draco:
        return _draco(builder, arrays, triangles) | {"material": entry}
    attributes = {
        name: builder.accessor(values, True, name == "COLOR_0", name == "POSITION") for name, values in arrays.items()
    }
    return {"attributes": attributes, "indices": builder.accessor(triangles.reshape(-1, 1), True), "material": entry}


def _draco(builder: _Builder, arrays: dict[str, NDArray[Any]], triangles: NDArray[np.uint32]) -> dict[str, Any]:
    # DracoPy takes normals and texture coordinates as float64 only, and stores float32.
    uvs = arrays.get("TEXCOORD_0")
    raw = DracoPy.encode(
        arrays["POSITION"], triangles, quantization_bits=builder.options.position_bits, compression_level=7,
        colors=arrays.get("COLOR_0"), tex_coord=None if uvs is None else uvs.astype(np.float64),
        normals=arrays["NORMAL"].astype(np.float64), tex_coord_quantization_bits=12, normal_quantization_bits=10,
    )  # fmt: skip
    decoded = DracoPy.decode(raw)
    kinds = {0: "POSITION", 1: "NORMAL", 2: "COLOR_0", 3: "TEXCOORD_0"}
    ids = {kinds[entry["attribute_type"]]: entry["unique_id"] for entry in decoded.attributes}
    stored = {kinds[entry["attribute_type"]]: entry["data"] for entry in decoded.attributes}
    attributes = {name: builder.accessor(stored[name], False, name == "COLOR_0", name == "POSITION") for name in arrays}
    for key in ("extensionsUsed", "extensionsRequired"):
        builder.json[key] = sorted({*builder.json.get(key, []), "KHR_draco_mesh_compression"})
    indices = builder.accessor(np.asarray(decoded.faces, np.uint32).reshape(-1, 1), False)
    extension = {"bufferView": builder.view(raw), "attributes": ids}
    return {"attributes": attributes, "indices": indices, "extensions": {"KHR_draco_mesh_compression": extension}}


def _material(builder: _Builder, material: Material) -> int:
    pbr: dict[str, Any] = {"baseColorFactor": list(material.base_color), "metallicFactor": 0.0}
    if material.texture is not None:
        pbr["baseColorTexture"] = {"index": _texture(builder, material.texture)}
    entry: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": pbr, "doubleSided": material.double_sided}
    if material.alpha_cutoff is not None:
        entry |= {"alphaMode": "MASK", "alphaCutoff": material.alpha_cutoff}
    if material.unlit:
        entry["extensions"] = {"KHR_materials_unlit": {}}
        builder.json["extensionsUsed"] = sorted({*builder.json.get("extensionsUsed", []), "KHR_materials_unlit"})
    builder.json["materials"].append(entry)
    return len(builder.json["materials"]) - 1


def _texture(builder: _Builder, texture: Texture) -> int:
    if texture in builder.images:
        return builder.images[texture]
    opaque = bool((texture.pixels[..., 3] == 255).all())
    image = Image.fromarray(texture.pixels)
    file, kind = io.BytesIO(), builder.options.image_format
    (image.convert("RGB") if opaque else image).save(file, kind, quality=builder.options.image_quality, method=6)
    source = len(builder.json["images"])
    builder.json["images"].append({"bufferView": builder.view(file.getvalue()), "mimeType": f"image/{kind.lower()}"})
    entry: dict[str, Any] = {"source": source}
    if kind == "WEBP":
        entry = {"extensions": {"EXT_texture_webp": {"source": source}}}
        for key in ("extensionsUsed", "extensionsRequired"):
            builder.json[key] = sorted({*builder.json.get(key, []), "EXT_texture_webp"})
    builder.json["textures"].append(entry)
    builder.images[texture] = len(builder.json["textures"]) - 1
    return builder.images[texture]


def _linear_colors(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """glTF's vertex colours are linear light."""
    out = colors.copy()
    out[:, :3] = np.floor(linear_from_srgb(colors[:, :3] / 255.0) * 255 + 0.5)
    return out


def _y_up(vectors: NDArray[Any]) -> NDArray[Any]:
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], -1)


def _container(document: dict[str, Any], chunk: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunk += b"\0" * (-len(chunk) % 4)
    total = 12 + 8 + len(text) + 8 + len(chunk)
    head = struct.pack("<4sIIII", b"glTF", 2, total, len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(chunk), 0x004E4942) + chunk
