"""The plain twins of kernels.carry: every triangle is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.carry import LEAST_FACING
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable


def plain_cover(corners: NDArray[np.float64], rows: int, columns: int) -> NDArray[np.int32]:
    """(rows, columns) the first triangle over each sample; -1: none."""
    ids = np.full((rows, columns), -1, np.int32)
    for j in range(rows):
        for i in range(columns):
            for t, flat in enumerate(corners):
                a, b, c = flat.reshape(3, 2)
                sides = [_turn(p, q, np.array([i + 0.5, j + 0.5])) for p, q in ((a, b), (b, c), (c, a))]
                area = _turn(a, b, c)
                if area != 0 and all(side * np.sign(area) >= 0 for side in sides):
                    ids[j, i] = t
                    break
    return ids


@dataclass(frozen=True, slots=True)
class Nearest:
    """The triangle that fits a point best."""

    triangle: int
    squared: float
    """Square metres, with the penalty."""
    weights: NDArray[np.float64]
    """(3,) of its corners."""


def plain_nearest(
    chunk: Chunk,
    groups: NDArray[np.uint8],
    point: NDArray[np.float64],
    toward: NDArray[np.float64],
    group: int,
    penalty: float,
) -> Nearest:
    """By trying all of one group."""
    found = []
    for t in np.flatnonzero(groups == group).tolist():
        corners = chunk.positions[chunk.triangles[t]].astype(np.float64)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        weights = _closest(corners, normal, point)
        squared = float(((weights @ corners - point) ** 2).sum())
        away = 0.0 if normal @ toward / np.linalg.norm(normal) >= LEAST_FACING else penalty
        found.append(Nearest(t, squared + away, weights))
    return min(found, key=lambda one: one.squared)


def plain_color(chunk: Chunk, materials: MaterialTable, near: Nearest) -> NDArray[np.float64]:
    """(3,) linear light of what has no texture."""
    color = np.array(materials.arrays.base_color[chunk.materials[near.triangle], :3], np.float64)
    if len(chunk.colors):
        color *= near.weights @ LINEAR_OF_BYTE[chunk.colors[chunk.triangles[near.triangle], :3]]
    return color


def _closest(
    corners: NDArray[np.float64], normal: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) weights: within, where the point lies above the triangle, else on the nearest of its sides."""
    others = [(corners[k - 2], corners[k - 1]) for k in range(3)]
    weights = np.array([np.cross(q - p, point - p) @ normal for p, q in others]) / (normal @ normal)
    if (weights >= 0).all():
        return weights
    best, least = weights, np.inf
    for k in range(3):
        p, q = corners[k], corners[k - 2]
        along = float(np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1))
        away = float(((p + along * (q - p) - point) ** 2).sum())
        if away < least:
            best, least = np.zeros(3), away
            best[k], best[k - 2] = 1 - along, along
    return best


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
