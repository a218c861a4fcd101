"""Small glTF files made by hand, so that readers are tested against something they did not write themselves."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
"""In the file's y-up frame: in the plane z = 0, facing +z."""

_CODES = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121, "i1": 5120, "i2": 5122}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GltfFile:
    """A document that grows, and is written as GLB, or as .gltf with its buffer beside it or inside it."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [],
                                     "nodes": [], "scenes": [{"nodes": []}], "scene": 0}  # fmt: skip
        self.chunk = bytearray()

    def view(self, raw: bytes, **fields: Any) -> int:
        self.chunk += b"\0" * (-len(self.chunk) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.chunk), "byteLength": len(raw), **fields})
        self.chunk += raw
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, **fields: Any) -> int:
        array = np.atleast_2d(np.asarray(values))
        if np.ndim(values) == 1:
            array = array.T
        entry = {"bufferView": self.view(np.ascontiguousarray(array).tobytes()), "count": len(array),
                 "componentType": _CODES[array.dtype.str[1:]], "type": _TYPES[array.shape[1]]}  # fmt: skip
        self.json["accessors"].append(entry | fields)
        return len(self.json["accessors"]) - 1

    def mesh(self, attributes: dict[str, int], **fields: Any) -> int:
        self.json["meshes"].append({"primitives": [{"attributes": attributes, **fields}]})
        return len(self.json["meshes"]) - 1

    def node(self, root: bool = True, **fields: Any) -> int:
        self.json["nodes"].append(fields)
        if root:
            self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return len(self.json["nodes"]) - 1

    def material(self, **fields: Any) -> int:
        self.json.setdefault("materials", []).append(fields)
        return len(self.json["materials"]) - 1

    def write(self, path: Path) -> Path:
        if path.suffix == ".gltf":
            (path.parent / "a b.bin").write_bytes(self.chunk)
            self.json["buffers"] = [{"byteLength": len(self.chunk), "uri": "a%20b.bin"}]
            path.write_text(json.dumps(self.json))
            return path
        self.json["buffers"] = [{"byteLength": len(self.chunk)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        chunk = bytes(self.chunk) + b"\0" * (-len(self.chunk) % 4)
        head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(chunk), len(text), 0x4E4F534A)
        path.write_bytes(head + text + struct.pack("<II", len(chunk), 0x004E4942) + chunk)
        return path


def triangle_file(**primitive: Any) -> GltfFile:
    """One triangle, one node."""
    file = GltfFile()
    file.mesh({"POSITION": file.accessor(TRIANGLE)}, **primitive)
    file.node(mesh=0)
    return file
