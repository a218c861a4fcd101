"""What a canopy keeps on its way up the levels (OV 5.1): cover, mean colour and mean Lambert shading.

A slab of loose leaves that covers 30 % seen from above, and a forest of real trees where they are at hand, are baked;
every level's tiles of the top view are read back from the world and summed over the pictures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.geometry.directions import TOP, principal
from farfield.geometry.normals import decode
from farfield.scene.model import Instances, Material, Mesh, Scene
from farfield.store.memory import MemoryStore
from farfield.view.shading import Light, lambert
from farfield.world.world import World

LEAF = 8.0
SIDE = 128.0
COVER = 0.30


class _Held:
    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.name = mesh, "canopy"

    def load(self) -> Mesh:
        """The mesh."""
        return self.mesh


def run(quick: bool = False) -> dict[str, Any]:
    """Per level, of the top view: cover (share of the ground), mean linear colour, mean shading; and their drift.

    The darkest channel is told apart: WebP halves the resolution of chroma and keeps it in 8 bits.
    """
    side = SIDE / 2 if quick else SIDE
    store = MemoryStore()
    options = BakeOptions(leaf_size=LEAF, resolution=32 if quick else 64, directions="5", workers=1, geometry=False)
    bake(canopy(side), store, options)
    levels = measure_levels(World.open(store), side * side)
    first = levels[0]
    return {
        "levels": levels,
        "cover_drift": max(abs(entry["cover"] - first["cover"]) for entry in levels),
        "color_drift": _drift([np.array(entry["color"]) for entry in levels]),
        "darkest_channel_drift": _drift([np.array([min(entry["color"])]) for entry in levels]),
        "shading_drift": _drift([np.array([entry["shading"]]) for entry in levels]),
    }


def measure_levels(world: World, area: float) -> list[dict[str, Any]]:
    """Sums of all top views of each level. area: square metres that cover is a share of."""
    sums = [np.zeros(5) for _ in range(world.grid.top_level + 1)]
    for entry in world.cells():
        if any(d == TOP and layer == 0 for d, layer, _ in entry.tiles):
            level = entry.cell.level
            sums[level] += _sums(world, entry) * world.grid.pitch(level) ** 2
    return [
        {"cover": float(s[0] / area), "color": (s[1:4] / s[0]).tolist(), "shading": float(s[4] / s[0])} for s in sums
    ]


def _sums(world: World, entry: Any) -> NDArray[np.float64]:
    """Pixels covered, and colour and shading times coverage, of what is seen from above: layer 2 through layer 1."""
    axes = principal(TOP).axes * np.array([[1], [1], [-1]])
    seen = np.zeros(5)
    through: dict[tuple[int, int], float] = {}
    for index in (0, 1):
        if not any(d == TOP and layer == index for d, layer, _ in entry.tiles):
            continue
        layer = world.tile(entry, TOP, index).layer
        rows, columns = np.nonzero(layer.valid)
        cover = layer.coverage[rows, columns] / 16.0
        places = list(zip((rows + layer.y).tolist(), (columns + layer.x).tolist(), strict=True))
        weight = cover * np.array([through.get(p, 1.0) for p in places])
        if index == 0:
            through = {p: 1 - c for p, c in zip(places, cover.tolist(), strict=True)}
        normal = decode(layer.normal[rows, columns]) @ axes * (layer.length[rows, columns, None] / 8.0)
        seen[0] += weight.sum()
        seen[1:4] += weight @ LINEAR_OF_BYTE[layer.color[rows, columns]]
        seen[4] += weight @ lambert(normal, Light())
    return seen


def _drift(values: list[NDArray[np.float64]]) -> float:
    """Largest departure from the leaf level, as a share of its length."""
    return float(max(np.linalg.norm(v - values[0]) / np.linalg.norm(values[0]) for v in values))


def canopy(side: float, seed: int = 3) -> Scene:
    """Leaf quads of 0.35 m, turned at random, in a slab of 6 m, as many as cover 30 % of the ground."""
    rng = np.random.default_rng(seed)
    size, share = 0.35, 0.5  # a leaf turned at random shows half its area to any side
    count = int(-np.log(1 - COVER) * side * side / (size * size * share))
    middle = rng.uniform([0, 0, 1], [side, side, 7], (count, 3))
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.cross(normal, rng.normal(size=(count, 3)))
    across *= size / 2 / np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normal, across)
    corners = middle[:, None] + np.stack([-across - along, across - along, across + along, along - across], 1)
    first = np.arange(count, dtype=np.uint32)[:, None] * 4
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], 1).reshape(-1, 3)
    green = np.clip(rng.normal([70, 120, 40], 20, (count, 3)), 10, 245).astype(np.uint8)
    colors = np.repeat(np.concatenate([green, np.full((count, 1), 255, np.uint8)], 1), 4, 0)
    mesh = Mesh(
        corners.reshape(-1, 3),
        triangles.astype(np.uint32),
        np.repeat(normal, 4, 0).astype(np.float32),
        (Material("leaf"),),
        np.zeros(len(triangles), np.uint16),
        colors=colors,
    )
    return Scene(
        [_Held(mesh)], Instances(np.zeros(1, np.int32), np.eye(3, 4)[None], *[np.ones(1, np.int64)] * 2), object_count=1
    )
