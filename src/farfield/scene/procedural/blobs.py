"""Intricate closed bodies: spheres warped and displaced by waves of several lengths, coloured by the same waves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.model import Mesh

_WAVES = 14
_PALETTES = np.array([[[196, 160, 108], [92, 74, 60]], [[148, 164, 132], [60, 84, 76]], [[188, 108, 84], [96, 56, 60]],
                      [[150, 156, 170], [72, 80, 104]], [[206, 196, 172], [120, 104, 88]]], np.float64)  # fmt: skip


def blob(triangles: int, diameter: float, seed: int) -> Mesh:
    """A closed mesh of about `triangles` triangles, within a few per cent, that fits a cube of `diameter` metres."""
    steps = max(round((triangles / 12) ** 0.5), 2)
    directions, faces = cube_sphere(steps)
    random = np.random.default_rng(seed)
    warp = np.stack([_waves(directions, random, 1.5, 4) for _ in range(3)], -1)
    turned = directions + 0.35 * warp
    relief = 0.30 * _waves(turned, random, 3, 3) + 0.10 * _waves(turned, random, 9, 3)
    relief += 0.03 * _waves(turned, random, 30, 3)
    points = directions * np.exp(relief)[:, None] + 0.2 * warp
    low, high = points.min(axis=0), points.max(axis=0)
    points = (points - (low + high) / 2) * (diameter / (high - low).max())
    light, dark = _PALETTES[seed % len(_PALETTES)]
    share = 1 / (1 + np.exp(-8 * relief - 1.5 * _waves(turned, random, 14, 4)))
    colors = np.full((len(points), 4), 255, np.uint8)
    colors[:, :3] = np.floor(dark + (light - dark) * share[:, None] + 0.5)
    return assemble(RawSurface(points, faces, colors=colors, crease_cosine=-1.0), "blob")


def cube_sphere(steps: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit vectors (n, 3) and triangles (12 steps², 3), outward, of a cube's grid blown up to a sphere."""
    grid = np.linspace(-1, 1, steps + 1)
    a, b = np.meshgrid(grid, grid, indexing="ij")
    corner = np.arange(steps * (steps + 1)).reshape(steps, steps + 1)[:, :-1].ravel()
    quads = np.stack([corner, corner + steps + 1, corner + steps + 2, corner + 1], -1)
    points: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.empty((a.size, 3))
            face[:, axis], face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = side, a.ravel(), b.ravel()
            own = (quads if side > 0 else quads[:, ::-1]) + len(points) * a.size
            points.append(face)
            faces.append(np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]]))
    every = np.concatenate(points)
    unique, number = np.unique(np.round(every * 1e9).astype(np.int64), axis=0, return_inverse=True)
    cube = unique / 1e9
    # tan spreads the grid evenly over the sphere: sides differ by 1.2x instead of 5x.
    cube = np.tan(cube * (np.pi / 4))
    return cube / np.linalg.norm(cube, axis=1, keepdims=True), number.reshape(-1)[np.concatenate(faces)]


def _waves(
    points: NDArray[np.float64], random: np.random.Generator, frequency: float, count: int
) -> NDArray[np.float64]:
    """(n,) sum of waves of random direction, mean 0 and deviation about 1."""
    total = np.zeros(len(points))
    for _ in range(count * _WAVES // 4):
        direction = random.standard_normal(3)
        direction *= frequency * random.uniform(0.7, 1.4) / np.linalg.norm(direction)
        total += np.sin(points @ direction + random.uniform(0, 2 * np.pi))
    return np.asarray(total * (2 / (count * _WAVES // 4)) ** 0.5)
