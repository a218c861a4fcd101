"""Rolling land with forests and towns: the landscape test world, scaled by its options."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.procedural.land import Land, roll, tile
from farfield.scene.procedural.made import MadeScene, finish, given_mesh, prepare, source_table
from farfield.scene.procedural.towns import footprints, write_footprints
from farfield.scene.procedural.trees import SHAPES, tree

TILE = 128
"""Squares along the side of a mesh of land."""


@dataclass(frozen=True, slots=True)
class LandscapeOptions:
    """Size of the landscape scene; the defaults have 130 million triangles on 2 km x 2 km."""

    side: float = 2000.0
    """Metres."""
    step: float = 4.0
    """Metres between heights of the land."""
    relief: float = 18.0
    """Deviation of heights, metres."""
    forest_share: float = 0.4
    """Part of the land that is forest."""
    trees_per_hectare: float = 65.0
    """In the forest."""
    tree_triangles: int = 12_000
    towns: int = 3
    seed: int = 0
    meshes: tuple[Path, ...] = ()
    """Tree meshes in metres, standing on their lowest point, to use in place of made ones."""


def make_landscape(directory: Path, options: LandscapeOptions | None = None) -> MadeScene:
    """Writes the scene: tiles of land, footprints, trees with instance tables, scene.toml. Deterministic by seed.

    Raises OptionError for sizes that make no scene, InputError for a given mesh that cannot be read.
    """
    chosen = options or LandscapeOptions()
    if chosen.side <= 0 or chosen.step <= 0 or not 0 <= chosen.forest_share <= 1 or chosen.towns < 0:
        raise OptionError("side and step must be positive, the share of forest 0 to 1", "make landscape")
    if chosen.side / chosen.step > 16_384:
        raise OptionError(f"{chosen.side / chosen.step:.0f} squares a side are too many", "make landscape",
                          "make side / step at most 16,384")  # fmt: skip
    prepare(directory)
    land = roll(chosen.side, chosen.step, chosen.relief, chosen.forest_share, chosen.towns, chosen.seed)
    parts = _write_land(directory, land)
    parts += _write_towns(directory, land, chosen.seed)
    parts += _write_trees(directory, land, chosen)
    return finish(directory, parts)


def _write_land(directory: Path, land: Land) -> list[str]:
    count = len(land.height) - 1
    parts = []
    for row in range(0, count, TILE):
        for column in range(0, count, TILE):
            name = f"land-{row // TILE}-{column // TILE}.glb"
            high = (min(row + TILE, count), min(column + TILE, count))
            write_glb(directory / name, tile(land, (row, column), high))
            parts.append(f'[[source]]\npath = "{name}"\n')
    return parts


def _write_towns(directory: Path, land: Land, seed: int) -> list[str]:
    shapes, heights, grounds = footprints(land, seed + 11)
    if not len(shapes):
        return []
    write_footprints(directory / "towns.fgb", shapes, heights, grounds)
    return ['[[source]]\npath = "towns.fgb"\nheight_attribute = "height"\nbase_attribute = "ground"\n']


def _write_trees(directory: Path, land: Land, options: LandscapeOptions) -> list[str]:
    table = _planted(land, options)
    kinds = len(options.meshes) or len(SHAPES)
    parts = []
    for kind in range(kinds):
        own = table[kind::kinds]
        if not len(own):
            continue
        np.save(directory / f"trees-{kind}.npy", own)
        if options.meshes:
            given = given_mesh(options.meshes[kind])
            parts.append(source_table(given.path, f"trees-{kind}.npy", 1.0, np.array([0, 0, -given.low[2]])))
        else:
            name = f"tree-{SHAPES[kind].name}.glb"
            write_glb(directory / name, tree(SHAPES[kind], options.tree_triangles, options.seed + kind), GlbOptions())
            parts.append(source_table(name, f"trees-{kind}.npy"))
    return parts


def _planted(land: Land, options: LandscapeOptions) -> NDArray[np.float64]:
    """(k, 5) x, y, z, heading, scale: a jittered grid, thinned to the forests and a few trees outside them."""
    random = np.random.default_rng(options.seed + 21)
    spacing = 100.0 / max(options.trees_per_hectare, 1e-6) ** 0.5
    along = np.arange(spacing / 2, land.side, spacing)
    places = np.stack(np.meshgrid(along, along), -1).reshape(-1, 2)
    places += random.uniform(-0.45, 0.45, places.shape) * spacing
    places = np.clip(places, 0.5, land.side - 0.5)
    row, column = np.floor(places[:, ::-1] / land.step).astype(int).T
    grows = (land.forest[row, column] > 0) | (random.random(len(places)) < 0.01)
    places = places[grows & ~land.in_towns(places)]
    order = random.permutation(len(places))
    places = places[order]
    heading, scale = random.uniform(0, 360, len(places)), random.uniform(0.65, 1.25, len(places))
    return np.column_stack([places, land.height_at(places) - 0.1, heading, scale])
