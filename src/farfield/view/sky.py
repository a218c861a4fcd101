"""A clear sky that follows the sun, and the light that falls from it (spec/drawing.md, Sky).

Four colours are found once from the sun's height; the sky in any direction is a few exponentials of them. They are
chosen to look like a clear day, a low sun and a night, at a cost that a graphics card does not notice: no physics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rgb = NDArray[np.float64]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_DAY = np.array([[0.13, 0.27, 0.62], [0.52, 0.66, 0.85], [0.52, 0.66, 0.85]])
_DUSK = np.array([[0.07, 0.11, 0.24], [0.66, 0.36, 0.18], [0.24, 0.21, 0.27]])
_NIGHT = np.array([[0.004, 0.006, 0.014], [0.012, 0.015, 0.028], [0.012, 0.015, 0.028]])
"""Linear light at the zenith, at the horizon below the sun and at the horizon opposite it."""
_AIR = np.array([0.022, 0.06, 0.14])
"""What a sun loses by channel on its way through one more atmosphere."""
_NIGHT_LIGHT = 0.12
"""What is left of the ambient light at night: enough to find one's way."""
_TINT = 0.35
"""How much of the sky's colour its light has: eyes take the rest for white."""
_FALL = 5.0
"""How fast the horizon's colour gives way to the zenith's, by sine of the height."""
_DISC = np.cos(np.radians([0.5, 0.35]))
"""Where the disc of the sun begins, and where it is full."""


@dataclass(frozen=True, slots=True)
class Sky:
    """A clear sky for one height of the sun."""

    sun: Rgb
    """(3,) unit vector towards the sun."""
    zenith: Rgb
    """(3,) linear light, as the next three."""
    towards: Rgb
    """At the horizon below the sun."""
    away: Rgb
    """At the horizon opposite the sun."""
    sunlight: Rgb
    """Colour of the sun: about white by day, red when it is low, black once it has set."""

    @classmethod
    def of(cls, sun: Rgb) -> Sky:
        """sun: (3,) unit vector towards the sun."""
        height = float(sun[2])
        day, dusk = _smooth(-0.12, 0.2, height), math.exp(-((height / 0.2) ** 2))
        zenith, towards, away = _NIGHT + day * (_DAY + dusk * (_DUSK - _DAY) - _NIGHT)
        up = max(height, 0.0)
        air = 1.0 / (up + 0.025 * math.exp(-11.0 * up))
        return cls(sun, zenith, towards, away, np.exp(-(air - 1.0) * _AIR) * _smooth(-0.02, 0.02, height))

    @property
    def ambient(self) -> Rgb:
        """(3,) colour of the light from all of the sky, with a luminance of 1 by day."""
        mean = (self.zenith + (self.towards + self.away) / 2) / 2
        noon = (_DAY[0] + _DAY[1]) / 2 @ _LUMINANCE
        light = mean @ _LUMINANCE
        tinted = light + _TINT * (mean - light)
        return np.asarray(_NIGHT_LIGHT + (1 - _NIGHT_LIGHT) * tinted / noon)

    def horizon(self, towards: NDArray[np.floating]) -> Rgb:
        """(..., 3) unit vectors -> (..., 3) linear light of the horizon in that direction, glow included."""
        cosine = (towards @ self.sun)[..., None]
        return self._lit(cosine, self.away + (self.towards - self.away) * (0.5 + 0.5 * cosine))

    def color(self, towards: NDArray[np.floating]) -> Rgb:
        """(..., 3) unit vectors -> (..., 3) linear light. Below the horizon it is the horizon's."""
        cosine = (towards @ self.sun)[..., None]
        horizon = self.away + (self.towards - self.away) * (0.5 + 0.5 * cosine)
        height = np.maximum(towards[..., 2:], 0.0)
        seen = self.zenith + (horizon - self.zenith) * np.exp(-_FALL * height)
        disc = _smooth_all(_DISC[0], _DISC[1], cosine) * (towards[..., 2:] > 0)
        return np.asarray(np.minimum(self._lit(cosine, seen) + 2.0 * disc * self.sunlight, 1.0))

    def _lit(self, cosine: NDArray[np.floating], color: Rgb) -> Rgb:
        glow = 0.15 * np.exp(-12.0 * (1.0 - cosine)) + 0.5 * np.exp(-300.0 * (1.0 - cosine))
        return np.asarray(np.minimum(color + glow * self.sunlight, 1.0))


def _smooth(first: float, last: float, value: float) -> float:
    return float(_smooth_all(first, last, np.array(value)))


def _smooth_all(first: float, last: float, value: NDArray[np.floating]) -> NDArray[np.float64]:
    share = np.clip((value - first) / (last - first), 0.0, 1.0)
    return np.asarray(share * share * (3 - 2 * share))
