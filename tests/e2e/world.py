"""The town of the browser's tests: ground, houses, screens with holes, and lamps that shine by themselves."""

from __future__ import annotations

import numpy as np

from bake.scenes import box, checkered, ground, quad_mesh, scene_of
from farfield.scene.model import Material, Scene

WALL = Material("wall", (0.8, 0.7, 0.6, 1.0))
ROOF = Material("roof", (0.7, 0.15, 0.1, 1.0))
LAMP = Material("lamp", (1.0, 0.9, 0.3, 1.0), unlit=True)
SCREEN = Material("screen", texture=checkered(), alpha_cutoff=0.5)
HALF = 32.0
"""Metres from the middle to the ends of the ground."""


def town() -> Scene:
    """64 m x 64 m."""
    random = np.random.default_rng(8)

    def places(count: int) -> list[tuple[float, float, float]]:
        return [(float(x), float(y), 0.0) for x, y in random.uniform(4 - HALF, HALF - 10, (count, 2))]

    screen = quad_mesh(np.array([[[0.0, 0.0, 0.0], [6.0, 0.5, 0.0], [6.0, 0.5, 5.0], [0.0, 0.0, 5.0]]]), SCREEN)
    return scene_of(
        (ground(-HALF, HALF), [(0.0, 0.0, 0.0)]),
        (box((0.0, 0.0, 0.0), (4.0, 3.0, 6.0), WALL), places(20)),
        (box((0.0, 0.0, 0.0), (2.5, 5.0, 3.0), ROOF), places(15)),
        (screen, places(6)),
        (box((0.0, 0.0, 0.0), (0.4, 0.4, 2.0), LAMP), places(20)),
    )
