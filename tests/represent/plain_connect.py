"""Plain twin of the connectivity kernel: OV 5.2 as printed, in double precision."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from farfield.geometry import normals
from farfield.represent.orthoview.connectivity import Connection
from farfield.represent.orthoview.layer import OrthoLayer

Pixel = tuple[int, int]


def margins(layer: OrthoLayer, one: Pixel, other: Pixel, connection: Connection) -> list[float]:
    """How far inside (positive) each condition holds for two valid pixels."""
    points = [np.array([x, y, -int(layer.depth[y, x]) / 8]) for y, x in (one, other)]
    n1, n2 = (normals.decode(layer.normal[p]).astype(float) for p in (one, other))
    line = points[0] - points[1]
    p = line / np.linalg.norm(line)
    mirrored = n1 - 2 * (n1 @ p) * p
    return [
        connection.depth - abs(line[2]),
        connection.normal - abs(n1 @ p),
        connection.normal - abs(n2 @ p),
        mirrored @ n2 - connection.sphericity,
    ]


def connected(layer: OrthoLayer, connection: Connection) -> tuple[NDArray[np.bool_], float]:
    """(h, w) bool: connected pixels; and the smallest distance of any condition from its limit."""
    rows, columns = layer.shape
    edges: set[frozenset[Pixel]] = set()
    closest = np.inf
    blocks = [
        [p for p in ((y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)) if p[0] < rows and p[1] < columns]
        for y, x in np.ndindex(rows, columns)
    ]
    for block in blocks:
        for pair in combinations(block, 2):
            if all(layer.depth[p] for p in pair):
                m = margins(layer, *pair, connection)
                closest = min(closest, *map(abs, m))
                if min(m) > 0:
                    edges.add(frozenset(pair))
    closed = set(edges)
    for block in blocks:
        if len(block) == 4:
            closed |= _closure(block, edges)
    count = np.zeros((rows, columns), int)
    for edge in closed:
        for p in edge:
            count[p] += 1
    return count > connection.neighbours, closest


def _closure(block: list[Pixel], edges: set[frozenset[Pixel]]) -> set[frozenset[Pixel]]:
    """All pairs joined by a path of edges inside the block."""
    joined = {frozenset(pair) for pair in combinations(block, 2) if frozenset(pair) in edges}
    while True:
        more = {a ^ b for a in joined for b in joined if len(a & b) == 1} - joined
        if not more:
            return joined
        joined |= more
