"""Files of surfaces of any size, and what their triangles are, in an order that does not depend on the pieces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cleaning import RawSurface
from farfield.scene.model import Material, Mesh
from farfield.scene.procedural.blobs import cube_sphere
from farfield.scene.streams import Vertices


@dataclass(frozen=True, slots=True, eq=False)
class HeldStream:
    """A SurfaceStream that holds its surface."""

    raw: RawSurface
    batch: int = 7
    shares_vertices: bool = True

    @property
    def vertices(self) -> int:
        return len(self.raw.positions)

    @property
    def faces(self) -> int:
        return len(self.raw.triangles)

    @property
    def material(self) -> Material:
        return self.raw.materials[0]

    @property
    def crease_cosine(self) -> float:
        return self.raw.crease_cosine

    @property
    def warnings(self) -> tuple[str, ...]:
        return ()

    def rows(self, start: int, stop: int) -> Vertices:
        raw, rows = self.raw, slice(start, stop)
        return Vertices(
            raw.positions[rows],
            None if raw.normals is None else raw.normals[rows],
            None if raw.uvs is None else raw.uvs[rows],
            None if raw.colors is None else raw.colors[rows],
        )

    def batches(self) -> Iterator[NDArray[np.int64]]:
        for start in range(0, len(self.raw.triangles), self.batch):
            yield self.raw.triangles[start : start + self.batch]


def stone(n: int, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """12 n^2 triangles of a rough ball in no order, flattened below, so that some of its edges are sharp."""
    points, faces = cube_sphere(n)
    chance = np.random.default_rng(seed)
    points = points * (1 + 0.2 / n * chance.random((len(points), 1)))
    points[:, 2] = np.maximum(points[:, 2], -0.4)
    return points.astype(np.float32).astype(np.float64), faces[chance.permutation(len(faces))].astype(np.int64)


def write_ply(path: Path, columns: dict[str, NDArray[Any]], faces: Iterable[Any], order: str = "<") -> Path:
    """columns: name -> (n,). faces: an array (m, 3), or tuples of any length."""
    names = {"f4": "float", "f8": "double", "u1": "uchar"}
    table = np.rec.fromarrays(list(columns.values()), dtype=[(k, order + v.dtype.str[1:]) for k, v in columns.items()])
    listed = "".join(f"property {names[v.dtype.str[1:]]} {k}\n" for k, v in columns.items())
    if isinstance(faces, np.ndarray):
        body = np.empty(len(faces), [("n", "u1"), ("corners", order + "i4", 3)])
        body["n"], body["corners"] = 3, faces
        count, raw = len(faces), body.tobytes()
    else:
        kept = list(faces)
        count = len(kept)
        raw = b"".join(bytes([len(face)]) + np.array(face, order + "i4").tobytes() for face in kept)
    form = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{form}_endian 1.0\nelement vertex {len(table)}\n{listed}"
        f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + table.tobytes() + raw)
    return path


def write_stone(path: Path, n: int) -> Path:
    """A stone as PLY."""
    points, faces = stone(n)
    return write_ply(path, dict(zip("xyz", points.astype(np.float32).T, strict=True)), faces)


def write_stl(path: Path, corners: NDArray[Any]) -> Path:
    """corners: (m, 3, 3)."""
    facets = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = corners
    path.write_bytes(bytes(80) + len(corners).to_bytes(4, "little") + facets.tobytes())
    return path


def rows_of(meshes: Iterable[Mesh]) -> NDArray[np.float64]:
    """(m, k): everything that the triangles of the meshes have, sorted; missing colours are white."""
    rows = np.concatenate([_rows(mesh) for mesh in meshes])
    return rows[np.lexsort(rows.T)]


def _rows(mesh: Mesh) -> NDArray[np.float64]:
    count = len(mesh.positions)
    uvs = np.zeros((count, 2)) if mesh.uvs is None else mesh.uvs
    colors = np.full((count, 4), 255) if mesh.colors is None else mesh.colors
    vertices = np.concatenate([mesh.positions, mesh.normals, uvs, colors], axis=1)
    looks = [hash((m.name, m.base_color, m.alpha_cutoff, m.double_sided, m.unlit)) % 997 for m in mesh.materials]
    textures = [0 if m.texture is None else int(m.texture.pixels.astype(int).sum()) for m in mesh.materials]
    own = np.array([looks, textures]).T[mesh.triangle_material]
    return np.concatenate([vertices[mesh.triangles].reshape(len(mesh.triangles), -1), own], axis=1)
