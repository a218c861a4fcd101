"""Which tiles to draw a cell from, decided at bake for every view bin (OV 5.1).

The nearest directions by angle miss whole surfaces: in a city the three nearest of the sides and the top lose the
ground. A greedy cover of what is seen from a bin gains 1.4 to 3 dB over them at the same number of views.

At the leaves single tiles are chosen (a direction's first layer, its second) by what they add a byte, in place of a
number of directions: the same picture for 10 to 15 % fewer bytes. Above, both layers of a direction come together:
there the second is no longer what the first hides, but part of the same surfaces, which compositing has divided. Single
tiles lost 0.5 dB in a forest two levels up and 0.9 at statues. They are chosen by what they add for the root of their
bytes: by bytes small ones came first, which see a cell from its ends (0.5 dB at statues two levels up).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.directions import PRINCIPAL, Direction
from farfield.kernels.coverage import BEST, LOOSE, discount_hidden, draw_samples, greedy_cover, sample_layer
from farfield.octree.grid import CellKey, Grid
from farfield.represent.orthoview.layer import OrthoLayer

_One = TypeVar("_One")
_Made = TypeVar("_Made")

MOST_PICKS = 16
"""Tiles listed for a bin."""
LEAST_GAIN = 4.0
"""Pixels, of `resolution` across a cell's side, that a kilobyte of a tile must add to be listed. Viewers take those of
ten. Fewer pixels than five gain 0.1 dB or less for a quarter more bytes, and lists of more make the index larger."""
EYES = 5
"""Of a bin."""
AROUND = 1.5
"""Sizes of the cell that a small picture is wide."""
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


@dataclass(frozen=True, slots=True)
class ViewTable:
    """For each of the 26 view bins what to draw, best first."""

    picks: tuple[tuple[tuple[int, float], ...], ...]
    """(tile, gain) of up to MOST_PICKS tiles, best gain first: the place of the tile in the listing of all, ascending
    by direction and layer, and the pixels of a view that a kilobyte of it adds to those before it; above the leaves a
    direction's tiles have the same."""


@dataclass(frozen=True, slots=True)
class Shown:
    """What things, tiles or both layers of directions, show to the eyes of a bin."""

    quality: NDArray[np.uint8]
    """(things, m): how well each shows each pixel of the small pictures, 0..BEST, with LOOSE."""
    nearest: NDArray[np.float32]
    """(things, m): how far away it is, metres."""
    tolerance: np.float32
    """Metres between what is still the same surface."""

    @classmethod
    def of(cls, quality: NDArray[np.uint8], nearest: NDArray[np.float32], tolerance: np.float32) -> Shown:
        """Of small pictures, (things, eyes, p, p), without the pixels in which nothing is seen."""
        flat, away = quality.reshape(len(quality), -1), nearest.reshape(len(quality), -1)
        seen = flat.any(axis=0)
        return cls(np.compress(seen, flat, axis=1), np.compress(seen, away, axis=1), tolerance)

    def of_views(self, first: NDArray[np.int64]) -> Shown:
        """Tiles from each of `first` to the next as one thing: at each pixel the better, connected before loose."""
        ranks = 2 * (self.quality & np.uint8(LOOSE - 1)) + (self.quality < LOOSE)
        ends = [*first[1:].tolist(), len(ranks)]
        best = np.stack([a + np.argmax(ranks[a:b], axis=0) for a, b in zip(first.tolist(), ends, strict=True)])
        quality, nearest = np.take_along_axis(self.quality, best, 0), np.take_along_axis(self.nearest, best, 0)
        return Shown(quality, nearest, self.tolerance)

    def cover(self, cost: NDArray[np.float64], least: float, most: int) -> list[tuple[int, int]]:
        """Up to `most` of the things and what each adds, see greedy_cover."""
        chosen, gains = np.empty(most, np.int64), np.empty(most, np.int64)
        count = greedy_cover(self.quality, self.nearest, self.tolerance, cost, least, chosen, gains)
        return list(zip(chosen[:count].tolist(), gains[:count].tolist(), strict=True))


