"""A piece of a town in one cell, and BlockMaps of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.represent.blockmap.build import Square, build_blockmap
from farfield.represent.blockmap.coding import decode_blockmap, encode_blockmap
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material

EXTENT = (128.0, 128.0, 64.0)
"""Metres of the cell."""
_BOX = np.array([[0, 1, 2, 3], [4, 5, 1, 0], [5, 6, 2, 1], [6, 7, 3, 2], [7, 4, 0, 3]])
"""Corners of the roof, and of the four walls below it."""


def town(seed: int, houses: int = 45) -> Chunk:
    """Houses with flat roofs or pitched ones, turned at random, on sloping ground.

    The ground is object 1, house n (from 0) object n + 2.
    """
    chance = np.random.default_rng(seed)
    width, depth, _ = EXTENT
    x, y = np.meshgrid(np.linspace(0, width, 17), np.linspace(0, depth, 17))
    ground = np.stack([x, y, 2 + x / 40 + np.sin(y / 19)], axis=-1)
    corners = np.stack([ground[:-1, :-1], ground[:-1, 1:], ground[1:, 1:], ground[1:, :-1]], axis=2).reshape(-1, 4, 3)
    parts, colors = [corners], [chance.integers(70, 130, (len(corners), 3))]
    for _ in range(houses):
        turn, (long, wide) = chance.uniform(0, np.pi), chance.uniform(7, 24, 2)
        middle, height = chance.uniform(13, 115, 2), 6 + 40 * chance.random() ** 3
        flat = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (long / 2, wide / 2)
        foot = np.clip(flat @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + middle, 0, 128)
        pitch = np.array([0, 0, 1, 1]) * (chance.random() < 0.4) * wide / 4
        box = np.concatenate([np.c_[foot, height + pitch], np.c_[foot, np.zeros(4)]])
        parts.append(box[_BOX])
        colors.append(chance.integers(60, 250, (len(_BOX), 3)))
    objects = np.arange(1, len(parts) + 1).repeat([len(part) for part in parts])
    return _chunk(np.concatenate(parts), np.concatenate(colors), objects)


def _chunk(faces: NDArray[np.float64], colors: NDArray[np.int64], objects: NDArray[np.int64]) -> Chunk:
    """Of flat faces of four corners, counter-clockwise from outside. objects: (faces,)"""
    count = len(faces)
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Chunk(
        faces.reshape(-1, 3).astype(np.float32),
        normals.repeat(4, axis=0).astype(np.float32),
        np.empty((0, 2), np.float32),
        np.c_[colors, np.full(count, 255)].repeat(4, axis=0).astype(np.uint8),
        (4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint32),
        np.zeros(2 * count, np.uint32),
        objects.astype(np.uint32).repeat(2),
    )


@cache
def blockmap_of_town(size: str, seed: int = 1, by_area: bool = True, sloped: bool = True) -> tuple[bytes, BlockMap]:
    """A BlockMap as it is stored, and as a reader finds it."""
    square, materials = Square(*EXTENT), MaterialTable.build([Material("", (1.0, 1.0, 1.0, 1.0))])
    built = build_blockmap(town(seed), materials, square, BlockMapSize.parse(size), by_area, sloped)
    assert built is not None
    stored = encode_blockmap(built, 85)
    return stored, decode_blockmap(stored, size)
