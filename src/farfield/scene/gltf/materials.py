"""glTF materials: base colour, texture and its transform, alpha, sides, unlit."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.gltf.container import Document
from farfield.scene.model import Material, Texture
from farfield.scene.textures import decode_image

BLEND_CUTOFF = 0.5
"""Blended surfaces are drawn as masked at this alpha: a picture with depth holds one surface a pixel."""

DEFAULT = Material(double_sided=False)


@dataclass(frozen=True, slots=True)
class GltfMaterial:
    """A material, and how its texture finds its coordinates."""

    material: Material
    texcoord: int = 0
    uv_matrix: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """KHR_texture_transform as (2, 3), or None."""
    warning: str = ""
    """Why the texture is missing, or empty."""


def material_of(document: Document, index: int | None) -> GltfMaterial:
    """The material of a primitive; decoded once a document. A texture that cannot be read becomes a warning."""
    if index is None:
        return GltfMaterial(DEFAULT)
    if ("material", index) not in document.cache:
        document.cache["material", index] = _read(document, document.item("materials", index))
    found: GltfMaterial = document.cache["material", index]
    return found


def transformed_uvs(uvs: NDArray[np.float64], found: GltfMaterial) -> NDArray[np.float64]:
    """(n, 2): texture coordinates after KHR_texture_transform."""
    if found.uv_matrix is None:
        return uvs
    matrix = np.array(found.uv_matrix)
    moved: NDArray[np.float64] = uvs @ matrix[:, :2].T + matrix[:, 2]
    return moved


def _read(document: Document, entry: dict[str, Any]) -> GltfMaterial:
    pbr, factor_key, texture_key = entry.get("pbrMetallicRoughness", {}), "baseColorFactor", "baseColorTexture"
    extensions = entry.get("extensions", {})
    if "KHR_materials_pbrSpecularGlossiness" in extensions:
        pbr = extensions["KHR_materials_pbrSpecularGlossiness"]
        factor_key, texture_key = "diffuseFactor", "diffuseTexture"
    slot = pbr.get(texture_key)
    texture, warning = (None, "") if slot is None else _texture(document, slot["index"])
    transform = {} if slot is None else slot.get("extensions", {}).get("KHR_texture_transform", {})
    red, green, blue, alpha = (float(value) for value in pbr.get(factor_key, (1, 1, 1, 1)))
    material = Material(
        name=str(entry.get("name", "")),
        base_color=(red, green, blue, alpha),
        texture=texture,
        alpha_cutoff=_cutoff(entry),
        double_sided=bool(entry.get("doubleSided", False)),
        unlit="KHR_materials_unlit" in extensions,
    )
    texcoord = 0 if slot is None else int(transform.get("texCoord", slot.get("texCoord", 0)))
    return GltfMaterial(material, texcoord, _uv_matrix(transform), warning)


def _cutoff(entry: dict[str, Any]) -> float | None:
    mode = entry.get("alphaMode", "OPAQUE")
    if mode == "MASK":
        return float(entry.get("alphaCutoff", 0.5))
    return BLEND_CUTOFF if mode == "BLEND" else None


def _uv_matrix(transform: dict[str, Any]) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """Scale, then rotate (counter-clockwise with v downwards), then offset."""
    if not {"offset", "rotation", "scale"} & transform.keys():
        return None
    (u, v), (a, b) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    angle = float(transform.get("rotation", 0))
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return (c * a, s * b, float(u)), (-s * a, c * b, float(v))


def _texture(document: Document, index: int) -> tuple[Texture | None, str]:
    entry = document.item("textures", index)
    webp = entry.get("extensions", {}).get("EXT_texture_webp", {})
    source = webp.get("source", entry.get("source"))
    if source is None:
        return None, f"{document.where}: texture {index} is in a format that is not read; its material's colour is used"
    if ("image", source) not in document.cache:
        document.cache["image", source] = _image(document, source)
    found: tuple[Texture | None, str] = document.cache["image", source]
    return found


def _image(document: Document, index: int) -> tuple[Texture | None, str]:
    entry = document.item("images", index)
    uri = entry.get("uri", "")
    try:
        raw = document.resource(uri) if uri else document.view_bytes(entry["bufferView"])
        return decode_image(io.BytesIO(raw.tobytes()), document.where), ""
    except InputError as error:
        label = uri if uri and not uri.startswith("data:") else f"image {index}"
        return None, f"{document.where}: texture {label}: {error.what}; its material's colour is used"
