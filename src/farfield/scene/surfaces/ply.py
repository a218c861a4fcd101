"""PLY, binary and text, with vertex normals, colours and texture coordinates; polygons become fans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cleaning import RawSurface
from farfield.scene.faults import EXPORT_AGAIN, counted, reading
from farfield.scene.model import Material, Scene
from farfield.scene.shading import CREASE_COSINE
from farfield.scene.streams import Vertices, whole
from farfield.scene.surfaces.polygons import fan, fan_corners
from farfield.scene.surfaces.source import FileMesh, single_mesh_scene

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_HEADER_LIMIT = 1 << 16
_POLYGONS = ("vertex_indices", "vertex_index")
_READ = 1 << 22
"""Bytes of faces read at a time: 320,000 triangles of 13 bytes."""
_RUN = 64
"""Faces that are looked at together at first; four times as many as long as all have as many corners."""


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    kind: str
    """dtype, without byte order."""
    counted_by: str = ""
    """dtype of the number of items before them; empty: it is no list."""


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(p.counted_by for p in self.properties)

    @property
    def polygons(self) -> _Property:
        """The list of corners: the one that is called so, else the first."""
        lists = [p for p in self.properties if p.counted_by]
        return next((p for p in lists if p.name in _POLYGONS), lists[0])

    def row(self, order: str) -> np.dtype[Any]:
        """Layout of an entry without lists."""
        return np.dtype([(p.name, order + p.kind) for p in self.properties])


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
    return single_mesh_scene(FileMesh(path, parse_ply, open_ply), path.stat().st_size)


def parse_ply(path: Path) -> tuple[RawSurface, tuple[str, ...]]:
    """The triangles. Raises InputError when the file ends early."""
    stream = open_ply(path)
    return (_parse_text(path) if stream is None else whole(stream)), ()


def open_ply(path: Path) -> BinaryPly | None:
    """The surface of the binary forms; None: it is text. Raises KeyError when it has no vertices or faces."""
    header = _header(path)
    if header.order == "text":
        return None
    elements = {element.name: element for element in header.elements}
    wanted = {"vertex", "face"}
    starts: dict[str, int] = {}
    at = header.end
    for element in header.elements:
        starts[element.name] = at
        if wanted <= starts.keys():
            break
        if element.has_lists:
            at += sum(taken for _, taken in _Faces(path, header.order, element, at).parts())
        else:
            at += element.count * element.row(header.order).itemsize
    vertex = elements["vertex"]
    names = {p.name for p in vertex.properties}
    for axis in "xyz":
        if axis not in names or vertex.has_lists:
            raise KeyError(axis)
    if not elements["face"].has_lists:
        raise KeyError("vertex_indices")
    faces = _Faces(path, header.order, elements["face"], starts["face"])
    return BinaryPly(path, vertex.row(header.order), vertex.count, starts["vertex"], faces)


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
                if int(count) < 0:
                    raise ValueError(f"{count} of {name}")
                elements.append(_Element(name, int(count)))
            case ["property", "list", count_type, item_type, name]:
                elements[-1].properties.append(_Property(name, _TYPES[item_type], _TYPES[count_type]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
    return _Header(order, tuple(elements), newline + 1)


@dataclass(frozen=True, slots=True)
class BinaryPly:
    """See `SurfaceStream`."""

    path: Path
    row: np.dtype[Any]
    vertices: int
    at: int
    """Byte where the vertices begin."""
    body: _Faces

    crease_cosine: ClassVar[float] = CREASE_COSINE
    material: ClassVar[Material] = Material()
    warnings: ClassVar[tuple[str, ...]] = ()
    shares_vertices: ClassVar[bool] = True

    @property
    def faces(self) -> int:
        """See `SurfaceStream.faces`."""
        return self.body.element.count

    def rows(self, start: int, stop: int) -> Vertices:
        """See `SurfaceStream.rows`. Raises InputError when the file ends before."""
        missing = self.at + stop * self.row.itemsize - self.path.stat().st_size
        if missing > 0:
            raise _truncated(missing, self.path)
        table = np.fromfile(self.path, self.row, stop - start, offset=self.at + start * self.row.itemsize)
        return _vertices({name: table[name] for name in table.dtype.names or ()})

    def batches(self) -> Iterator[NDArray[np.int64]]:
        """See `SurfaceStream.batches`. Raises InputError when the file ends before."""
        return (triangles for triangles, _ in self.body.parts())


@dataclass(frozen=True, slots=True)
class _Faces:
    """The entries of an element with lists, which are of any length: what follows is found by reading them."""

    path: Path
    order: str
    element: _Element
    at: int
    """Byte where they begin."""

    def parts(self) -> Iterator[tuple[NDArray[np.int64], int]]:
        """(k, 3) corners of the triangles in a part of the file, and its bytes.

        Raises InputError when the file ends before the last entry.
        """
        left, at, size = self.element.count, self.at, self.path.stat().st_size
        with self.path.open("rb") as file:
            while left:
                raw = self._read(file, at, size)
                found: list[NDArray[np.int64]] = []
                taken, run = 0, _RUN
                while left and (layout := self._layout(raw, taken)) is not None:
                    entries = self._alike(raw, taken, layout, min(run, left))
                    run = 4 * run if len(entries) == run else _RUN
                    found.append(_fanned(entries[self.element.polygons.name]))
                    taken += entries.nbytes
                    left -= len(entries)
                yield np.concatenate(found), taken
                at += taken

    def _read(self, file: IO[bytes], at: int, size: int) -> bytes:
        """The next bytes, at least one entry."""
        file.seek(at)
        raw = file.read(_READ)
        while self._layout(raw, 0) is None:
            more = self._reach(raw, 0)[0] - len(raw)
            if at + len(raw) + more > size:
                raise _truncated(at + len(raw) + more - size, self.path)
            raw += file.read(more)
        return raw

    def _reach(self, raw: bytes, at: int) -> tuple[int, dict[str, int]]:
        """Where the entry at a byte ends, as far as `raw` tells, and the items of its lists."""
        counts: dict[str, int] = {}
        for p in self.element.properties:
            items = 1
            if p.counted_by:
                count_type = np.dtype(self.order + p.counted_by)
                at += count_type.itemsize
                if at > len(raw):
                    break
                counts[p.name] = items = int(np.frombuffer(raw, count_type, 1, at - count_type.itemsize)[0])
                if items < 0:
                    raise ValueError(f"a face of {items} corners")
            at += items * np.dtype(p.kind).itemsize
        return at, counts

    def _layout(self, raw: bytes, at: int) -> np.dtype[Any] | None:
        """Of the entry at a byte; None when not all of it is there."""
        end, counts = self._reach(raw, at)
        if end > len(raw):
            return None
        fields: list[Any] = []
        for p in self.element.properties:
            if p.counted_by:
                fields.append((_count_of(p.name), self.order + p.counted_by))
                fields.append((p.name, self.order + p.kind, (counts[p.name],)))
            else:
                fields.append((p.name, self.order + p.kind))
        return np.dtype(fields)

    def _alike(self, raw: bytes, at: int, layout: np.dtype[Any], most: int) -> NDArray[Any]:
        """Entries of the layout from a byte on, at most so many."""
        rows = min(most, (len(raw) - at) // layout.itemsize)
        entries = np.frombuffer(raw, layout, rows, at)
        same = np.ones(rows, bool)
        for p in self.element.properties:
            if p.counted_by:
                counts = entries[_count_of(p.name)]
                same &= counts == counts[0]
        return entries if same.all() else entries[: int(np.argmin(same))]


def _count_of(name: str) -> str:
    return f"{name} count"


def _fanned(polygons: NDArray[Any]) -> NDArray[np.int64]:
    """(m, 3): polygons (k, n) of n corners each as fans."""
    corners = polygons.astype(np.int64)
    if corners.shape[1] == 3:
        return corners
    return corners.ravel()[fan_corners(np.full(len(corners), corners.shape[1]))].reshape(-1, 3)


def _truncated(missing: int, path: Path) -> InputError:
    return InputError(f"is truncated: at least {counted(missing, 'byte')} are missing", str(path), EXPORT_AGAIN)


def _vertices(columns: dict[str, NDArray[Any]]) -> Vertices:
    uv_names = next((pair for pair in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")) if pair[0] in columns), None)
    return Vertices(
        positions=np.stack([columns[axis].astype(np.float64) for axis in "xyz"], -1),
        normals=np.stack([columns[n].astype(np.float64) for n in ("nx", "ny", "nz")], -1) if "nx" in columns else None,
        uvs=None
        if uv_names is None
        else np.stack([columns[uv_names[0]], 1 - columns[uv_names[1]]], -1).astype(np.float32),
        colors=_colors(columns),
    )


def _colors(columns: dict[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """(n, 4) uint8; floats are taken as 0..1."""
    prefix = "" if "red" in columns else "diffuse_"
    names = [prefix + name for name in ("red", "green", "blue")]
    if not all(name in columns for name in names):
        return None
    channels = [columns[name] for name in names] + ([columns["alpha"]] if "alpha" in columns else [])
    scale = 255.0 if channels[0].dtype.kind == "f" else 255.0 / np.iinfo(channels[0].dtype).max
    out = np.full((len(channels[0]), 4), 255, np.uint8)
    for k, channel in enumerate(channels):
        out[:, k] = np.clip(np.floor(channel * scale + 0.5), 0, 255)
    return out


def _parse_text(path: Path) -> RawSurface:
    header = _header(path)
    body = _Text(path.read_bytes()[header.end :], str(path))
    columns: dict[str, NDArray[Any]] = {}
    triangles = np.zeros((0, 3), np.int64)
    for element in header.elements:
        if element.has_lists:
            polygons = body.polygons(element)
            triangles = polygons if element.name == "face" else triangles
        elif element.name == "vertex":
            columns = body.columns(element)
        else:
            body.columns(element)
    vertices = _vertices(columns)
    return RawSurface(vertices.positions, triangles, vertices.normals, vertices.uvs, vertices.colors)


class _Text:
    """The body as text: one line an entry."""

    def __init__(self, raw: bytes, where: str) -> None:
        self._lines, self._where, self._at = raw.split(b"\n"), where, 0

    def columns(self, element: _Element) -> dict[str, NDArray[Any]]:
        """Of an element without lists, by name."""
        table = np.array(b" ".join(self._take(element)).split(), np.float64).reshape(element.count, -1)
        return {p.name: table[:, k].astype(p.kind) for k, p in enumerate(element.properties)}

    def polygons(self, element: _Element) -> NDArray[np.int64]:
        """(m, 3) triangles of the first list of an element, whatever follows it."""
        rows = [np.array(line.split(), np.float64).astype(np.int64) for line in self._take(element)]
        return fan([row[1 : 1 + row[0]] for row in rows])

    def _take(self, element: _Element) -> list[bytes]:
        lines = [line for line in self._lines[self._at : self._at + element.count] if line.strip()]
        self._at += element.count
        if len(lines) < element.count:
            missing = counted(element.count - len(lines), "line")
            raise InputError(f"is truncated: {missing} are missing", self._where, EXPORT_AGAIN)
        return lines
