"""A scene by the cells of a quadtree: what stands in each leaf cell, by the middle of what it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Mesh, Scene
from mesh_levels.glb import placed, subset

Cell = tuple[int, int]
"""Column and row of a leaf cell."""


@dataclass(slots=True)
class Contents:
    """A scene, taken apart."""

    kinds: dict[str, Mesh] = field(default_factory=dict)
    """Meshes that are placed many times, in their own frame."""
    placements: dict[Cell, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    """Cell -> kind -> (n, 3, 4) transforms."""
    unique: dict[Cell, list[Mesh]] = field(default_factory=dict)
    """Cell -> meshes that stand once, in the scene's frame."""
    ground: list[Mesh] = field(default_factory=list)


def taken_apart(scene: Scene, corner: NDArray[np.float64], size: float) -> Contents:
    """corner: (2,) of cell (0, 0), metres. size: of a leaf cell, metres."""
    found = Contents()
    for row, source in enumerate(scene.meshes):
        mesh, transforms = source.load(), scene.instances.transform[scene.instances.mesh == row]
        name = source.name.rpartition("/")[2]
        if name.startswith("ground"):
            found.ground += [placed(mesh, transform) for transform in transforms]
        elif len(transforms) > 1:
            found.kinds[name] = mesh
            for cell, own in _sorted(_middles(mesh, transforms), corner, size).items():
                found.placements.setdefault(cell, {})[name] = transforms[own]
        else:
            _share_out(placed(mesh, transforms[0]), found, corner, size)
    return found


def above(cells: list[Cell], level: int) -> dict[Cell, list[Cell]]:
    """Cell of a level -> the leaf cells below it."""
    found: dict[Cell, list[Cell]] = {}
    for x, y in sorted(cells):
        found.setdefault((x >> level, y >> level), []).append((x, y))
    return found


def _share_out(mesh: Mesh, found: Contents, corner: NDArray[np.float64], size: float) -> None:
    """Each object of a mesh into the cell of its middle."""
    objects = np.zeros(len(mesh.triangles), np.int64) if mesh.triangle_object is None else mesh.triangle_object
    points = mesh.positions[mesh.triangles].mean(1)[:, :2]
    count = np.maximum(np.bincount(objects, minlength=mesh.object_count), 1)
    middles = np.stack([np.bincount(objects, points[:, k], mesh.object_count) / count for k in (0, 1)], 1)
    for cell, own in _sorted(middles, corner, size).items():
        chosen = np.zeros(mesh.object_count, bool)
        chosen[own] = True
        if chosen[objects].any():
            found.unique.setdefault(cell, []).append(subset(mesh, chosen[objects]))


def _middles(mesh: Mesh, transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    middle = (mesh.positions.min(0) + mesh.positions.max(0)) / 2
    return (transforms[:, :, :3] @ middle + transforms[:, :, 3])[:, :2]


def _sorted(points: NDArray[np.float64], corner: NDArray[np.float64], size: float) -> dict[Cell, NDArray[np.int64]]:
    keys = np.floor((points - corner) / size).astype(np.int64)
    cells, which = np.unique(keys, axis=0, return_inverse=True)
    return {(int(x), int(y)): np.flatnonzero(which.ravel() == k) for k, (x, y) in enumerate(cells)}
