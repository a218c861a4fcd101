"""Writing GLB files: one binary chunk, accessors, materials. Only what near geometry needs."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Material

_COMPONENT = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121, "i1": 5120}
_TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
VERTEX_TARGET, INDEX_TARGET = 34962, 34963

Z_UP_TO_Y_UP = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""Columns first: turns local z up into glTF's y up."""


class GlbWriter:
    """Collects accessors and JSON, then packs them."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "farfield"}, "scene": 0}
        self._body = bytearray()
        self._images: dict[str, int] = {}

    def accessor(self, values: NDArray[Any], target: int | None = None, normalized: bool = False) -> int:
        """Adds (n,) or (n, k) values of a glTF component type; returns the accessor's index."""
        table = values.reshape(len(values), -1)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._body)}
        raw = np.ascontiguousarray(table).tobytes()
        stride = table.shape[1] * table.itemsize
        if target == VERTEX_TARGET and stride % 4:
            padded = np.zeros((len(table), (stride + 3) // 4 * 4), np.uint8)
            padded[:, :stride] = np.frombuffer(raw, np.uint8).reshape(len(table), stride)
            raw, view["byteStride"] = padded.tobytes(), padded.shape[1]
        view["byteLength"] = len(raw)
        if target is not None:
            view["target"] = target
        self._body += raw + b"\0" * (-len(raw) % 4)
        self._list("bufferViews").append(view)
        facts: dict[str, Any] = {
            "bufferView": len(self._list("bufferViews")) - 1,
            "componentType": _COMPONENT[table.dtype.str[1:]],
            "count": len(table),
            "type": _TYPE[table.shape[1]],
        }
        if normalized:
            facts["normalized"] = True
        self._list("accessors").append(facts)
        return len(self._list("accessors")) - 1

    def positions(self, values: NDArray[np.float32]) -> int:
        """Accessor of (n, 3) float32 positions, with the bounds that glTF demands."""
        index = self.accessor(values, VERTEX_TARGET)
        self._list("accessors")[index] |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return index

    def material(self, material: Material, texture_uri: str | None) -> int:
        """Adds a material; returns its index."""
        surface: dict[str, Any] = {
            "baseColorFactor": [float(c) for c in material.base_color],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        }
        if texture_uri is not None:
            surface["baseColorTexture"] = {"index": self._texture(texture_uri)}
        facts: dict[str, Any] = {"pbrMetallicRoughness": surface, "doubleSided": material.double_sided}
        if material.alpha_cutoff is not None:
            facts |= {"alphaMode": "MASK", "alphaCutoff": float(material.alpha_cutoff)}
        if material.unlit:
            facts["extensions"] = {"KHR_materials_unlit": {}}
            self.uses("KHR_materials_unlit")
        self._list("materials").append(facts)
        return len(self._list("materials")) - 1

    def uses(self, extension: str) -> None:
        """Declares an extension."""
        used = self._list("extensionsUsed")
        if extension not in used:
            used.append(extension)

    def pack(self) -> bytes:
        """The file."""
        if self._body:
            self.json["buffers"] = [{"byteLength": len(self._body)}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if self._body:
            chunks += struct.pack("<I4s", len(self._body), b"BIN\0") + bytes(self._body)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _texture(self, uri: str) -> int:
        if uri not in self._images:
            self._list("images").append({"uri": uri})
            self._list("textures").append({"source": len(self._list("images")) - 1})
            self._images[uri] = len(self._list("textures")) - 1
        return self._images[uri]

    def _list(self, name: str) -> list[Any]:
        found = self.json.setdefault(name, [])
        assert isinstance(found, list)
        return found
