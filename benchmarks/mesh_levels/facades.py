"""Central Tokyo with façades of which no two are the same: every wall has a picture of its own, drawn by seed.

The windows of a wall are those of its kind of façade in an order of its own, each with its own brightness; streaks run
down from the roof, and a coloured band of signs stands above the street. 25 cm a texel, as a leaf pixel of the world;
the buildings of a cell share one atlas, and are a GLB file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.facades import BAYS, CELL, FACADES, FLOORS, facade_pixels
from farfield.scene.model import Material, Mesh, Texture
from mesh_levels.chains import save_webp, shrunk
from mesh_levels.glb import joined, subset, write

TEXEL = 0.25
"""Metres."""
GUTTER = 2
"""Texels about a wall that repeat its rim."""
WIDTH = 2048
"""Texels: width of an atlas."""
SHRINK = 4
"""Façades are drawn with 5 cm a texel."""


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """Rectangles in one picture."""

    corner: NDArray[np.int64]
    """(n, 2) texels: left and upper corner inside of the gutter."""
    size: NDArray[np.int64]
    """(n, 2) texels, without the gutter."""
    height: int
    """Texels, a multiple of 256."""


def write_cell(path: Path, mesh: Mesh, seed: int) -> None:
    """Writes the prisms of a cell as a GLB, and its atlas beside it."""
    unique = with_unique_facades(mesh, seed)
    textures = {m.name: m.texture.pixels for m in unique.materials if m.texture is not None}
    for pixels in textures.values():
        save_webp(path.with_suffix(".webp"), pixels, 92, 1)
    write(path, unique, dict.fromkeys(textures, path.with_suffix(".webp").name))


def with_unique_facades(mesh: Mesh, seed: int) -> Mesh:
    """mesh: prisms with façades, material 0 plain (farfield.scene.footprints.prisms)."""
    assert mesh.uvs is not None
    plain = mesh.triangle_material == 0
    walls = subset(mesh, ~plain)
    # A wall is four vertices in order: bottom left, bottom right, top right, top left.
    assert walls.uvs is not None
    corners = walls.positions.reshape(-1, 4, 3)
    size = np.stack(
        [np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1), np.linalg.norm(corners[:, 3] - corners[:, 0], axis=1)],
        1,
    )
    atlas = packed(np.maximum(np.ceil(size / TEXEL).astype(np.int64), 1))
    bays = np.abs(walls.uvs.reshape(-1, 4, 2)[:, 2] - walls.uvs.reshape(-1, 4, 2)[:, 0]) * (BAYS, FLOORS)
    kind = np.zeros(len(corners), np.int64)
    kind[walls.triangles[:, 0] // 4] = walls.triangle_material.astype(np.int64) - 1
    pixels = _draw(atlas, bays, kind, np.random.default_rng(seed))
    material = Material(f"facades {seed}", texture=Texture(pixels), double_sided=False)
    uvs = np.zeros((len(walls.positions) // 4, 4, 2))
    low, high = atlas.corner, atlas.corner + atlas.size
    uvs[:, :, 0] = np.stack([low[:, 0], high[:, 0], high[:, 0], low[:, 0]], 1) / WIDTH
    uvs[:, :, 1] = np.stack([high[:, 1], high[:, 1], low[:, 1], low[:, 1]], 1) / atlas.height
    walls = replace(
        walls,
        uvs=uvs.reshape(-1, 2).astype(np.float32),
        materials=(material,),
        triangle_material=np.zeros(len(walls.triangles), np.uint16),
    )
    return replace(joined([replace(subset(mesh, plain), materials=mesh.materials[:1]), walls]), triangle_object=None)


def packed(size: NDArray[np.int64]) -> Atlas:
    """(n, 2) widths and heights, in rows of falling height. Walls longer than the atlas get fewer texels."""
    size = np.minimum(size, WIDTH - 2 * GUTTER)
    corner = np.zeros_like(size)
    x = y = row = 0
    for k in np.argsort(-size[:, 1], kind="stable"):
        width, height = size[k] + 2 * GUTTER
        if x + width > WIDTH:
            x, y, row = 0, y + row, 0
        corner[k] = x + GUTTER, y + GUTTER
        x, row = x + width, max(row, height)
    return Atlas(corner, size, max(-(-(y + row) // 256) * 256, 256))


def _draw(
    atlas: Atlas, bays: NDArray[np.float64], kind: NDArray[np.int64], random: np.random.Generator
) -> NDArray[np.uint8]:
    """(h, WIDTH, 4) uint8: all walls, each by numbers of its own."""
    kinds = [shrunk(facade_pixels(k), SHRINK)[..., :3].astype(np.float32) for k in range(len(FACADES))]
    pixels = np.full((atlas.height, WIDTH, 4), 255, np.uint8)
    pixels[..., :3] = 128
    for wall in range(len(kind)):
        width, height = atlas.size[wall]
        picture = _wall(kinds[kind[wall]], width, height, bays[wall], random)
        x, y = atlas.corner[wall]
        rim = np.pad(picture, ((GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")
        pixels[y - GUTTER : y + height + GUTTER, x - GUTTER : x + width + GUTTER, :3] = rim
    return pixels


def _wall(
    facade: NDArray[np.float32], width: int, height: int, bays: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.uint8]:
    """(height, width, 3) uint8, row 0 at the roof."""
    cell = CELL // SHRINK
    along = (np.arange(width) + 0.5) / width * bays[0]
    up = (np.arange(height)[::-1] + 0.5) / height * bays[1]
    bay, floor = along.astype(np.int64), up.astype(np.int64)
    shape = floor.max() + 1, bay.max() + 1
    column = (random.integers(0, BAYS, shape)[floor][:, bay] * cell) + ((along - bay) * cell).astype(np.int64)
    # Row 0 of a façade is its highest floor.
    row = random.integers(0, FLOORS, shape)[floor][:, bay] * cell + ((1 - up + floor) * cell).astype(np.int64)[:, None]
    picture = facade[np.minimum(row, len(facade) - 1), column]
    picture = picture * random.uniform(0.75, 1.2, shape)[floor][:, bay, None]
    streaks = np.cumsum(random.normal(0, 0.02, width)).clip(-0.15, 0.15)
    picture = picture * (1 + streaks[None, :, None] * np.linspace(1, 0.2, height)[:, None, None])
    picture = picture * random.uniform(0.85, 1.1) * random.uniform(0.94, 1.06, 3)
    if shape[0] > 1:
        street = floor == 0
        signs = random.uniform(40, 230, (shape[1], 3))[bay]
        picture[street] = 0.6 * picture[street] + 0.4 * signs
    return np.clip(picture + random.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
