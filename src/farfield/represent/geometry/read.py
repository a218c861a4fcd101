"""Reading near geometry back: the subset of GLB that `write` makes."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.errors import CorruptTileError
from farfield.geometry.color import srgb_from_linear
from farfield.represent.geometry.write import PlacedMesh
from farfield.scene.model import Material, Mesh, Texture

_KIND = {5126: "<f4", 5125: "<u4", 5123: "<u2", 5121: "u1", 5120: "i1"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_HINT = "run farfield verify"

TextureReader = Callable[[str], Texture]
"""Texture of a hash."""


@dataclass(frozen=True, slots=True)
class LeafGeometry:
    """Near geometry of one leaf."""

    mesh: Mesh | None
    """The leaf's own triangles, metres relative to its lower corner; objects are scene ids."""
    placed: tuple[PlacedMesh, ...]
    """Instances of shared meshes that reach into it."""


def read_leaf_glb(data: bytes, where: str, texture: TextureReader) -> LeafGeometry:
    """Reads a leaf's GLB. Raises CorruptTileError."""
    with _Damage(where):
        glb = _Glb(data)
        listed = glb.json["scenes"][0]["extras"]["farfield"]["instances"]
        placed = tuple(
            PlacedMesh(
                str(item["mesh"]), _rows(glb.accessor(item["transforms"])), glb.accessor(item["objects"]).ravel()
            )
            for item in listed
        )
        return LeafGeometry(glb.mesh(texture) if "meshes" in glb.json else None, placed)


def read_mesh_glb(data: bytes, where: str, texture: TextureReader) -> Mesh:
    """Reads a shared mesh. Raises CorruptTileError."""
    with _Damage(where):
        return _Glb(data).mesh(texture)


def decode_texture(data: bytes, where: str) -> Texture:
    """Reads an image. Raises CorruptTileError."""
    with _Damage(where), Image.open(io.BytesIO(data)) as image:
        return Texture(np.asarray(image.convert("RGBA")))


class _Damage:
    """Turns whatever a damaged file provokes into CorruptTileError."""

    def __init__(self, where: str) -> None:
        self._where = where

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        faults = (ValueError, KeyError, IndexError, TypeError, struct.error, OSError, AttributeError, MemoryError)
        if isinstance(error, faults):
            raise CorruptTileError(f"near geometry is damaged: {error}", self._where, _HINT) from None


class _Glb:
    def __init__(self, data: bytes) -> None:
        magic, version, total, length, _ = struct.unpack_from("<4sIIII", data)
        if magic != b"glTF" or version != 2 or total != len(data):
            raise ValueError("not a GLB of that length")
        self.json: dict[str, Any] = json.loads(data[20 : 20 + length])
        self._body = data[28 + length :]

    def accessor(self, index: int) -> NDArray[Any]:
        """(n, k) values."""
        facts = self.json["accessors"][index]
        view = self.json["bufferViews"][facts["bufferView"]]
        width, kind = _WIDTH[facts["type"]], np.dtype(_KIND[facts["componentType"]])
        stride = view.get("byteStride", width * kind.itemsize)
        raw = np.frombuffer(self._body, np.uint8, view["byteLength"], view["byteOffset"])
        if facts["count"] * stride > len(raw):
            raise ValueError("an accessor ends beyond its view")
        rows = raw[: facts["count"] * stride].reshape(facts["count"], stride)[:, : width * kind.itemsize]
        return np.ascontiguousarray(rows).view(kind)

    def mesh(self, texture: TextureReader) -> Mesh:
        """All primitives as one mesh; attributes that some lack are filled with neutral values."""
        primitives = self.json["meshes"][0]["primitives"]
        parts = [self._primitive(p) for p in primitives]
        offsets = np.cumsum([0, *(len(p["positions"]) for p in parts)])
        triangles = [p["triangles"] + np.uint32(o) for p, o in zip(parts, offsets[:-1], strict=True)]
        number = np.repeat(np.arange(len(parts), dtype=np.uint16), [len(t) for t in triangles])
        objects = np.concatenate([p["objects"] for p in parts])
        return Mesh(
            positions=np.concatenate([p["positions"] for p in parts]).astype(np.float64),
            triangles=np.concatenate(triangles),
            normals=np.concatenate([p["normals"] for p in parts]),
            materials=tuple(self._material(p["material"], texture) for p in primitives),
            triangle_material=number,
            uvs=_joined(parts, "uvs", np.zeros((1, 2), np.float32)),
            colors=_joined(parts, "colors", np.full((1, 4), 255, np.uint8)),
            triangle_object=objects,
            object_count=int(objects.max(initial=0)) + 1,
        )

    def _primitive(self, primitive: dict[str, Any]) -> dict[str, Any]:
        names = primitive["attributes"]
        triangles = self.accessor(primitive["indices"]).reshape(-1, 3).astype(np.uint32)
        positions = self.accessor(names["POSITION"])
        if len(triangles) and int(triangles.max()) >= len(positions):
            raise ValueError("an index beyond the vertices")
        normals = np.maximum(self.accessor(names["NORMAL"]).astype(np.float32) / 127, -1)
        ids = self.accessor(names["_FEATURE_ID_0"]).ravel()
        colors = self.accessor(names["COLOR_0"]) if "COLOR_0" in names else None
        return {
            "positions": positions,
            "triangles": triangles,
            "normals": normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6),
            "objects": ids[triangles[:, 0]].astype(np.uint32),
            "uvs": self.accessor(names["TEXCOORD_0"]) if "TEXCOORD_0" in names else None,
            "colors": None if colors is None else _srgb8(colors),
        }

    def _material(self, index: int, texture: TextureReader) -> Material:
        facts = self.json["materials"][index]
        surface = facts["pbrMetallicRoughness"]
        r, g, b, a = surface["baseColorFactor"]
        image = None
        if "baseColorTexture" in surface:
            source = self.json["textures"][surface["baseColorTexture"]["index"]]["source"]
            image = texture(self.json["images"][source]["uri"].rsplit("/", 1)[-1])
        cutoff = float(facts["alphaCutoff"]) if facts.get("alphaMode") == "MASK" else None
        unlit = "KHR_materials_unlit" in facts.get("extensions", {})
        return Material("", (r, g, b, a), image, cutoff, bool(facts.get("doubleSided")), unlit)


def _joined(parts: list[dict[str, Any]], name: str, neutral: NDArray[Any]) -> NDArray[Any] | None:
    if all(p[name] is None for p in parts):
        return None
    filled = [p[name] if p[name] is not None else np.repeat(neutral, len(p["positions"]), 0) for p in parts]
    return np.concatenate(filled)


def _srgb8(colors: NDArray[np.uint16]) -> NDArray[np.uint8]:
    rgb = np.round(srgb_from_linear(colors[:, :3] / 65535.0) * 255)
    return np.concatenate([rgb, colors[:, 3:] / 257], 1).astype(np.uint8)


def _rows(columns: NDArray[np.float32]) -> NDArray[np.float64]:
    return columns.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3].astype(np.float64)
