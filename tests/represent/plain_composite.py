"""Plain twin of compositing: brute force, exact fractions (spec/orthoview.md, Parents)."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import floor

import numpy as np
from numpy.typing import NDArray

from farfield.geometry import normals
from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.represent.orthoview.layer import SEPARATION, OrthoLayer

Pixel = tuple[int, int]


@dataclass(frozen=True)
class Candidate:
    """One child pixel; depth in child steps of the grid."""

    depth: int
    order: tuple[int, int, int, int]
    column: Pixel
    layer: OrthoLayer
    at: Pixel

    @property
    def coverage(self) -> Fraction:
        return Fraction(int(self.layer.coverage[self.at]), 16)


@dataclass(frozen=True)
class Surface:
    """One parent pixel; depth in parent steps of the grid."""

    depth: int
    color: tuple[int, ...]
    normal: tuple[int, ...]
    length: int
    coverage: int
    unlit: bool
    object_id: int


def composite(children: list[list[OrthoLayer]], layers: int) -> dict[Pixel, list[Surface]]:
    """Surfaces, nearest first, by lattice (row, column) of the parent."""
    candidates: dict[Pixel, list[Candidate]] = defaultdict(list)
    for cell, stack in enumerate(children):
        for index, layer in enumerate(stack):
            for j, i in np.argwhere(layer.depth):
                row, column = layer.y + int(j), layer.x + int(i)
                depth = layer.depth_base + int(layer.depth[j, i])
                made = Candidate(depth, (cell, index, row, column), (row, column), layer, (int(j), int(i)))
                candidates[row // 2, column // 2].append(made)
    return {at: _surfaces(sorted(c, key=lambda c: (c.depth, c.order)), at, layers) for at, c in candidates.items()}


def _surfaces(candidates: list[Candidate], at: Pixel, layers: int) -> list[Surface]:
    depths = [c.depth for c in candidates]
    near = [d <= depths[0] + SEPARATION * 16 for d in depths]
    split = len(candidates)
    if not all(near):
        gaps = [b - a for a, b in pairwise(depths)]
        split = sum(near) if layers == 1 else gaps.index(max(gaps)) + 1
    parts = [candidates[:split], candidates[split:]][:layers]
    made = [_mean(part, at) for part in parts if part]
    return [surface for surface in made if surface is not None]


def _mean(part: list[Candidate], at: Pixel) -> Surface | None:
    weights = _weights(part)
    total = sum(weights)
    coverage = floor(total / 4 * 16 + Fraction(bayer(*at), 64))
    if coverage == 0:
        return None
    weighted = list(zip(map(float, weights), part, strict=True))
    linear = sum(w * LINEAR_OF_BYTE[c.layer.color[c.at]].astype(float) for w, c in weighted)
    normal = sum(
        w * int(c.layer.length[c.at]) / 8 * normals.decode(c.layer.normal[c.at]).astype(float) for w, c in weighted
    )
    size = float(np.linalg.norm(normal))
    codes = normals.encode(normal / size) if size else np.array([32, 32])
    depth = sum(w * c.depth for w, c in zip(weights, part, strict=True)) / total / 2
    unlit = sum(w for w, c in zip(weights, part, strict=True) if c.layer.connected[c.at] & 2)
    ids = part[0].layer.objects
    return Surface(
        depth=floor(depth + Fraction(1, 2)),
        color=tuple(int(b) for b in BYTE_OF_LINEAR[(linear / float(total) * 4095 + 0.5).astype(int)]),
        normal=tuple(int(c) for c in codes),
        length=min(max(floor(size / float(total) * 8 + 0.5), 1), 8),
        coverage=coverage,
        unlit=unlit > total / 2,
        object_id=0 if ids is None else int(ids[part[0].at]),
    )


def _weights(part: list[Candidate]) -> list[Fraction]:
    left: dict[Pixel, Fraction] = defaultdict(lambda: Fraction(1))
    weights = []
    for c in part:
        weight = c.coverage
        if c.order[1] == 1:
            for front in part:
                if front.order[:2] == (c.order[0], 0) and front.column == c.column:
                    weight = (1 - front.coverage) * c.coverage
        weight = min(weight, left[c.column])
        left[c.column] -= weight
        weights.append(weight)
    return weights


def bayer(row: int, column: int, size: int = 8) -> int:
    """Threshold of the ordered dither, 0..size² - 1."""
    if size == 1:
        return 0
    half = size // 2
    quarter = {(0, 0): 0, (0, 1): 2, (1, 0): 3, (1, 1): 1}
    return 4 * bayer(row % half, column % half, half) + quarter[row % size // half, column % size // half]


def planes(layer: OrthoLayer) -> dict[Pixel, Surface]:
    """The same of a layer, to compare with."""
    ids: NDArray[np.uint32] = np.zeros(layer.shape, np.uint32) if layer.objects is None else layer.objects
    return {
        (layer.y + int(j), layer.x + int(i)): Surface(
            depth=layer.depth_base + int(layer.depth[j, i]),
            color=tuple(int(b) for b in layer.color[j, i]),
            normal=tuple(int(c) for c in layer.normal[j, i]),
            length=int(layer.length[j, i]),
            coverage=int(layer.coverage[j, i]),
            unlit=bool(layer.connected[j, i] & 2),
            object_id=int(ids[j, i]),
        )
        for j, i in np.argwhere(layer.depth)
    }
