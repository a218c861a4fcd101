"""Writing GLB files: one binary chunk, accessors, materials. Only what near geometry needs.

Members stand in the order in which the dictionary has them (`dictionary`), and numbers have no more digits than tell
something: most of a coarse mesh would be its JSON otherwise.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.represent.geometry.draco import Compressed
from farfield.scene.model import Material

_COMPONENT = {"f4": 5126, "u4": 5125, "u2": 5123}
_TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_DRACO = "KHR_draco_mesh_compression"
_UNPACKED: dict[str, dict[str, Any]] = {
    "POSITION": {"componentType": 5126, "type": "VEC3"},
    "NORMAL": {"componentType": 5126, "type": "VEC3"},
    "TEXCOORD_0": {"componentType": 5126, "type": "VEC2"},
    "COLOR_0": {"componentType": 5123, "type": "VEC4", "normalized": True},
    "_FEATURE_ID_0": {"componentType": 5123, "type": "SCALAR"},
}
"""What attributes of compressed primitives are when they have been unpacked."""

_ORDER = (
    "asset", "extensionsUsed", "extensionsRequired", "scene", "nodes", "meshes", "materials", "textures", "images",
    "accessors", "bufferViews", "buffers", "scenes",
)  # fmt: skip
_COLOR_DIGITS = 3
"""Significant ones of a base colour, linear light: off by at most a fifth of a step of an sRGB byte."""

Z_UP_TO_Y_UP = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""Columns first: turns local z up into glTF's y up."""


class GlbWriter:
    """Collects accessors and JSON, then packs them."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "farfield"}, "scene": 0}
        self._body = bytearray()
        self._images: dict[str, int] = {}

    def accessor(self, values: NDArray[Any]) -> int:
        """Adds (n,) or (n, k) values of a glTF component type; returns the accessor's index."""
        table = values.reshape(len(values), -1)
        facts = {
            "componentType": _COMPONENT[table.dtype.str[1:]],
            "type": _TYPE[table.shape[1]],
            "count": len(table),
            "bufferView": self._view(np.ascontiguousarray(table).tobytes()),
        }
        return self._added("accessors", facts)

    def compressed(self, found: Compressed) -> dict[str, Any]:
        """Adds the data of a primitive; returns what the primitive says of them."""
        for extension in ("extensionsUsed", "extensionsRequired"):
            self.uses(_DRACO, extension)
        attributes = {}
        for name in found.ids:
            facts = _UNPACKED[name] | {"count": found.vertices}
            if name == "POSITION":
                facts |= dict(zip(("min", "max"), _outward(found.bounds, found.step), strict=True))
            if name == "_FEATURE_ID_0" and found.wide:
                facts["componentType"] = 5126
            attributes[name] = self._added("accessors", facts)
        indices = {"componentType": 5125, "type": "SCALAR", "count": 3 * found.triangles}
        return {
            "attributes": attributes,
            "indices": self._added("accessors", indices),
            "extensions": {_DRACO: {"bufferView": self._view(found.data), "attributes": dict(found.ids)}},
        }

    def material(self, material: Material, texture_uri: str | None) -> int:
        """Adds a material; returns its index."""
        surface: dict[str, Any] = {
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
            "baseColorFactor": [float(f"{c:.{_COLOR_DIGITS}g}") for c in material.base_color],
        }
        if texture_uri is not None:
            surface["baseColorTexture"] = {"index": self._texture(texture_uri)}
        facts: dict[str, Any] = {"doubleSided": material.double_sided, "pbrMetallicRoughness": surface}
        if material.alpha_cutoff is not None:
            facts |= {"alphaMode": "MASK", "alphaCutoff": float(material.alpha_cutoff)}
        if material.unlit:
            facts["extensions"] = {"KHR_materials_unlit": {}}
            self.uses("KHR_materials_unlit")
        return self._added("materials", facts)

    def uses(self, extension: str, how: str = "extensionsUsed") -> None:
        """Declares an extension."""
        used = self._list(how)
        if extension not in used:
            used.append(extension)

    def pack(self) -> tuple[bytes, bytes]:
        """The file: its heads and the JSON, and the body; the two have little in common."""
        if self._body:
            self.json["buffers"] = [{"byteLength": len(self._body)}]
        ordered = {name: self.json[name] for name in _ORDER if name in self.json}
        text = json.dumps(ordered, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(self._body), b"BIN\0") + self._body if self._body else b""
        head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(body), len(text), b"JSON")
        return head + text, body

    def _texture(self, uri: str) -> int:
        if uri not in self._images:
            self._list("images").append({"uri": uri})
            self._list("textures").append({"source": len(self._list("images")) - 1})
            self._images[uri] = len(self._list("textures")) - 1
        return self._images[uri]

    def _view(self, data: bytes) -> int:
        """Adds bytes to the body; returns the view's index."""
        view = {"buffer": 0, "byteLength": len(data)}
        if self._body:
            view["byteOffset"] = len(self._body)
        self._body += data + b"\0" * (-len(data) % 4)
        return self._added("bufferViews", view)

    def _added(self, name: str, facts: dict[str, Any]) -> int:
        """The index of what is added to a list."""
        self._list(name).append(facts)
        return len(self._list(name)) - 1

    def _list(self, name: str) -> list[Any]:
        found = self.json.setdefault(name, [])
        assert isinstance(found, list)
        return found


def _outward(bounds: NDArray[np.float32], step: float) -> list[list[float]]:
    """The two corners, apart by less than ten steps more on each side: with no more digits than steps tell."""
    digits = -math.ceil(math.log10(step))
    scale = 10.0**digits
    lower = [math.floor(value * scale) / scale for value in bounds[0].tolist()]
    upper = [math.ceil(value * scale) / scale for value in bounds[1].tolist()]
    return [[_brief(value, digits) for value in corner] for corner in (lower, upper)]


def _brief(value: float, digits: int) -> float:
    """With so many digits behind the point, and without a point where it is whole."""
    rounded = round(value, digits)
    return int(rounded) if rounded.is_integer() else rounded
