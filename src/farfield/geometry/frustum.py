"""What a camera can see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera


@dataclass(frozen=True, slots=True)
class Frustum:
    """The pyramid in front of an eye."""

    planes: NDArray[np.float64]
    """(5, 4) float64: left, right, top, bottom, behind; inside where (x, y, z, 1) . plane >= 0; unit normals."""

    @classmethod
    def of(cls, camera: Camera, size: tuple[int, int]) -> Frustum:
        """The frustum of a picture of size (width, height)."""
        x, y, w = camera.matrix(size)
        planes = np.stack([x, size[0] * w - x, y, size[1] * w - y, w])
        return cls(planes / np.sqrt((planes[:, :3] ** 2).sum(-1, keepdims=True)))

    def touches(self, bounds: NDArray[np.float64], margin: float = 0.0) -> bool:
        """Whether a box ((2, 3) lower and upper corner, metres), grown by the margin, may be seen.

        Never wrong about a box that is seen; a box near an edge of the pyramid may be taken though it is not.
        """
        normals, offsets = self.planes[:, :3], self.planes[:, 3]
        # The corner that reaches furthest to the inner side of each plane.
        inner = np.where(normals > 0, bounds[1] + margin, bounds[0] - margin)
        return bool(((inner * normals).sum(-1) + offsets >= 0).all())
