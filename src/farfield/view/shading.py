"""How light falls on albedo: one formula for averaged and for single normals (OV 5.2; spec/drawing.md, Light).

All in linear light. A pixel of an orthoview holds the mean of many normals, of length l; the mean of max(0, cos) over
them is more than max(0, cos) of their mean. `lambert` is exact for a flat surface (l = 1: the cosine) and for leaves
that face everywhere (l = 0: a quarter), and smooth in between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import linear_from_srgb


@dataclass(frozen=True, slots=True)
class Light:
    """A sun, an ambient term and a sky."""

    ambient: float = 0.3
    ambient_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear light."""
    sun_strength: float = 1.0
    sun_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear light."""
    azimuth: float = 225.0
    """Degrees from north, clockwise: 90 is east."""
    elevation: float = 35.0
    """Degrees above the horizon."""
    sky: tuple[int, int, int] = (158, 191, 235)
    """sRGB bytes."""

    @property
    def sun(self) -> NDArray[np.float64]:
        """(3,) float64: unit vector towards the sun."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        across = math.cos(elevation)
        return np.array([math.sin(azimuth) * across, math.cos(azimuth) * across, math.sin(elevation)])

    @property
    def sky_linear(self) -> NDArray[np.float64]:
        """(3,) float64 linear light."""
        return linear_from_srgb(np.array(self.sky) / 255.0)

    @property
    def terms(self) -> NDArray[np.float32]:
        """(3, 3) float32 rows for kernels: sun vector, ambient radiance, sun radiance."""
        ambient = self.ambient * np.array(self.ambient_color)
        return np.stack([self.sun, ambient, self.sun_strength * np.array(self.sun_color)]).astype(np.float32)


def lambert(normals: NDArray[np.floating], light: Light) -> NDArray[np.float64]:
    """(..., 3) mean normals (length up to 1) that face the eye -> (...) mean of max(0, cos) to the sun.

    Exact for a flat surface (length 1), for normals spread evenly over a half space (1/2) and over all directions (0),
    within 2.5 % for leaves as they are seen (2/3: over a half space, by the area they show). See spec/drawing.md.
    """
    mu = normals @ light.sun
    length = np.sqrt((normals * normals).sum(-1))
    cosine = mu / np.maximum(length, 0.5)
    spread = np.maximum(0.0, 1.0 - length) * (0.36 + 0.28 * length)
    narrow = 0.5 * (mu + np.sqrt(mu * mu + spread * np.maximum(0.0, 1.0 - cosine * cosine)))
    return np.asarray(np.where(length <= 0.5, 0.25 + 0.5 * mu, narrow), dtype=np.float64)


def radiance(
    albedo: NDArray[np.floating], normals: NDArray[np.floating], light: Light, unlit: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """(..., 3) linear albedo, (..., 3) mean normals, (...) bool -> (..., 3) linear radiance, limited to 1."""
    ambient = light.ambient * np.array(light.ambient_color)
    sun = light.sun_strength * np.array(light.sun_color)
    lit = albedo * (ambient + lambert(normals, light)[..., None] * sun)
    if unlit is not None:
        lit = np.where(unlit[..., None], albedo, lit)
    return np.asarray(np.clip(lit, 0.0, 1.0), dtype=np.float64)
