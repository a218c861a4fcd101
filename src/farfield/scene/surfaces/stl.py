"""STL, binary and text. Every facet is flat; the format has no shared vertices, colours or textures."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cleaning import RawSurface
from farfield.scene.faults import EXPORT_AGAIN, counted, reading
from farfield.scene.model import Material, Scene
from farfield.scene.shading import CREASE_COSINE
from farfield.scene.streams import BATCH, Vertices, whole
from farfield.scene.surfaces.source import FileMesh, single_mesh_scene

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84


def read_stl(path: Path) -> Scene:
    """The scene of an STL file; only its header is read. Raises InputError when it is truncated or empty."""
    size = path.stat().st_size
    if not is_text(path):
        with reading(str(path)), path.open("rb") as file:
            count = int(np.frombuffer(file.read(_HEADER)[80:], "<u4")[0])
        if size < _HEADER + count * _FACET.itemsize:
            whole = _HEADER + count * _FACET.itemsize
            raise InputError(f"is truncated: {size:,} of {whole:,} bytes are there", str(path), EXPORT_AGAIN)
        if not count:
            raise InputError("holds no triangles", str(path), EXPORT_AGAIN)
    return single_mesh_scene(FileMesh(path, parse_stl, open_stl), size)


def is_text(path: Path) -> bool:
    """True for the text form. Binary files may begin with 'solid' too, so the size decides first."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(512)
    if len(head) >= _HEADER and size == _HEADER + int(np.frombuffer(head[80:84], "<u4")[0]) * _FACET.itemsize:
        return False
    return head.lstrip()[:5].lower() == b"solid" and b"\0" not in head


def parse_stl(path: Path) -> tuple[RawSurface, tuple[str, ...]]:
    """The triangles. Raises ValueError when the text cannot be understood."""
    stream = open_stl(path)
    if stream is not None:
        return whole(stream), ()
    corners = _text_corners(path)
    return RawSurface(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3)), ()


def open_stl(path: Path) -> BinaryStl | None:
    """The triangles of the binary form; None: it is text."""
    if is_text(path):
        return None
    with path.open("rb") as file:
        return BinaryStl(path, int(np.frombuffer(file.read(_HEADER)[80:], "<u4")[0]))


@dataclass(frozen=True, slots=True)
class BinaryStl:
    """See `SurfaceStream`. Every triangle has three vertices of its own."""

    path: Path
    faces: int

    crease_cosine: ClassVar[float] = CREASE_COSINE
    material: ClassVar[Material] = Material()
    warnings: ClassVar[tuple[str, ...]] = ()
    shares_vertices: ClassVar[bool] = False

    @property
    def vertices(self) -> int:
        """See `SurfaceStream.vertices`."""
        return 3 * self.faces

    def rows(self, start: int, stop: int) -> Vertices:
        """See `SurfaceStream.rows`. Raises InputError when the file ends before."""
        first, last = start // 3, -(-stop // 3)
        missing = _HEADER + last * _FACET.itemsize - self.path.stat().st_size
        if missing > 0:
            what = f"is truncated: at least {counted(missing, 'byte')} are missing"
            raise InputError(what, str(self.path), EXPORT_AGAIN)
        facets = np.fromfile(self.path, _FACET, last - first, offset=_HEADER + first * _FACET.itemsize)
        corners = facets["corners"].reshape(-1, 3)[start - 3 * first : stop - 3 * first]
        return Vertices(corners.astype(np.float64))

    def batches(self) -> Iterator[NDArray[np.int64]]:
        """See `SurfaceStream.batches`."""
        for start in range(0, self.faces, BATCH):
            stop = min(start + BATCH, self.faces)
            yield np.arange(3 * start, 3 * stop, dtype=np.int64).reshape(-1, 3)


def _text_corners(path: Path) -> NDArray[np.float64]:
    lines = path.read_bytes().split(b"\n")
    vertices = [line.split()[1:4] for line in lines if line.lstrip()[:6].lower() == b"vertex"]
    if not vertices or len(vertices) % 3:
        raise InputError("holds no whole triangles", str(path), EXPORT_AGAIN)
    return np.loadtxt(io.BytesIO(b"\n".join(b" ".join(words) for words in vertices)), np.float64, ndmin=2)
