"""Mesh files made into statues of a size and a number of triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from farfield.scene.model import Material, Mesh
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_source
from farfield.scene.simplify import simplify


def statue(path: Path, triangles: int, size: float) -> Mesh:
    """A mesh file, all its parts, reduced and stood on z = 0. Raises InputError when it cannot be read."""
    scene = read_source(path, ReadOptions())
    points, faces, count = [], [], 0
    for row, transform in zip(scene.instances.mesh, scene.instances.transform, strict=True):
        mesh = scene.meshes[row].load()
        points.append(mesh.positions @ transform[:, :3].T + transform[:, 3])
        faces.append(mesh.triangles + np.uint32(count))
        count += len(mesh.positions)
    whole = Mesh(
        positions=np.concatenate(points),
        triangles=np.concatenate(faces).astype(np.uint32),
        normals=np.zeros((count, 3), np.float32),
        materials=(Material("stone", (0.5, 0.48, 0.44, 1.0)),),
        triangle_material=np.zeros(sum(map(len, faces)), np.uint16),
    )
    return standing(simplify(whole, triangles), size)


def standing(mesh: Mesh, size: float) -> Mesh:
    """As high as that, metres, or as wide, whichever is less; its foot in the middle of z = 0."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    points = (mesh.positions - foot) * (size / (high - low).max())
    return Mesh(points, mesh.triangles, mesh.normals, mesh.materials, mesh.triangle_material, colors=mesh.colors)
