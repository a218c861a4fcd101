"""Which directions to draw a cell from, decided at bake for every view bin (OV 5.1).

The nearest directions by angle miss whole surfaces: in a city the three nearest of the sides and the top lose the
ground. A greedy cover of what is seen from a bin gains 1.4 to 3 dB over them at the same number of views.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.directions import PRINCIPAL, Direction
from farfield.kernels.coverage import draw_samples, greedy_cover, sample_layer
from farfield.octree.grid import CellKey, Grid
from farfield.represent.orthoview.layer import OrthoLayer

_One = TypeVar("_One")
_Made = TypeVar("_Made")

MOST_VIEWS = 5
"""Directions listed for a bin, best first."""
EYES = 5
"""Of a bin."""
PICTURE = 48
"""Width and height of the small pictures, pixels."""
SAMPLES_ACROSS = 48
"""Samples of a view across a cell."""
EYE_DISTANCE = 2.0
"""Of the bin's eye from the middle of the cell, in sizes of the cell. Cells are seen from 1.1 to 2.2 sizes away."""
EYE_SPREAD = 20.0
"""Degrees between the middle of a bin and its four other eyes. With one eye in the middle the bins on the horizon saw
no roofs and no ground: 1.3 dB in a city from r on, 0.3 to 0.7 two levels up, 0.15 in a forest, -0.2 to 0.3 at
statues."""
TOLERANCE = 3.0
"""Sample spacings behind the nearest surface that still count as visible."""
BEHIND = 0.6
"""What a hidden surface counts: leaves behind leaves are better than a hole. Gains 0.6 dB in a forest, costs 0.1 in a
city."""


class Each(Protocol):
    """`map`, or that of a pool of threads."""

    def __call__(self, work: Callable[[_One], _Made], things: Iterable[_One], /) -> Iterable[_Made]: ...


def choose_views(
    layers: Mapping[int, Sequence[OrthoLayer]],
    directions: Iterable[Direction],
    grid: Grid,
    key: CellKey,
    each: Each = map,
) -> tuple[tuple[int, ...], ...]:
    """For each of the 26 view bins the numbers of up to 5 directions that together show most, best first.

    layers: the one or two layers of each baked direction by its number; directions without layers show nothing.
    Every bin gets at least one direction unless there is no layer at all. Deterministic. each: does the bins.
    """
    views = [d for d in directions if layers.get(d.number)]
    if not views:
        return ((),) * len(PRINCIPAL)
    lower, upper = grid.bounds(key)
    middle, size = (lower + upper) / 2, float((upper - lower).max())
    step = max(1, round(size / grid.pitch(key.level) / SAMPLES_ACROSS))
    spacing = step * grid.pitch(key.level)
    samples, starts = _samples(layers, views, grid, key.level, middle, step)
    towards = np.array([d.vector for d in views], dtype=np.float32)
    focal = np.float32(PICTURE * EYE_DISTANCE / 1.5)

    def best(vector: tuple[int, int, int]) -> tuple[int, ...]:
        nearest = np.empty((EYES, len(views), PICTURE, PICTURE), np.float32)
        quality = np.empty_like(nearest)
        chosen = np.empty(MOST_VIEWS, np.int64)
        for eye, looking in enumerate(_eyes(vector)):
            camera = _camera(looking, EYE_DISTANCE * size)
            draw_samples(samples, starts, towards, camera, focal, np.float32(spacing), nearest[eye], quality[eye])
        count = greedy_cover(nearest, quality, np.float32(TOLERANCE * spacing), np.float32(BEHIND), chosen)
        order = [int(k) for k in chosen[:count]] or _nearest_by_angle(towards, vector)
        return tuple(views[k].number for k in order)

    return tuple(each(best, PRINCIPAL))


def _eyes(vector: tuple[int, int, int]) -> NDArray[np.float64]:
    """(EYES, 3) directions to the eyes of a bin: its middle, and EYE_SPREAD to the sides, up and down."""
    middle = np.array(vector, dtype=np.float64)
    middle /= math.sqrt(float((middle * middle).sum()))
    u, v, _ = Direction(-1, (float(middle[0]), float(middle[1]), float(middle[2]))).axes
    spread = math.tan(math.radians(EYE_SPREAD))
    return np.array([middle, *(middle + spread * side for side in (u, -u, v, -v))])


def _nearest_by_angle(towards: NDArray[np.float32], vector: tuple[int, int, int]) -> list[int]:
    """For a bin that sees nothing but backs: an eye elsewhere in the bin may see more."""
    x, y, z = vector
    cosine = towards[:, 0] * x + towards[:, 1] * y + towards[:, 2] * z
    order: list[int] = np.argsort(-cosine, kind="stable").tolist()
    return order[:MOST_VIEWS]


def _samples(
    layers: Mapping[int, Sequence[OrthoLayer]],
    views: Sequence[Direction],
    grid: Grid,
    level: int,
    middle: NDArray[np.float64],
    step: int,
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """(n, 8) samples of all views (see sample_layer) and (views + 1,) where those of each begin."""
    pitch = grid.pitch(level)
    room = sum(-(-s // step) * -(-t // step) for d in views for s, t in (la.shape for la in layers[d.number]))
    samples = np.empty((room, 8), np.float32)
    starts, count = [0], 0
    for direction in views:
        axes = direction.axes
        corner = axes @ (np.array(grid.corner) - middle)
        for layer in layers[direction.number]:
            steps = np.array([layer.x, layer.y, layer.depth_base / 8]) * pitch
            frame = np.concatenate([(corner + steps)[None], axes]).astype(np.float32)
            count += sample_layer(
                layer.depth, layer.normal, layer.coverage, layer.connected, frame, np.float32(pitch), step,
                -layer.y % step, -layer.x % step, samples[count:],
            )  # fmt: skip
        starts.append(count)
    return samples[:count], np.array(starts, dtype=np.int64)


def _camera(towards: NDArray[np.float64], away: float) -> NDArray[np.float32]:
    """(4, 3) float32 rows eye, right, down, forward of a camera that looks back along `towards` at the middle."""
    towards = towards / math.sqrt(float((towards * towards).sum()))
    axes = Direction(-1, (float(towards[0]), float(towards[1]), float(towards[2]))).axes
    return np.concatenate([(towards * away)[None], axes]).astype(np.float32)
