"""Perspective cameras. One matrix takes local metres to pixels; the same for pictures from tiles and from geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError


@dataclass(frozen=True, slots=True)
class Camera:
    """An eye that looks at a target, z up, with square pixels.

    Raises OptionError when eye and target coincide, or the field of view is not within 0..180 degrees.
    """

    eye: tuple[float, float, float]
    """Local metres."""
    target: tuple[float, float, float]
    """Local metres; drawn at the middle of the picture."""
    fov: float = 46.8
    """Vertical field of view, degrees."""

    def __post_init__(self) -> None:
        if not np.isfinite([*self.eye, *self.target, self.fov]).all() or self.eye == self.target:
            raise OptionError("the camera needs an eye and another point as target", f"{self.eye} -> {self.target}")
        if not 0 < self.fov < 180:
            raise OptionError("the field of view must lie between 0 and 180 degrees", f"--fov {self.fov}")

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3) float64 rows right, down, forward: orthonormal, world frame.

        Looking straight up or down, north (y) is up in the picture when looking down and down when looking up.
        """
        forward = np.array(self.target, dtype=np.float64) - np.array(self.eye, dtype=np.float64)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        if np.linalg.norm(right) < 1e-9:
            right = np.array([1.0, 0.0, 0.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    def focal(self, size: tuple[int, int]) -> float:
        """Pixels that one unit at distance one covers; size is (width, height)."""
        return float(size[1] / 2 / np.tan(np.radians(self.fov) / 2))

    def matrix(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """(3, 4) float64, local metres -> (x w, y w, w) for a picture of size (width, height) pixels.

        With (X, Y, w) = matrix @ (px, py, pz, 1): column x = X / w to the right, row y = Y / w down, the centre of
        pixel (i, j) at (i + 0.5, j + 0.5); w = distance along the view axis in metres, positive before the eye.
        """
        width, height = size
        right, down, forward = self.axes
        focal = self.focal(size)
        rows = np.stack([focal * right + width / 2 * forward, focal * down + height / 2 * forward, forward])
        return np.concatenate([rows, -(rows @ np.array(self.eye, dtype=np.float64))[:, None]], axis=1)

    def rays(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """(h, w, 3) float64, world frame: from the eye through each pixel's centre, one metre along the view axis."""
        width, height = size
        y, x = np.mgrid[:height, :width] + 0.5
        return np.asarray(np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(self.matrix(size)[:, :3]).T)

    def project(self, points: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
        """(..., 3) local metres -> (..., 3) float64 x, y in pixels and w in metres; meaningless where w <= 0."""
        matrix = self.matrix(size)
        homogeneous = points @ matrix[:, :3].T + matrix[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.concatenate([homogeneous[..., :2] / homogeneous[..., 2:], homogeneous[..., 2:]], axis=-1)


def vertical_fov(horizontal: float, size: tuple[int, int]) -> float:
    """Degrees: the vertical field of view of a picture (width, height) that spans `horizontal` degrees across."""
    return float(np.degrees(2 * np.arctan(np.tan(np.radians(horizontal) / 2) * size[1] / size[0])))
