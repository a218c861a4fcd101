"""Meshes for tests of everything between scene and picture."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from farfield.octree.grid import Grid
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk, merge
from farfield.scene.model import Material, Mesh

PLAIN = Material(base_color=(0.5, 0.25, 0.75, 1.0))
IDENTITY = np.eye(3, 4)


def mesh_of(shape: trimesh.Trimesh, material: Material = PLAIN, flat: bool = False) -> Mesh:
    """A Mesh of a trimesh; flat: with the normals of its faces."""
    if flat:
        positions, normals = shape.triangles.reshape(-1, 3), np.repeat(shape.face_normals, 3, axis=0)
        triangles = np.arange(len(positions)).reshape(-1, 3)
    else:
        positions, normals, triangles = shape.vertices, shape.vertex_normals, shape.faces
    return Mesh(
        np.array(positions, dtype=np.float64),
        np.array(triangles, dtype=np.uint32),
        np.array(normals, dtype=np.float32),
        (material,),
        np.zeros(len(triangles), dtype=np.uint16),
    )


def faces(corners: ArrayLike, triangles: ArrayLike, material: Material = PLAIN) -> Mesh:
    """A Mesh of flat triangles."""
    shape = trimesh.Trimesh(np.asarray(corners, dtype=np.float64), np.asarray(triangles), process=False)
    return mesh_of(shape, material, flat=True)


def rectangle(origin: ArrayLike, right: ArrayLike, up: ArrayLike, material: Material = PLAIN) -> Mesh:
    """Two triangles."""
    o, a, b = (np.asarray(v, dtype=np.float64) for v in (origin, right, up))
    return faces([o, o + a, o + a + b, o + b], [[0, 1, 2], [0, 2, 3]], material)


def chunk_of(mesh: Mesh, grid: Grid, index: tuple[int, int, int]) -> Chunk | None:
    """What of a mesh lies in a leaf."""
    return BlockedMesh.from_mesh(mesh).cell_chunk(IDENTITY, grid, index)


def chunks_of(meshes: list[Mesh], grid: Grid, first: int, last: int) -> dict[tuple[int, int, int], Chunk]:
    """All leaves first..last on every axis that hold something."""
    found = {}
    blocked = [BlockedMesh.from_mesh(m) for m in meshes]
    for x in range(first, last + 1):
        for y in range(first, last + 1):
            for z in range(first, last + 1):
                parts = [b.cell_chunk(IDENTITY, grid, (x, y, z), 0, n + 1) for n, b in enumerate(blocked)]
                there = [p for p in parts if p is not None]
                if there:
                    found[x, y, z] = merge(there)
    return found
