"""How light falls on albedo: one formula for averaged and for single normals (OV 5.2; spec/drawing.md, Light).

All in linear light. A pixel of an orthoview holds the mean of many normals, of length l; the mean of max(0, cos) over
them is more than max(0, cos) of their mean. `lambert` is exact for a flat surface (l = 1: the cosine) and for leaves
that face everywhere (l = 0: a quarter), and smooth in between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.view.sky import Sky

SEEN_CONTRAST = -math.log(0.02)
"""What is as far away as one can see keeps a fiftieth of its contrast (Koschmieder)."""


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
    sky: tuple[int, int, int] | Literal["clear"] = (158, 191, 235)
    """sRGB bytes; "clear": a sky that follows the sun, which then also colours the sun's and the ambient light."""
    haze: float | None = None
    """Metres that one can see; None: for ever."""

    @property
    def sun(self) -> NDArray[np.float64]:
        """(3,) float64: unit vector towards the sun."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        across = math.cos(elevation)
        return np.array([math.sin(azimuth) * across, math.cos(azimuth) * across, math.sin(elevation)])

    @property
    def clear_sky(self) -> Sky | None:
        """The sky that follows the sun; None when it is of one colour."""
        return Sky.of(self.sun) if self.sky == "clear" else None

    @property
    def sky_linear(self) -> NDArray[np.float64]:
        """(3,) float64 linear light: the sky's one colour, of a clear sky that at the zenith."""
        if self.sky == "clear":
            return Sky.of(self.sun).zenith
        return linear_from_srgb(np.array(self.sky) / 255.0)

    @property
    def radiances(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3,), (3,) float64 linear light: ambient, and of the sun on what faces it."""
        ambient = self.ambient * np.array(self.ambient_color)
        sun = self.sun_strength * np.array(self.sun_color)
        sky = self.clear_sky
        return (ambient, sun) if sky is None else (ambient * sky.ambient, sun * sky.sunlight)

    @property
    def terms(self) -> NDArray[np.float32]:
        """(3, 3) float32 rows for kernels: sun vector, ambient radiance, sun radiance."""
        return np.stack([self.sun, *self.radiances]).astype(np.float32)

    def backdrop(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.float64]:
        """(3,) or (h, w, 3) float64 linear light behind everything."""
        sky = self.clear_sky
        return self.sky_linear if sky is None else sky.color(_unit(camera.rays(size)))

    def veil(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.float32]:
        """What haze does to each pixel: (h, w, 4) float32, its colour in linear light and its share a metre of depth.

        Depth is along the view axis: what shows of a surface d metres deep is exp(-share d). (0, 0, 4) without haze.
        The colour is that of the horizon, so that the farthest ground goes over into the sky.
        """
        if self.haze is None:
            return np.zeros((0, 0, 4), dtype=np.float32)
        rays, sky = camera.rays(size), self.clear_sky
        veil = np.empty((*rays.shape[:2], 4), dtype=np.float32)
        veil[..., :3] = self.sky_linear if sky is None else sky.horizon(_unit(rays))
        veil[..., 3] = np.linalg.norm(rays, axis=-1) * (SEEN_CONTRAST / self.haze)
        return veil


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


def seen_from(
    normals: NDArray[np.floating], camera: NDArray[np.floating], eye: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Mean normals of loose surfaces as another eye sees them: (..., 3), (..., 3), (..., 3) -> (..., 3).

    normals: means of normals that were turned to the camera. camera, eye: unit vectors towards either. Leaves that face
    everywhere, as seen, have a mean two thirds long that faces whoever looks: that part turns from the camera to the
    eye. The rest, as if of one flat surface, shows the eye its side. See spec/drawing.md, Light.
    """
    facing = (normals * camera).sum(-1)
    half = 1.0 - facing * 2 / 3
    root = np.sqrt(np.maximum(0.0, half * half - 5 / 9 * (1.0 - (normals * normals).sum(-1))))
    around = np.minimum(2 / 3 * np.minimum(1.0, 9 / 5 * (half - root)), facing)[..., None]
    rest = normals - around * camera
    side = np.where((rest * eye).sum(-1) < 0, -1.0, 1.0)[..., None]
    return np.asarray(side * rest + around * eye)


def radiance(
    albedo: NDArray[np.floating], normals: NDArray[np.floating], light: Light, unlit: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """(..., 3) linear albedo, (..., 3) mean normals, (...) bool -> (..., 3) linear radiance, limited to 1."""
    ambient, sun = light.radiances
    lit = albedo * (ambient + lambert(normals, light)[..., None] * sun)
    if unlit is not None:
        lit = np.where(unlit[..., None], albedo, lit)
    return np.asarray(np.clip(lit, 0.0, 1.0), dtype=np.float64)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
