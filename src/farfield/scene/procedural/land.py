"""Rolling land: heights on a grid, flattened under towns, with colours by use and slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.model import Mesh, Texture
from farfield.scene.procedural.noise import tiling_noise

HILL = 700.0
"""Metres: longest waves of the land."""
GRASS, MEADOW, FIELD, FLOOR, ROCK, PAVED = (
    np.array(c, np.float64)
    for c in ((98, 118, 62), (122, 132, 72), (164, 146, 96), (78, 76, 50), (128, 122, 112), (132, 128, 122))
)


@dataclass(frozen=True, slots=True, eq=False)
class Land:
    """A square of land. Row is y, column is x."""

    step: float
    """Metres between samples."""
    height: NDArray[np.float64]
    """(n + 1, n + 1) metres."""
    forest: NDArray[np.float64]
    """(n + 1, n + 1), above 0 where forest grows."""
    towns: NDArray[np.float64]
    """(t, 3) x, y, radius in metres."""

    @property
    def side(self) -> float:
        """Metres."""
        return self.step * (len(self.height) - 1)

    def height_at(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) height at x, y, on the two triangles of each square exactly as `tile` splits it."""
        cell = np.clip(places / self.step, 0, len(self.height) - 1 - 1e-9)
        column, row = np.floor(cell).astype(int).T
        fx, fy = (cell - np.floor(cell)).T
        h = self.height
        a, b, c, d = h[row, column], h[row, column + 1], h[row + 1, column + 1], h[row + 1, column]
        return np.asarray(np.where(fx >= fy, a + (b - a) * fx + (c - b) * fy, a + (c - d) * fx + (d - a) * fy))

    def in_towns(self, places: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.bool_]:
        """(k,): within a town's radius and the margin."""
        if not len(self.towns):
            return np.zeros(len(places), bool)
        distance = np.hypot(*(places[:, None] - self.towns[None, :, :2]).transpose(2, 0, 1))
        return np.asarray((distance < self.towns[:, 2] + margin).any(axis=1))


def roll(side: float, step: float, relief: float, forest_share: float, towns: int, seed: int) -> Land:
    """Land of that side in metres whose heights deviate by `relief`; towns lie at least two radii apart."""
    count = max(int(np.ceil(side / step)), 2)
    random = np.random.default_rng(seed)
    waves = max(round(side / HILL), 1)
    height = relief * _field(count, 2.2, waves, seed + 1) + 0.05 * relief * _field(count, 1.0, 8 * waves, seed + 2)
    height -= height.min()
    cover = _field(count, 1.6, waves, seed + 3)
    forest = cover - np.quantile(cover, 1 - forest_share) if forest_share > 0 else np.full_like(cover, -1.0)
    places = _towns(side, towns, random)
    _flatten(height, forest, places, side / count)
    return Land(side / count, height, forest, places)


def tile(land: Land, low: tuple[int, int], high: tuple[int, int]) -> Mesh:
    """The land between two corners (row, column), in the land's own frame."""
    rows, columns = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
    y, x = np.meshgrid(np.arange(low[0], high[0] + 1) * land.step, np.arange(low[1], high[1] + 1) * land.step,
                       indexing="ij")  # fmt: skip
    points = np.stack([x, y, land.height[rows, columns]], -1).reshape(-1, 3)
    dy = np.gradient(land.height, land.step, axis=0)[rows, columns]
    dx = np.gradient(land.height, land.step, axis=1)[rows, columns]
    normals = np.stack([-dx, -dy, np.ones_like(dx)], -1).reshape(-1, 3)
    width = high[1] - low[1] + 1
    corner = (np.arange(high[0] - low[0])[:, None] * width + np.arange(width - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + width + 1, corner + width
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    colors = _colors(land, points, land.forest[rows, columns].ravel(), np.hypot(dx, dy).ravel())
    return assemble(RawSurface(points, faces, normals=normals, colors=colors), "land")


def painted(land: Land, low: tuple[int, int], high: tuple[int, int], texels: int) -> Texture:
    """The colours of the land between two corners (row, column) as a square texture; row 0 lies in the south.

    The middles of the outer texels lie on the edges, so that neighbours have the same there.
    """
    count = len(land.height) - 1
    steps = np.arange(texels) / (texels - 1)
    rows, columns = (low[a] + steps * (high[a] - low[a]) for a in (0, 1))
    y, x = np.meshgrid(rows * land.step, columns * land.step, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    near = np.ix_(np.clip(np.rint(rows), 0, count).astype(int), np.clip(np.rint(columns), 0, count).astype(int))
    dy, dx = np.gradient(land.height, land.step)
    colors = _colors(land, points, land.forest[near].ravel(), np.hypot(dx, dy)[near].ravel())
    return Texture(colors.reshape(texels, texels, 4))


def _field(count: int, exponent: float, lowest: int, seed: int) -> NDArray[np.float64]:
    """(count + 1, count + 1) noise; its sides do not meet, which tiling_noise of a longer side sees to."""
    return tiling_noise(count + 1 + count // 8, exponent, lowest, seed)[: count + 1, : count + 1]


def _towns(side: float, count: int, random: np.random.Generator) -> NDArray[np.float64]:
    found: list[tuple[float, float, float]] = []
    for _ in range(200 * count):
        radius = float(random.uniform(0.08, 0.13) * min(side, 3000.0))
        x, y = random.uniform(radius * 1.2, side - radius * 1.2, 2)
        if len(found) < count and all(np.hypot(x - a, y - b) > 1.6 * (radius + r) for a, b, r in found):
            found.append((float(x), float(y), radius))
    return np.array(found).reshape(-1, 3)


def _flatten(height: NDArray[np.float64], forest: NDArray[np.float64], towns: NDArray[np.float64], step: float) -> None:
    """In place: towns stand on land three quarters flatter, and no forest grows in them."""
    grid = np.arange(len(height)) * step
    for x, y, radius in towns:
        distance = np.hypot(grid[None] - x, grid[:, None] - y) / radius
        weight = np.clip((1.5 - distance) / 0.5, 0, 1)
        weight = 0.75 * weight * weight * (3 - 2 * weight)
        height += weight * (height[distance < 1].mean() - height)
        forest[distance < 1.1] = -1.0


def _colors(
    land: Land, points: NDArray[np.float64], forest: NDArray[np.float64], slope: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """(n, 4) uint8 sRGB."""
    x, y = points[:, 0], points[:, 1]
    # Fields are strips of 90 m x 140 m, each of a colour drawn from its place.
    strip = (np.floor(x / 90 + 0.3 * np.sin(y / 400)).astype(np.int64) * 7919
             + np.floor(y / 140).astype(np.int64) * 104729) % 97 / 97.0  # fmt: skip
    color = np.where((strip < 0.35)[:, None], GRASS, np.where((strip < 0.7)[:, None], MEADOW, FIELD))
    color = _blend(color, FLOOR, np.clip(forest * 6 + 0.5, 0, 1))
    color = _blend(color, ROCK, np.clip((slope - 0.45) * 6, 0, 1))
    color = _blend(color, PAVED, land.in_towns(points[:, :2]).astype(np.float64) * 0.8)
    grain = 1 + 0.07 * np.sin(x * 0.37 + 3 * np.sin(y * 0.11)) * np.sin(y * 0.41 + 2 * np.sin(x * 0.07))
    out = np.full((len(points), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.floor(color * grain[:, None] + 0.5), 0, 255)
    return out


def _blend(color: NDArray[np.float64], other: NDArray[np.float64], share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(color + (other - color) * share[:, None])
