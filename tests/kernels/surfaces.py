"""Small surfaces and materials for kernel tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.surface import Materials, Surface
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Texture

PLAIN = MaterialTable.build([Material(base_color=(0.5, 0.25, 0.75, 1.0))])


def surface_of(
    triangles: NDArray[np.uint32],
    corners: int,
    uvs: NDArray[np.float32] | None = None,
    positions: NDArray[np.float32] | None = None,
    materials: NDArray[np.uint32] | None = None,
) -> Surface:
    """A surface with these triangles; whatever is not given is 0."""
    count = len(triangles)
    normals = np.tile(np.array([0, 0, 1], dtype=np.float32), (corners, 1))
    return Surface(
        np.zeros((corners, 3), dtype=np.float32) if positions is None else positions,
        normals,
        np.empty((0, 2), dtype=np.float32) if uvs is None else uvs,
        np.empty((0, 4), dtype=np.uint8),
        np.ascontiguousarray(triangles, dtype=np.uint32),
        np.zeros(count, dtype=np.uint32) if materials is None else materials,
        np.arange(1, count + 1, dtype=np.uint32),
    )


def masked(pixels: NDArray[np.uint8], cutoff: float = 0.5) -> Materials:
    """Row 0 opaque, row 1 cut out by the texture's alpha."""
    materials = [Material(), Material(texture=Texture(pixels), alpha_cutoff=cutoff)]
    return MaterialTable.build(materials).arrays
