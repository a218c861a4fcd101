"""Cells of the cut while the world's side doubles (OV 4.2): constant on each level, one constant more in all.

Real worlds are baked (tiny views, one direction), and the real index is cut from a camera over their middle.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.octree.cut import cut, near_radius
from farfield.octree.grid import Grid
from farfield.scene.model import Instances, Material, Mesh, Scene
from farfield.store.memory import MemoryStore
from farfield.world.world import World

LEAF = 16.0
PICTURE_WIDTH = 640
HORIZONTAL_FOV = math.radians(60)


@dataclass(frozen=True)
class _Held:
    mesh: Mesh
    name: str = "hills"

    def load(self) -> Mesh:
        """The mesh."""
        return self.mesh


def run(quick: bool = False) -> dict[str, Any]:
    """Cells by level for each side of the world, in leaves."""
    sides = [8, 16, 32] if quick else [8, 16, 32, 64, 128]
    cuts = {side: _cut_of(side) for side in sides}
    totals = [sum(c.values()) for c in cuts.values()]
    return {
        "sides": sides,
        "cells_by_level": {side: dict(sorted(c.items())) for side, c in cuts.items()},
        "totals": totals,
        "growth_per_doubling": [int(b - a) for a, b in itertools.pairwise(totals)],
    }


def _cut_of(side: int) -> Counter[int]:
    store = MemoryStore()
    options = BakeOptions(leaf_size=LEAF, resolution=16, directions="0,0,1", depth_layers=1, workers=1, geometry=False)
    bake(_hills(side), store, options)
    world = World.open(store)
    # q of a full-size bake: how far each level reaches does not depend on how coarse these views are.
    grid = Grid(LEAF, 512, world.grid.corner, world.grid.axis_levels)
    middle = side * LEAF / 2
    found = cut(
        world, grid, np.array([middle + 1.0, middle + 2.0, 10.0]), near_radius(grid, PICTURE_WIDTH, HORIZONTAL_FOV)
    )
    return Counter(key.level for key in found.pictures) + Counter({-1: len(found.geometry)})


def _hills(side: int) -> Scene:
    """Rolling land of 2 x 2 quads a leaf."""
    n = 2 * side + 1
    x, y = np.meshgrid(np.linspace(0.01, side * LEAF - 0.01, n), np.linspace(0.01, side * LEAF - 0.01, n))
    z = 3 + 2 * np.sin(x / 40) * np.cos(y / 55)
    positions = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    quads = [np.stack([corner, corner + 1, corner + n + 1], 1), np.stack([corner, corner + n + 1, corner + n], 1)]
    triangles = np.concatenate(quads).astype(np.uint32)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(positions), 1))
    mesh = Mesh(positions, triangles, up, (Material(),), np.zeros(len(triangles), np.uint16))
    instances = Instances(np.zeros(1, np.int32), np.eye(3, 4)[None], *[np.ones(1, np.int64)] * 2)
    return Scene([_Held(mesh)], instances, object_count=1)
