"""The glTF container: the JSON of a .gltf or .glb, and its buffers, mapped or read when first asked for."""

from __future__ import annotations

import base64
import json
import os
import struct
from functools import lru_cache
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.faults import EXPORT_AGAIN, counted, existing_file, reading

_JSON, _BIN = 0x4E4F534A, 0x004E4942

SUPPORTED = frozenset(
    {
        "KHR_draco_mesh_compression",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_lights_punctual",
        "EXT_texture_webp",
        "EXT_mesh_gpu_instancing",
        "EXT_mesh_features",
        "EXT_structural_metadata",
        "CESIUM_RTC",
    }
)
"""Required extensions that are read, or that change nothing that is drawn. All KHR_materials_* are accepted as well."""


class Document:
    """One glTF file: its JSON, and its buffers as bytes that are mapped, not copied. Made by `open_document`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.where = str(path)
        with reading(self.where):
            self.json, self._chunk = _header(path)
        self.cache: dict[tuple[str, int], Any] = {}
        """Decoded images and materials by kind and index, shared by all meshes of the file."""
        self._buffers: dict[int, NDArray[np.uint8]] = {}
        self._maps: list[mmap] = []
        _refuse_unsupported(self.json, self.where)
        self._beside = self._names_beside()
        self.states = self.states_now()
        """As they were when the file was opened."""

    def items(self, kind: str) -> list[dict[str, Any]]:
        """The top-level array of that name, empty when absent."""
        value = self.json.get(kind, [])
        if not isinstance(value, list):
            raise InputError(f"is damaged: {kind!r} is not an array", self.where, EXPORT_AGAIN)
        return value

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """One entry of a top-level array. Raises InputError when there is none of that index."""
        entries = self.items(kind)
        if not isinstance(index, int) or not 0 <= index < len(entries):
            raise InputError(f"is damaged: it refers to {kind}[{index}], which is not there", self.where, EXPORT_AGAIN)
        return entries[index]

    def view_bytes(self, index: int) -> NDArray[np.uint8]:
        """(n,) uint8: the bytes of a buffer view. Raises InputError when the buffer ends before it."""
        view = self.item("bufferViews", index)
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        buffer = self.buffer(view["buffer"])
        if start < 0 or length < 0 or start + length > len(buffer):
            missing = counted(start + length - len(buffer), "byte")
            raise InputError(f"is truncated: {missing} of a buffer are missing", self.where, EXPORT_AGAIN)
        return buffer[start : start + length]

    def buffer(self, index: int) -> NDArray[np.uint8]:
        """(n,) uint8: a whole buffer: the GLB's own chunk, a file beside it, or a data: URI."""
        if index not in self._buffers:
            uri = self.item("buffers", index).get("uri")
            self._buffers[index] = self._own_chunk() if uri is None else self.resource(uri)
        return self._buffers[index]

    def resource(self, uri: str) -> NDArray[np.uint8]:
        """(n,) uint8: what a URI holds. Raises InputError when it cannot be read."""
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            raw = base64.b64decode(body) if head.endswith(";base64") else unquote(body).encode("latin-1")
            return np.frombuffer(raw, np.uint8)
        if "://" in uri:
            raise InputError(f"refers to {uri}, which is not a file", self.where, "download it beside the file")
        return self._mapped(existing_file(self.path.parent / unquote(uri)))

    def _own_chunk(self) -> NDArray[np.uint8]:
        start, length = self._chunk
        if not length:
            raise InputError("is damaged: it has no binary chunk", self.where, EXPORT_AGAIN)
        return self._mapped(self.path)[start : start + length]

    def _mapped(self, path: Path) -> NDArray[np.uint8]:
        with path.open("rb") as file:
            self._maps.append(mmap(file.fileno(), 0, access=ACCESS_READ))
        return np.frombuffer(self._maps[-1], np.uint8)

    def files(self) -> tuple[Path, ...]:
        """The file, and the buffers and images beside it that are there."""
        return (self.path, *(file for name in self._beside if (file := self.path.parent / name).is_file()))

    def states_now(self) -> tuple[tuple[int, int], ...]:
        """Bytes and time of change (nanoseconds) of each buffer and image beside it; -1, -1 for one that is missing."""
        return tuple(_state(os.path.join(self.path.parent, name)) for name in self._beside)

    def _names_beside(self) -> tuple[str, ...]:
        uris = {entry.get("uri", "data:") for kind in ("buffers", "images") for entry in self.items(kind)}
        return tuple(sorted(unquote(uri) for uri in uris if not uri.startswith("data:") and "://" not in uri))

    def release(self) -> None:
        """Lets the system have back the memory of what was read: of a file that is read through, all would stay."""
        for mapped in self._maps:
            mapped.madvise(MADV_DONTNEED)


def open_document(path: Path) -> Document:
    """The document of a file, kept while neither it nor what lies beside it changes. Raises InputError."""
    with reading(str(path)):
        stat = path.stat()
        document = _open(path, stat.st_mtime_ns, stat.st_size)
        if document.states == document.states_now():
            return document
        _open.cache_clear()
        return _open(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4)
def _open(path: Path, modified: int, size: int) -> Document:
    return Document(path)


def _state(path: str) -> tuple[int, int]:
    try:
        facts = os.stat(path)
    except (OSError, ValueError):
        return -1, -1
    return facts.st_size, facts.st_mtime_ns


def _header(path: Path) -> tuple[dict[str, Any], tuple[int, int]]:
    """The JSON, and start and length of the binary chunk (0, 0 when there is none)."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(20)
        if head[:4] != b"glTF":
            return _parse(head + file.read(), path), (0, 0)
        if len(head) < 20:
            raise InputError(f"is truncated after {counted(size, 'byte')}", str(path), EXPORT_AGAIN)
        _, version, total, length, kind = struct.unpack("<4sIIII", head)
        if version != 2 or kind != _JSON:
            raise InputError(f"is GLB version {version}; only version 2 is read", str(path), "export it as glTF 2.0")
        if total > size:
            raise InputError(f"is truncated: {size:,} of {total:,} bytes are there", str(path), EXPORT_AGAIN)
        document = _parse(file.read(length), path)
        chunk = file.read(8)
    if len(chunk) < 8:
        return document, (0, 0)
    chunk_length, chunk_kind = struct.unpack("<II", chunk)
    if chunk_kind != _BIN:
        return document, (0, 0)
    if 28 + length + chunk_length > size:
        raise InputError(f"is truncated: its binary chunk ends after byte {size:,}", str(path), EXPORT_AGAIN)
    return document, (28 + length, chunk_length)


def _parse(raw: bytes, path: Path) -> dict[str, Any]:
    try:
        document = json.loads(raw)
    except ValueError as error:
        raise InputError(f"is damaged: its JSON cannot be read: {error}", str(path), EXPORT_AGAIN) from error
    if not isinstance(document, dict) or "asset" not in document:
        raise InputError("is JSON, but not glTF", str(path), "check the path")
    version = str(document["asset"].get("version", ""))
    if not version.startswith("2"):
        raise InputError(f"is glTF version {version or '?'}; only 2.0 is read", str(path), "export it as glTF 2.0")
    return document


def _refuse_unsupported(document: dict[str, Any], where: str) -> None:
    required = document.get("extensionsRequired", [])
    unknown = [name for name in required if name not in SUPPORTED and not name.startswith("KHR_materials_")]
    if unknown:
        raise InputError(f"needs the glTF extension {', '.join(unknown)}, which is not read", where,
                         "export it without that extension")  # fmt: skip