def choose_views(
    layers: Mapping[int, Sequence[OrthoLayer]],
    sizes: Mapping[tuple[int, int], int],
    directions: Iterable[Direction],
    grid: Grid,
    key: CellKey,
    each: Each = map,
) -> ViewTable:
    """Chooses tiles for every view bin of a cell.

    layers: the one or two layers of each baked direction by its number; directions without layers show nothing.
    sizes: bytes of the tile of each (direction, layer). Every bin gets at least one tile unless there is no layer
    at all. Deterministic. each: does the bins.
    """
    views = sorted((d for d in directions if layers.get(d.number)), key=lambda d: d.number)
    if not views:
        return ViewTable(((),) * len(PRINCIPAL))
    lower, upper = grid.bounds(key)
    middle, size = (lower + upper) / 2, float((upper - lower).max())
    step = max(1, round(size / grid.pitch(key.level) / SAMPLES_ACROSS))
    spacing = step * grid.pitch(key.level)
    samples, starts = _samples(layers, views, grid, key.level, middle, step)
    of_tile = [d for d in views for _ in layers[d.number]]
    towards = np.array([d.vector for d in of_tile], dtype=np.float32)
    cost = np.array([sizes[d.number, index] for d in views for index in range(len(layers[d.number]))], dtype=np.float64)
    first = np.cumsum([0, *(len(layers[d.number]) for d in views[:-1])])
    cost_of_views = np.add.reduceat(cost, first)
    cost_of_views = np.sqrt(cost_of_views * cost_of_views.mean())
    tolerance = np.float32(TOLERANCE * spacing)
    focal = np.float32(PICTURE * EYE_DISTANCE / AROUND)
    whole = BEST * EYES * (PICTURE / AROUND) ** 2
    unit = whole / 1000 / grid.resolution**2
    least = LEAST_GAIN * unit

    def best(vector: tuple[int, int, int]) -> tuple[tuple[int, float], ...]:
        nearest = np.empty((len(of_tile), EYES, PICTURE, PICTURE), np.float32)
        quality = np.empty(nearest.shape, np.uint8)
        for eye, looking in enumerate(_eyes(vector)):
            camera = _camera(looking, EYE_DISTANCE * size)
            draw_samples(samples, starts, towards, camera, focal, np.float32(spacing), eye, nearest, quality)
        shown = Shown.of(quality, nearest, tolerance)
        discount_hidden(shown.nearest, shown.quality, tolerance, np.float32(BEHIND))
        if key.level == 0:
            picks = [(tile, gain / cost[tile]) for tile, gain in shown.cover(cost, least, MOST_PICKS)]
        else:
            picks = [
                (tile, gain / cost_of_views[view])
                for view, gain in shown.of_views(first).cover(cost_of_views, least, MOST_PICKS // 2)
                for tile in range(first[view], first[view] + len(layers[views[view].number]))
            ]
        if not picks:
            picks = [(int(first[_nearest_by_angle(np.array([d.vector for d in views], np.float32), vector)]), 0.0)]
        return tuple((tile, gain / unit) for tile, gain in picks)

    return ViewTable(tuple(each(best, PRINCIPAL)))


def _eyes(vector: tuple[int, int, int]) -> NDArray[np.float64]:
    """(EYES, 3) directions to the eyes of a bin: its middle, and EYE_SPREAD to the sides, up and down."""
    middle = np.array(vector, dtype=np.float64)
    middle /= math.sqrt(float((middle * middle).sum()))
    u, v, _ = Direction(-1, (float(middle[0]), float(middle[1]), float(middle[2]))).axes
    spread = math.tan(math.radians(EYE_SPREAD))
    return np.array([middle, *(middle + spread * side for side in (u, -u, v, -v))])


def _nearest_by_angle(towards: NDArray[np.float32], vector: tuple[int, int, int]) -> int:
    """For a bin that sees nothing but backs: an eye elsewhere in the bin may see more."""
    x, y, z = vector
    cosine = towards[:, 0] * x + towards[:, 1] * y + towards[:, 2] * z
    return int(np.argmax(cosine))


def _samples(
    layers: Mapping[int, Sequence[OrthoLayer]],
    views: Sequence[Direction],
    grid: Grid,
    level: int,
    middle: NDArray[np.float64],
    step: int,
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """(n, 8) samples of all tiles (see sample_layer) and (tiles + 1,) where those of each begin."""
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
