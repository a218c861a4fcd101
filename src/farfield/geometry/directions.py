"""Canonical directions and the image axes that belong to each (OV 4.1).

A direction is the unit vector from the surface *towards* the canonical camera: the top view is (0, 0, 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from farfield.errors import OptionError

PRINCIPAL: tuple[tuple[int, int, int], ...] = tuple(
    (x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)
)
"""The 26 principal directions of a cube; a direction's number is its place in this tuple."""

TOP = PRINCIPAL.index((0, 0, 1))
_SIDES = tuple(n for n, d in enumerate(PRINCIPAL) if d[2] == 0 and abs(d[0]) + abs(d[1]) == 1)
_VERTICAL_EDGES = tuple(n for n, d in enumerate(PRINCIPAL) if d[2] == 0 and abs(d[0]) + abs(d[1]) == 2)
_UPPER_EDGES = tuple(n for n, d in enumerate(PRINCIPAL) if d[2] == 1 and abs(d[0]) + abs(d[1]) == 1)
_UPPER_CORNERS = tuple(n for n, d in enumerate(PRINCIPAL) if d[2] == 1 and abs(d[0]) + abs(d[1]) == 2)

PRESETS: dict[str, tuple[int, ...]] = {
    "5": (*_SIDES, TOP),
    "9": (*_SIDES, *_UPPER_EDGES, TOP),
    "9c": (*_SIDES, *_UPPER_CORNERS, TOP),
    "13": (*_SIDES, *_UPPER_EDGES, *_UPPER_CORNERS, TOP),
    "17": (*_SIDES, *_VERTICAL_EDGES, *_UPPER_EDGES, *_UPPER_CORNERS, TOP),
    "26": tuple(range(26)),
}
"""Named sets of direction numbers (see DESIGN in docs/concepts.md)."""


@dataclass(frozen=True, slots=True)
class Direction:
    """One canonical direction with its right-handed image frame.

    u points to the right in the image and is horizontal, v points down, w points away from the canonical
    camera (w = -vector), so depth grows along w. u, v, w are orthonormal rows and v = w x u.
    """

    number: int
    """0..25 for PRINCIPAL; from 26 on for custom unit vectors, in the order they were listed."""
    vector: tuple[float, float, float]
    """Unit vector from the surface towards the canonical camera."""

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3) float64, rows u, v, w."""
        e = np.array(self.vector)
        if abs(e[0]) < 1e-9 and abs(e[1]) < 1e-9:
            u = np.array([1.0, 0.0, 0.0])
        else:
            u = np.array([-e[1], e[0], 0.0])
            u /= np.sqrt(u[0] * u[0] + u[1] * u[1])
        w = -e
        v = np.array([w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]])
        return np.stack([u, v, w])


def principal(number: int) -> Direction:
    """The principal direction of that number, 0..25."""
    d = PRINCIPAL[number]
    length = float(np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]))
    return Direction(number, (d[0] / length, d[1] / length, d[2] / length))


def parse(preset: str) -> tuple[Direction, ...]:
    """Directions from a preset name or a list of unit vectors.

    `preset` is a key of PRESETS, or presets and vectors joined by "+", a vector being "x,y,z": `9+0.3,0,0.9`.
    Raises OptionError for an unknown name or a zero vector.
    """
    chosen: list[Direction] = []
    custom: list[ArrayLike] = []
    for part in preset.split("+"):
        if part in PRESETS:
            chosen += [principal(n) for n in PRESETS[part] if all(n != c.number for c in chosen)]
        else:
            custom.append(_vector(part))
    for k, vector in enumerate(custom):
        x, y, z = np.asarray(vector, dtype=np.float64)
        chosen.append(Direction(26 + k, (float(x), float(y), float(z))))
    return tuple(sorted(chosen, key=lambda d: d.number))


def _vector(text: str) -> NDArray[np.float64]:
    hint = f"presets are {', '.join(PRESETS)}; a vector is three numbers, x,y,z"
    try:
        vector = np.array([float(t) for t in text.split(",")])
    except ValueError:
        raise OptionError("unknown set of directions", f"--directions {text!r}", hint) from None
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise OptionError("not a direction", f"--directions {text!r}", hint)
    return np.asarray(vector / np.sqrt((vector * vector).sum()))
