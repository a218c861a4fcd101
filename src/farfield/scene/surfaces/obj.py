"""OBJ: polygons with texture coordinates, normals, vertex colours and MTL materials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cleaning import RawSurface
from farfield.scene.faults import reading
from farfield.scene.model import Material, Scene
from farfield.scene.surfaces.mtl import read_mtl
from farfield.scene.surfaces.polygons import fan_corners
from farfield.scene.surfaces.source import FileMesh, single_mesh_scene

_NONE = np.iinfo(np.int64).min
"""Stands for an index a corner does not have."""


@dataclass(slots=True)
class _Lines:
    """The lines of a file by kind."""

    vertices: list[bytes]
    uvs: list[bytes]
    normals: list[bytes]
    faces: list[bytes]
    face_material: list[int]
    face_counts: list[tuple[int, int, int]]
    """How many vertices, uvs and normals came before each face: what negative indices count from."""
    materials: list[str]
    libraries: list[str]


def read_obj(path: Path) -> Scene:
    """The scene of an OBJ file; nothing but its size is read. Raises InputError."""
    with reading(str(path)):
        return single_mesh_scene(FileMesh(path, parse_obj), path.stat().st_size)


def parse_obj(path: Path) -> tuple[RawSurface, tuple[str, ...]]:
    """The triangles and warnings. Raises InputError when there are no faces."""
    lines = _sort_lines(path.read_bytes())
    if not lines.faces:
        raise InputError("holds no faces", str(path), "export its polygons with it")
    materials, warnings = _materials(lines, path)
    corners, sizes = _corners(lines)
    vertices = _table(lines.vertices, 3)
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    triangles = inverse.reshape(-1)[fan_corners(sizes)]
    rows = np.clip(unique[:, 0], 0, len(vertices) - 1)
    positions = vertices[rows, :3].copy()
    positions[(unique[:, 0] < 0) | (unique[:, 0] >= len(vertices))] = np.nan
    return RawSurface(
        positions=positions,
        triangles=triangles.astype(np.int64),
        normals=_gather(_table(lines.normals, 3), unique[:, 2]),
        uvs=_uvs(lines, unique),
        colors=_colors(vertices, rows),
        materials=materials,
        triangle_material=np.repeat(np.array(lines.face_material, np.uint16), np.maximum(sizes - 2, 0)),
    ), tuple(warnings)


def _sort_lines(raw: bytes) -> _Lines:
    lines = _Lines([], [], [], [], [], [], [""], [])
    current = 0
    for line in raw.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").split(b"\n"):
        keyword, _, rest = line.lstrip().partition(b" ")
        if keyword == b"v":
            lines.vertices.append(rest)
        elif keyword == b"f":
            lines.faces.append(rest)
            lines.face_material.append(current)
            lines.face_counts.append((len(lines.vertices), len(lines.uvs), len(lines.normals)))
        elif keyword == b"vt":
            lines.uvs.append(rest)
        elif keyword == b"vn":
            lines.normals.append(rest)
        elif keyword == b"usemtl":
            current = _index(lines.materials, rest.decode("utf-8", "replace").strip())
        elif keyword == b"mtllib":
            lines.libraries.append(rest.decode("utf-8", "replace").strip())
    return lines


def _index(names: list[str], name: str) -> int:
    if name not in names:
        names.append(name)
    return names.index(name)


def _materials(lines: _Lines, path: Path) -> tuple[tuple[Material, ...], list[str]]:
    known: dict[str, Material] = {}
    warnings: list[str] = []
    for library in dict.fromkeys(lines.libraries):
        found, complaints = read_mtl(path.parent / library.replace("\\", "/"))
        known |= found
        warnings += complaints
    missing = [name for name in lines.materials[1:] if name not in known]
    if missing and not warnings:
        warnings.append(f"{path}: material {missing[0]} is not in its library; it is drawn white")
    return tuple(known.get(name, Material(name)) for name in lines.materials), warnings


def _table(lines: list[bytes], width: int) -> NDArray[np.float64]:
    """(n, width or more): numbers of the lines; lines of several lengths are cut to the shortest."""
    if not lines:
        return np.zeros((0, width))
    words = [line.split() for line in lines]
    least = min(map(len, words))
    if least < min(width, 2):
        raise ValueError("a line of vertices has too few numbers")
    return np.array([row[:least] for row in words], np.float64)


def _corners(lines: _Lines) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(c, 3) vertex, uv and normal of every corner from 0 (`_NONE` where absent), and the corners of each face."""
    words = [face.split(b"#")[0].split() for face in lines.faces]
    sizes = np.array([len(face) for face in words], np.int64)
    slashes = {corner.count(b"/") for face in words for corner in face}
    if slashes == {0}:
        flat = np.array([corner for face in words for corner in face], np.int64)[:, None]
    else:
        none = str(_NONE).encode()
        padded = [[*corner.split(b"/"), b"", b""][:3] for face in words for corner in face]
        flat = np.array([[part or none for part in corner] for corner in padded], np.int64)
    corners = np.full((len(flat), 3), _NONE, np.int64)
    corners[:, : flat.shape[1]] = flat
    before = np.repeat(np.array(lines.face_counts, np.int64), sizes, axis=0)
    given = corners != _NONE
    return np.where(given, np.where(corners < 0, corners + before, corners - 1), _NONE), sizes


def _gather(table: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """(n, k): rows of the table, NaN where there is none; None when no row has any."""
    good = (rows >= 0) & (rows < len(table))
    if not good.any():
        return None
    out = np.full((len(rows), table.shape[1]), np.nan)
    out[good] = table[rows[good]]
    return out


def _uvs(lines: _Lines, unique: NDArray[np.int64]) -> NDArray[np.float32] | None:
    """(n, 2), v downwards."""
    uvs = _gather(_table(lines.uvs, 2), unique[:, 1])
    if uvs is None:
        return None
    return np.stack([uvs[:, 0], 1 - uvs[:, 1]], -1).astype(np.float32)


def _colors(vertices: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.uint8] | None:
    """(n, 4) uint8 of the widespread 'v x y z r g b', 0..1 sRGB."""
    if vertices.shape[1] < 6:
        return None
    out = np.full((len(rows), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.floor(vertices[rows, 3:6] * 255 + 0.5), 0, 255)
    return out
