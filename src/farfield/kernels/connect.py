"""Connectivity of neighbouring pixels (OV 5.2): which pixels are part of a surface, which are loose leaves.

Two neighbours are connected when their depths are close, the line between them lies in both tangent planes, and their
normals mirror each other as on a sphere. The paper prints < for that third condition; on a sphere the product is 1, so
it must be >. The relation is closed within 2x2 blocks; more than four connected neighbours make a pixel connected.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from farfield.kernels.compiling import device, kernel

RIGHT, DOWN, DIAGONAL, ANTI = 1, 2, 4, 8
"""Edges kept at a pixel: to (x + 1, y), (x, y + 1), (x + 1, y + 1), and between (x + 1, y) and (x, y + 1)."""

_BLOCK_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
"""Corners (0 1 / 2 3) that the six bits of a 2x2 block join: right, down, diagonal, anti, down of 1, right of 2."""


def _closures() -> NDArray[np.uint8]:
    """(64,) uint8: the six edge bits of a block -> the bits of its transitive closure."""
    table = np.zeros(64, np.uint8)
    for bits in range(64):
        part = [0, 1, 2, 3]
        for k, (a, b) in enumerate(_BLOCK_EDGES):
            if bits >> k & 1:
                part = [part[a] if p == part[b] else p for p in part]
        table[bits] = sum(1 << k for k, (a, b) in enumerate(_BLOCK_EDGES) if part[a] == part[b])
    return table


CLOSURES = _closures()

_DEPTH = types.Array(types.uint16, 2, "C", readonly=True)
_NORMAL = types.Array(types.uint8, 3, "C", readonly=True)
_VECTORS = types.Array(types.float32, 2, "C", readonly=True)
_TABLE = types.Array(types.uint8, 1, "C", readonly=True)
_EDGES = types.uint8[:, ::1]


@device
def _joined(vectors, a, b, dx, dy, dz, limits):  # type: ignore[no-untyped-def]
    """The three conditions for normals number a and b and the step (dx, dy, dz) between their points, in pitches.

    dz along -w, as the third coordinate of normals. Multiplied out by the squared distance: no root, no division.
    limits: (3,) float32, the three thresholds.
    """
    if abs(dz) >= limits[0]:
        return False
    ax = vectors[a, 0]
    ay = vectors[a, 1]
    az = vectors[a, 2]
    bx = vectors[b, 0]
    by = vectors[b, 1]
    bz = vectors[b, 2]
    square = dx * dx + dy * dy + dz * dz
    along_a = ax * dx + ay * dy + az * dz
    along_b = bx * dx + by * dy + bz * dz
    steepest = limits[1] * limits[1] * square
    if along_a * along_a >= steepest or along_b * along_b >= steepest:
        return False
    return (ax * bx + ay * by + az * bz - limits[2]) * square > np.float32(2.0) * along_a * along_b


@kernel(
    types.void(_DEPTH, _NORMAL, _VECTORS, types.float32[::1], types.float32, _EDGES),
)
def join(depth, normal, vectors, limits, step, edges):  # type: ignore[no-untyped-def]
    """Edges between neighbouring pixels.

    depth: (h, w) uint16, 0 = nothing there; step: pitches per depth step. normal: (h, w, 2) uint8 codes, vectors:
    (4096, 3) float32, normals.DECODED. limits: (3,) float32: depth in pitches, normal, sphericity.
    edges: (h, w) uint8, all 0, written.
    """
    rows, columns = depth.shape
    zero = np.float32(0.0)
    one = np.float32(1.0)
    for y in range(rows):
        below = y + 1 < rows
        for x in range(columns):
            beside = x + 1 < columns
            d0 = types.int32(depth[y, x])
            d1 = types.int32(depth[y, x + 1]) if beside else types.int32(0)
            d2 = types.int32(depth[y + 1, x]) if below else types.int32(0)
            n1 = (types.int32(normal[y, x + 1, 0]) << 6) | normal[y, x + 1, 1] if d1 > 0 else types.int32(0)
            n2 = (types.int32(normal[y + 1, x, 0]) << 6) | normal[y + 1, x, 1] if d2 > 0 else types.int32(0)
            bits = 0
            if d0 > 0:
                n0 = (types.int32(normal[y, x, 0]) << 6) | normal[y, x, 1]
                if d1 > 0 and _joined(vectors, n0, n1, one, zero, np.float32(d0 - d1) * step, limits):
                    bits |= RIGHT
                if d2 > 0 and _joined(vectors, n0, n2, zero, one, np.float32(d0 - d2) * step, limits):
                    bits |= DOWN
                if beside and below and depth[y + 1, x + 1] > 0:
                    d3 = types.int32(depth[y + 1, x + 1])
                    n3 = (types.int32(normal[y + 1, x + 1, 0]) << 6) | normal[y + 1, x + 1, 1]
                    if _joined(vectors, n0, n3, one, one, np.float32(d0 - d3) * step, limits):
                        bits |= DIAGONAL
            if d1 > 0 and d2 > 0 and _joined(vectors, n1, n2, -one, one, np.float32(d1 - d2) * step, limits):
                bits |= ANTI
            edges[y, x] = bits


@kernel(types.void(_EDGES, _TABLE, _EDGES))
def close(edges, closures, closed):  # type: ignore[no-untyped-def]
    """Join what is joined by a path within a 2x2 block; only paths of `edges`, not of joins made here.

    edges: (h, w) uint8 as join wrote them. closures: (64,) uint8, CLOSURES. closed: (h, w) uint8, written.
    """
    rows, columns = edges.shape
    for y in range(rows):
        for x in range(columns):
            closed[y, x] = edges[y, x]
    for y in range(rows - 1):
        for x in range(columns - 1):
            e = edges[y, x] & 15
            before = e | ((edges[y, x + 1] & DOWN) << 3) | ((edges[y + 1, x] & RIGHT) << 5)
            after = closures[before]
            if after != before:
                closed[y, x] |= after & 15
                closed[y, x + 1] |= (after >> 3) & DOWN
                closed[y + 1, x] |= (after >> 5) & RIGHT


@kernel(types.void(_EDGES, types.int64, types.uint8, _EDGES))
def mark(closed, more_than, bit, flags):  # type: ignore[no-untyped-def]
    """Set or clear `bit` of flags ((h, w) uint8) where more than that many of the eight neighbours are joined."""
    rows, columns = closed.shape
    for y in range(rows):
        for x in range(columns):
            e = closed[y, x]
            n = (e & 1) + ((e >> 1) & 1) + ((e >> 2) & 1)
            if x > 0:
                w = closed[y, x - 1]
                n += (w & 1) + ((w >> 3) & 1)
                if y > 0:
                    n += (closed[y - 1, x - 1] >> 2) & 1
            if y > 0:
                u = closed[y - 1, x]
                n += ((u >> 1) & 1) + ((u >> 3) & 1)
            if n > more_than:
                flags[y, x] |= bit
            else:
                flags[y, x] &= ~bit
