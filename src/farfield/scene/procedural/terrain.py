"""Textured land with trees, statues and towers, each a mesh of its own, and a walk through it (BEN 6.2)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.model import Material, Mesh
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.land import Land, painted, roll, tile
from farfield.scene.procedural.made import MadeScene, finish, prepare
from farfield.scene.procedural.statues import standing, statue
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.scene.procedural.walks import Walk, beside
from farfield.scene.shading import body_normals

TILES = 16
"""Along each side."""
SIDE = 640.0
"""Metres."""
STEP = 5.0
"""Metres between heights."""
TEXELS = 64
"""Along a tile's texture."""
STATUES, TOWERS = 0.3, 0.1
"""Shares of the objects; the rest are trees."""
SPREAD = 40.0
"""How many times as many triangles the largest object has as the smallest."""
SECONDS = 200.0
STOPS = ((0.0, 2.0), (40.0, 46.0), (90.0, 100.0), (150.0, 158.0))
WAY = ((0.12, 0.15), (0.3, 0.3), (0.32, 0.6), (0.6, 0.62), (0.7, 0.35), (0.5, 0.25))
"""Corners of the walk, in sides of the land: 4 m/s."""
CLEAR = 2.5
"""Metres from the walk to the middle of any object, at least."""


@dataclass(frozen=True, slots=True)
class TerrainOptions:
    """Size of the scene."""

    count: int = 216
    """Objects, the tiles of land apart."""
    triangles: int = 11_700
    """Of an object, on average: all together have the thesis' 2.5 million."""
    seed: int = 0
    meshes: tuple[Path, ...] = ()
    """Mesh files to make statues of, in place of made bodies."""


def make_terrain(directory: Path, options: TerrainOptions | None = None) -> MadeScene:
    """Writes the scene, a GLB for each tile and each object, and path.json, the walk. Deterministic by seed.

    Raises OptionError for sizes that make no scene, InputError for a given mesh that cannot be read.
    """
    chosen = options or TerrainOptions()
    if chosen.count < 1 or chosen.triangles < 100:
        raise OptionError("a terrain needs at least 1 object and 100 triangles for each", "make terrain")
    prepare(directory)
    land = roll(SIDE, STEP, 12.0, 0.3, 0, chosen.seed)
    random = np.random.default_rng(chosen.seed + 1)
    way = np.array(WAY) * SIDE
    places = beside(way, random.uniform(0.05, 0.95, (chosen.count, 2)) * SIDE, CLEAR)
    parts = list(_tiles(directory, land))
    heights = land.height_at(places)
    for number, mesh in enumerate(_objects(chosen, random)):
        name = f"object-{number}.glb"
        write_glb(directory / name, mesh)
        x, y = places[number].tolist()
        turn, z = random.uniform(0, 360), float(heights[number])
        parts.append(f'[[source]]\npath = "{name}"\nrotate = {turn:.3f}\ntranslate = [{x:.4f}, {y:.4f}, {z:.4f}]\n')
    walk = Walk(way, SECONDS, STOPS).recorded(land.height_at)
    (directory / "path.json").write_text(json.dumps(walk))
    return finish(directory, parts)


def _tiles(directory: Path, land: Land) -> Iterator[str]:
    count = (len(land.height) - 1) // TILES
    for row in range(TILES):
        for column in range(TILES):
            low, high = (row * count, column * count), ((row + 1) * count, (column + 1) * count)
            mesh = tile(land, low, high)
            corner = np.array([low[1], low[0]]) * land.step
            uvs = ((mesh.positions[:, :2] - corner) / (count * land.step) * (TEXELS - 1) + 0.5) / TEXELS
            texture = painted(land, low, high, TEXELS)
            ground = replace(mesh.materials[0], name="land", texture=texture, base_color=(1.0, 1.0, 1.0, 1.0))
            mesh = replace(mesh, uvs=uvs.astype(np.float32), colors=None, materials=(ground,))
            name = f"land-{row}-{column}.glb"
            write_glb(directory / name, mesh, GlbOptions(image_format="WEBP", image_quality=75))
            yield f'[[source]]\npath = "{name}"\n'


def _objects(options: TerrainOptions, random: np.random.Generator) -> Iterator[Mesh]:
    """As many objects, their triangles spread evenly over the orders of magnitude."""
    sizes = SPREAD ** random.uniform(0, 1, options.count)
    sizes *= options.triangles / sizes.mean()
    kinds = random.uniform(0, 1, options.count)
    for number, (triangles, kind) in enumerate(zip(sizes.astype(int).tolist(), kinds.tolist(), strict=True)):
        seed = options.seed * 1000 + number
        if kind < STATUES:
            height = float(random.uniform(1.5, 4.0))
            if options.meshes:
                yield statue(options.meshes[number % len(options.meshes)], triangles, height)
            else:
                yield standing(blob(max(triangles, 12), 1.0, seed), height)
        elif kind < STATUES + TOWERS:
            yield _tower(max(triangles // 4, 3), float(random.uniform(4, 12)))
        else:
            yield tree(SHAPES[number % len(SHAPES)], triangles, seed)


def _tower(sides: int, height: float) -> Mesh:
    """A round one with a pointed roof; 3 triangles a side."""
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=-1) * 0.15 * height
    top = np.array([0.0, 0.0, 0.8 * height])
    points = np.concatenate([ring, ring + top, [[0.0, 0.0, height]]])
    a = np.arange(sides)
    b = (a + 1) % sides
    faces = [np.stack(part, axis=-1) for part in ((a, b, b + sides), (a, b + sides, a + sides))]
    faces.append(np.stack([a + sides, b + sides, np.full(sides, 2 * sides)], axis=-1))
    triangles: NDArray[np.uint32] = np.concatenate(faces).astype(np.uint32)
    return Mesh(
        positions=points,
        triangles=triangles,
        normals=body_normals(points, triangles),
        materials=(Material("brick", (0.35, 0.16, 0.11, 1.0)),),
        triangle_material=np.zeros(len(triangles), np.uint16),
    )
