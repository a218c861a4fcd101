"""The plain twin of kernels.raycast: a ray goes from texel to texel and never leaps (spec/drawing.md, BlockMaps)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from farfield.represent.blockmap.blockmap import BlockMap
from farfield.view.blockmaps import MARGIN

WEST, EAST, SOUTH, NORTH, BELOW, ABOVE, BEGAN = range(7)
"""By what a ray comes into a texel."""


@dataclass(frozen=True, slots=True)
class Hit:
    """What a ray meets."""

    t: float
    texel: tuple[int, int]
    """Column and row."""
    side: int | None
    """None: the top, or the floor, which looks as it does."""
    color: tuple[int, int, int]
    normal: tuple[float, float, float]
    is_close: bool
    """By as little as rounding takes it may be another texel of the image."""


class PlainCaster:
    """Casts rays through one map. Metres from its cell's lower corner."""

    def __init__(self, blockmap: BlockMap, width: float, depth: float) -> None:
        self.map, self.n = blockmap, blockmap.size.side
        self.texel = width / self.n, depth / self.n
        self.tops = blockmap.heights.astype(np.float64)
        self.slopes = np.zeros((self.n, self.n, 2))
        if blockmap.slopes is not None:
            self.slopes = blockmap.slopes / 32
        self.floors = np.full((self.n, self.n), -np.inf)
        if blockmap.floors is not None:
            metres = blockmap.low + (blockmap.floors.astype(np.float64) - 1) * blockmap.step
            self.floors[blockmap.floors > 1] = metres[blockmap.floors > 1]
        rise = np.abs(self.slopes * self.texel).sum(axis=-1) / 2
        margin = self.texel[0] / MARGIN
        self.box = np.array([[0, 0, blockmap.low - margin], [width, depth, np.nanmax(self.tops + rise) + margin]])
        self.azimuths = blockmap.azimuths

    def cast(self, eye: NDArray[np.float64], ray: NDArray[np.float64], box: NDArray[np.float64] | None) -> Hit | None:
        """box: (2, 3) to which the ray is cut besides."""
        box = self.box if box is None else np.array([np.maximum(self.box[0], box[0]), np.minimum(self.box[1], box[1])])
        enter, leave, by = 0.0, math.inf, BEGAN
        for axis in range(3):
            if ray[axis] == 0:
                if not box[0, axis] <= eye[axis] <= box[1, axis]:
                    return None
                continue
            ends = sorted((box[:, axis] - eye[axis]) / ray[axis])
            if ends[0] > enter:
                enter, by = ends[0], 2 * axis + (ray[axis] < 0)
            leave = min(leave, ends[1])
        if enter >= leave:
            return None
        crossings = [(enter, by), (leave, BEGAN)]
        for axis in range(2):
            for line in range(self.n + 1):
                if ray[axis] != 0:
                    t = (line * self.texel[axis] - eye[axis]) / ray[axis]
                    if enter < t < leave:
                        crossings.append((t, 2 * axis + int(ray[axis] < 0)))
        crossings.sort()
        for (t, came), (end, _) in pairwise(crossings):
            middle = eye + (t + end) / 2 * ray
            i, j = (min(max(math.floor(middle[axis] / self.texel[axis]), 0), self.n - 1) for axis in range(2))
            if self.map.codes[j, i] == 0:
                continue
            above, then = (self._above(eye + at * ray, i, j) for at in (t, end))
            floor = self.floors[j, i]
            if above < 0 and eye[2] + t * ray[2] < floor:
                if eye[2] + end * ray[2] > floor:
                    return self._on_top(float((floor - eye[2]) / ray[2]), (i, j), None)
                continue
            if above < 0 and came == BEGAN:
                continue
            if above < 0 and came != ABOVE:
                return self._on_side(eye + t * ray, t, (i, j), came)
            if above < 0 or then < 0:
                t += (end - t) * max(above, 0) / (above - then) if above > 0 else 0
                return self._on_top(t, (i, j), None)
        return None

    def _above(self, point: NDArray[np.float64], i: int, j: int) -> float:
        x, y = (point[axis] - (at + 0.5) * self.texel[axis] for axis, at in enumerate((i, j)))
        return float(point[2] - self.tops[j, i] - x * self.slopes[j, i, 0] - y * self.slopes[j, i, 1])

    def _on_top(self, t: float, texel: tuple[int, int], side: int | None) -> Hit:
        i, j = texel
        normal = np.array([*-self.slopes[j, i], 1.0])
        normal /= np.linalg.norm(normal)
        return Hit(t, texel, side, tuple(self.map.colors[j, i].tolist()), tuple(normal.tolist()), False)

    def _on_side(self, point: NDArray[np.float64], t: float, texel: tuple[int, int], side: int) -> Hit:
        i, j = texel
        own = self.map.unfolded
        if side > NORTH or not own.is_wall[j, i, side]:
            return self._on_top(t, texel, side)
        low, step = self.map.low, self.map.step
        upper, lower = low + 254 * step, low
        if self.map.by_area:
            x, y = i + (-1, 1, 0, 0)[side], j + (0, 0, -1, 1)[side]
            beside = 0 <= x < self.n and 0 <= y < self.n and self.map.codes[y, x] > 0
            upper, lower = self.tops[j, i], max(self.tops[y, x] if beside else low, self.floors[j, i])
        axis = 1 if side < SOUTH else 0
        across = (point[axis] / self.texel[axis] - texel[axis]) * own.across
        first, top, rows = own.places[j, i, side].tolist()
        down = rows * (upper - point[2]) / max(upper - lower, 1e-9)
        row, column = (min(max(math.floor(at), 0), most - 1) for at, most in ((down, rows), (across, own.across)))
        color = self.map.colors[top + row, self.n + first + column]
        angle = float(self.azimuths[j, i, side])
        is_close = any(abs(at - round(at)) < 1e-3 for at in (down, across))
        return Hit(t, texel, side, tuple(color.tolist()), (math.cos(angle), math.sin(angle), 0.0), is_close)
