"""PLY, binary and text, with vertex normals, colours and texture coordinates; polygons become fans."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cleaning import RawSurface
from farfield.scene.faults import EXPORT_AGAIN, counted, reading
from farfield.scene.model import Scene
from farfield.scene.surfaces.polygons import fan
from farfield.scene.surfaces.source import FileMesh, single_mesh_scene

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_HEADER_LIMIT = 1 << 16


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    columns: list[tuple[str, str]] = field(default_factory=list)
    """(name, dtype) of each plain property."""
    lists: list[tuple[str, str, str]] = field(default_factory=list)
    """(name, dtype of the count, dtype of the items) of each list property."""


@dataclass(frozen=True, slots=True)
class _Header:
    order: str
    """'<', '>' or 'text'."""
    elements: tuple[_Element, ...]
    end: int
    """Byte where the body starts."""


def read_ply(path: Path) -> Scene:
    """The scene of a PLY file; only its header is read. Raises InputError when it holds no faces."""
    with reading(str(path)):
        header = _header(path)
    faces = sum(element.count for element in header.elements if element.name == "face")
    if not faces:
        raise InputError("holds points but no faces", str(path), "make a mesh of it first")
    return single_mesh_scene(FileMesh(path, parse_ply), path.stat().st_size)


def parse_ply(path: Path) -> tuple[RawSurface, tuple[str, ...]]:
    """The triangles. Raises InputError when the file ends early."""
    header = _header(path)
    raw = path.read_bytes()[header.end :]
    body = _Text(raw, str(path)) if header.order == "text" else _Binary(raw, header.order, str(path))
    vertex: dict[str, NDArray[Any]] = {}
    triangles = np.zeros((0, 3), np.int64)
    for element in header.elements:
        columns, polygons = body.element(element)
        if element.name == "vertex":
            vertex = columns
        elif element.name == "face" and polygons is not None:
            triangles = polygons
    return _surface(vertex, triangles), ()


def _header(path: Path) -> _Header:
    with path.open("rb") as file:
        head = file.read(_HEADER_LIMIT)
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or newline < 0:
        raise InputError("is damaged: it has no PLY header", str(path), EXPORT_AGAIN)
    elements: list[_Element] = []
    order = ""
    for words in (line.split() for line in head[:end].decode("latin-1").splitlines()):
        match words:
            case ["format", kind, *_]:
                order = {"ascii": "text", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count_type, item_type, name]:
                elements[-1].lists.append((name, _TYPES[count_type], _TYPES[item_type]))
            case ["property", kind, name]:
                elements[-1].columns.append((name, _TYPES[kind]))
    return _Header(order, tuple(elements), newline + 1)


def _surface(vertex: dict[str, NDArray[Any]], triangles: NDArray[np.int64]) -> RawSurface:
    uv_names = next((pair for pair in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")) if pair[0] in vertex), None)
    return RawSurface(
        positions=np.stack([vertex[axis].astype(np.float64) for axis in "xyz"], -1),
        triangles=triangles,
        normals=np.stack([vertex[n].astype(np.float64) for n in ("nx", "ny", "nz")], -1) if "nx" in vertex else None,
        uvs=None
        if uv_names is None
        else np.stack([vertex[uv_names[0]], 1 - vertex[uv_names[1]]], -1).astype(np.float32),
        colors=_colors(vertex),
    )


def _colors(vertex: dict[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """(n, 4) uint8; floats are taken as 0..1."""
    prefix = "" if "red" in vertex else "diffuse_"
    names = [prefix + name for name in ("red", "green", "blue")]
    if not all(name in vertex for name in names):
        return None
    channels = [vertex[name] for name in names] + ([vertex["alpha"]] if "alpha" in vertex else [])
    scale = 255.0 if channels[0].dtype.kind == "f" else 255.0 / np.iinfo(channels[0].dtype).max
    out = np.full((len(channels[0]), 4), 255, np.uint8)
    for k, channel in enumerate(channels):
        out[:, k] = np.clip(np.floor(channel * scale + 0.5), 0, 255)
    return out


class _Binary:
    """The body in binary: one element after the other."""

    def __init__(self, raw: bytes, order: str, where: str) -> None:
        self._raw, self._order, self._where, self._at = raw, order, where, 0

    def element(self, element: _Element) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64] | None]:
        """Columns by name and, when it has a list, (m, 3) triangles of its polygons."""
        if not element.lists:
            table = self._take(np.dtype([(name, self._order + kind) for name, kind in element.columns]), element.count)
            return {name: table[name] for name, _ in element.columns}, None
        uniform = self._uniform_triangles(element)
        if uniform is not None:
            return {}, uniform
        return {}, self._polygons(element)

    def _take(self, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        stop = self._at + dtype.itemsize * count
        if stop > len(self._raw):
            missing = counted(stop - len(self._raw), "byte")
            raise InputError(f"is truncated: at least {missing} are missing", self._where, EXPORT_AGAIN)
        table = np.frombuffer(self._raw, dtype, count, self._at)
        self._at = stop
        return table

    def _uniform_triangles(self, element: _Element) -> NDArray[np.int64] | None:
        """The usual case: one list, every face a triangle; None when it is not so."""
        if len(element.lists) != 1 or element.columns:
            return None
        _, count_type, item_type = element.lists[0]
        dtype = np.dtype([("n", self._order + count_type), ("items", self._order + item_type, 3)])
        if self._at + dtype.itemsize * element.count > len(self._raw):
            return None
        table = np.frombuffer(self._raw, dtype, element.count, self._at)
        if not (table["n"] == 3).all():
            return None
        self._at += dtype.itemsize * element.count
        return table["items"].astype(np.int64)

    def _polygons(self, element: _Element) -> NDArray[np.int64]:
        """Mixed faces, one by one. Properties of faces other than the first list are skipped (lists come last)."""
        lists = [(np.dtype(self._order + a), np.dtype(self._order + b)) for _, a, b in element.lists]
        skip = sum(np.dtype(kind).itemsize for _, kind in element.columns)
        corners: list[NDArray[Any]] = []
        for _ in range(element.count):
            for k, (count_type, item_type) in enumerate(lists):
                items = self._take(item_type, int(self._take(count_type, 1)[0]))
                if k == 0:
                    corners.append(items)
            self._at += skip
        return fan([c.astype(np.int64) for c in corners])


class _Text:
    """The body as text: one line an entry."""

    def __init__(self, raw: bytes, where: str) -> None:
        self._lines, self._where, self._at = raw.split(b"\n"), where, 0

    def element(self, element: _Element) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64] | None]:
        """Columns by name and, when it has a list, (m, 3) triangles of its polygons."""
        lines = [line for line in self._lines[self._at : self._at + element.count] if line.strip()]
        self._at += element.count
        if len(lines) < element.count:
            missing = counted(element.count - len(lines), "line")
            raise InputError(f"is truncated: {missing} are missing", self._where, EXPORT_AGAIN)
        if not element.lists:
            table = np.array(b" ".join(lines).split(), np.float64).reshape(element.count, -1)
            return {name: table[:, k].astype(kind) for k, (name, kind) in enumerate(element.columns)}, None
        rows = [np.array(line.split(), np.float64).astype(np.int64) for line in lines]
        return {}, fan([row[1 : 1 + row[0]] for row in rows])
