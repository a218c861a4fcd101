"""STL, binary and text. Every facet is flat; the format has no shared vertices, colours or textures."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from farfield.errors import InputError
from farfield.scene.cleaning import RawSurface
from farfield.scene.faults import EXPORT_AGAIN, reading
from farfield.scene.model import Scene
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
    return single_mesh_scene(FileMesh(path, parse_stl), size)


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
    corners = _text_corners(path) if is_text(path) else _binary_corners(path)
    count = len(corners)
    return RawSurface(corners, np.arange(count, dtype=np.int64).reshape(-1, 3)), ()


def _binary_corners(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    facets = np.memmap(path, np.uint8, "r")
    count = int(facets[80:84].view("<u4")[0])
    table = np.frombuffer(facets, _FACET, count, _HEADER)
    return table["corners"].reshape(-1, 3).astype(np.float64)


def _text_corners(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    lines = path.read_bytes().split(b"\n")
    vertices = [line.split()[1:4] for line in lines if line.lstrip()[:6].lower() == b"vertex"]
    if not vertices or len(vertices) % 3:
        raise InputError("holds no whole triangles", str(path), EXPORT_AGAIN)
    return np.loadtxt(io.BytesIO(b"\n".join(b" ".join(words) for words in vertices)), np.float64, ndmin=2)
