"""Meshes of fewer triangles, by quadric errors (fast-simplification)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Mesh
from farfield.scene.shading import body_normals


def simplify(mesh: Mesh, triangles: int) -> Mesh:
    """About as many triangles as asked for, fewer never than the mesh's form needs; normals are smooth.

    Of the first material, without texture coordinates and colours. The mesh itself when it has no more than that.
    """
    if len(mesh.triangles) <= triangles:
        return mesh
    points, faces = welded(mesh.positions, mesh.triangles)
    points, faces = _reduced(points, faces, triangles)
    return Mesh(
        positions=points,
        triangles=faces,
        normals=body_normals(points, faces),
        materials=mesh.materials[:1],
        triangle_material=np.zeros(len(faces), np.uint16),
    )


def welded(
    points: NDArray[np.float64], triangles: NDArray[np.uint32]
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Corners at the same place made one, and triangles without area left out: files split them for their normals."""
    places, which = np.unique(points, axis=0, return_inverse=True)
    faces = which.reshape(-1)[triangles].astype(np.uint32)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return places, faces[distinct]


def _reduced(
    points: NDArray[np.float64], faces: NDArray[np.uint32], triangles: int
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    import fast_simplification

    # Single precision about the middle: the library keeps float64 as float32 would.
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    found, kept = fast_simplification.simplify(
        (points - middle).astype(np.float32), faces.astype(np.int32), target_count=triangles
    )
    return found.astype(np.float64) + middle, kept.astype(np.uint32)
