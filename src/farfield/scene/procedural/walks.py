"""Walks through made scenes, recorded as a viewer would: straight lines with stops, and turns at their corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FPS = 10
EYE = 1.7
"""Metres above the ground."""
TURN = np.radians(60.0)
"""Radians a second at corners."""
FOV = 45.0
"""Vertical, degrees."""


@dataclass(frozen=True, slots=True)
class Walk:
    """A way, and when it is gone."""

    way: Floats
    """(n, 2) metres, its corners."""
    seconds: float
    stops: Sequence[tuple[float, float]] = ()
    """Begin and end of each, seconds."""

    def recorded(self, ground: Callable[[Floats], Floats]) -> dict[str, object]:
        """As paths are stored. ground: heights, (k,), of places, (k, 2), metres."""
        legs = np.linalg.norm(np.diff(self.way, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(legs)])
        frames = []
        heading = _heading(self.way[0], self.way[1])
        for n in range(round(self.seconds * FPS)):
            t = n / FPS
            gone = self._moving(t) / self._moving(self.seconds) * ends[-1]
            leg = min(int(np.searchsorted(ends, gone, side="right")) - 1, len(legs) - 1)
            at = self.way[leg] + (self.way[leg + 1] - self.way[leg]) * (gone - ends[leg]) / legs[leg]
            # A turn takes its time.
            by = (_heading(self.way[leg], self.way[leg + 1]) - heading + np.pi) % (2 * np.pi) - np.pi
            heading += float(np.clip(by, -TURN / FPS, TURN / FPS))
            ahead = at + np.array([np.cos(heading), np.sin(heading)]) * 10
            height = float(ground(at[None])[0]) + EYE
            frames.append({"t": t, "eye": [*at.tolist(), height], "target": [*ahead.tolist(), height], "fov": FOV})
        return {"fps": FPS, "frames": frames}

    def _moving(self, t: float) -> float:
        """Seconds of the first t in which the walk goes on."""
        return t - sum(min(max(t - begin, 0.0), end - begin) for begin, end in self.stops)


def beside(way: Floats, places: Floats, clear: float) -> Floats:
    """Places moved off a way, (n, 2) metres, until they are `clear` metres from it."""
    found = places.copy()
    for _ in range(len(way)):
        for a, b in pairwise(way):
            along = np.clip((found - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            away = found - (a + along[:, None] * (b - a))
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            aside = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
            out = np.where(distance > 1e-6, away / np.maximum(distance, 1e-6), aside)
            found = np.where(distance < clear, found + out * (clear - distance), found)
    return found


def _heading(a: Floats, b: Floats) -> float:
    """Radians from east."""
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))
