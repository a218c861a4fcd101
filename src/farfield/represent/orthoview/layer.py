"""One depth layer of one orthoview, decoded: what kernels read and write and what a tile stores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

DEPTH_STEPS_PER_PIXEL = 8
"""Depth is stored in steps of pitch / 8: at most pitch / 16 of rounding error."""
COVERAGE_STEPS = 16
"""Coverage is stored in sixteenths: with eighths a canopy of 30 % cover rounds to 25 % and stays there."""
LENGTH_STEPS = 8
"""Length of the averaged normal, in eighths."""
SEPARATION = 4
"""Delta z, pixel pitches: surfaces nearer together than this belong to one layer, in leaves and in compositing."""


@dataclass(frozen=True, slots=True)
class OrthoLayer:
    """Pixels of one layer inside their bounding rectangle on the lattice of a direction and level.

    Pixel (row j, column i) is centred at u = (x + i + 0.5) pitch, v = (y + j + 0.5) pitch, and its surface at
    w = (depth_base + depth) pitch / 8, all measured from the grid's corner along the direction's axes.
    """

    x: int
    """Lattice column of the first column of the arrays."""
    y: int
    """Lattice row of the first row."""
    depth_base: int
    """Depth steps of code 0."""
    depth: NDArray[np.uint16]
    """(h, w) uint16, 0 = nothing there."""
    color: NDArray[np.uint8]
    """(h, w, 3) uint8 sRGB albedo; meaningless where depth is 0."""
    normal: NDArray[np.uint8]
    """(h, w, 2) uint8 hemi-octahedral codes 0..63 in the frame (u, v, -w)."""
    length: NDArray[np.uint8]
    """(h, w) uint8 1..8: length of the mean normal in eighths."""
    coverage: NDArray[np.uint8]
    """(h, w) uint8 1..16: filled share of the pixel in sixteenths; 0 where depth is 0."""
    connected: NDArray[np.uint8]
    """(h, w) uint8: 1 when the pixel is part of a surface (OV 5.2), 2 when its material is unlit (bits)."""
    objects: NDArray[np.uint32] | None = None
    """(h, w) uint32 object id of the nearest surface, 0 = none; None when ids are not kept."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows, columns."""
        rows, columns = self.depth.shape
        return rows, columns

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(h, w) bool: where there is a surface."""
        return self.depth > 0
