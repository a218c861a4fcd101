"""Triangles to cells: which lie where, whole or cut (the exact partition of `kernels.clip`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE, srgb_from_linear
from farfield.kernels.clip import clip
from farfield.represent.chunk import Chunk

_EVERYWHERE = 1 << 30


@dataclass(frozen=True, slots=True)
class Pieces:
    """Triangles and parts of triangles in cells, ordered by triangle."""

    source: NDArray[np.int32]
    """(e,) int32: triangle of each entry."""
    cell: NDArray[np.int32]
    """(e, 3) int32: leaf index."""
    piece: NDArray[np.int32]
    """(e,) int32 into the two arrays below; -1: the triangle lies in the cell whole."""
    positions: NDArray[np.float64]
    """(p, 3, 3) float64: corners of each piece, metres from the grid's corner."""
    weights: NDArray[np.float64]
    """(p, 3, 3) float64: weights of the triangle's corners at each corner of the piece."""

    def of(self, chosen: NDArray[np.bool_]) -> Pieces:
        """Some of the entries."""
        return Pieces(self.source[chosen], self.cell[chosen], self.piece[chosen], self.positions, self.weights)


@dataclass(frozen=True, slots=True)
class Triangles:
    """Placed triangles, before they are cut."""

    positions: NDArray[np.float64]
    """(n, 3) float64 metres from the grid's corner."""
    normals: NDArray[np.float32]
    """(n, 3) float32."""
    uvs: NDArray[np.float32]
    """(n, 2) float32 or (0, 2)."""
    colors: NDArray[np.uint8]
    """(n, 4) uint8 or (0, 4)."""
    triangles: NDArray[np.uint32]
    """(m, 3) uint32."""
    materials: NDArray[np.uint32]
    """(m,) uint32."""
    objects: NDArray[np.uint32]
    """(m,) uint32."""

    def chunk(self) -> Chunk:
        """The same in single precision, uncut."""
        return Chunk(
            self.positions.astype(np.float32),
            self.normals,
            self.uvs,
            self.colors,
            self.triangles,
            self.materials,
            self.objects,
        )


def clip_to_cells(
    positions: NDArray[np.float64],
    triangles: NDArray[np.uint32],
    leaf_size: float,
    first: tuple[int, int, int] = (-_EVERYWHERE,) * 3,
    last: tuple[int, int, int] = (_EVERYWHERE,) * 3,
) -> Pieces:
    """Partition of triangles among the leaf cells first..last (inclusive).

    positions: (n, 3) float64 metres from the grid's corner; triangles: (m, 3) uint32.
    """
    low, high = np.array(first, dtype=np.int64), np.array(last, dtype=np.int64)
    entries, pieces = len(triangles), 1024
    while True:
        source, piece = np.empty(entries, dtype=np.int32), np.empty(entries, dtype=np.int32)
        cell = np.empty((entries, 3), dtype=np.int32)
        corners, weights = np.empty((pieces, 3, 3)), np.empty((pieces, 3, 3))
        needed = clip(positions, triangles, leaf_size, low, high, source, cell, piece, corners, weights)
        if needed[0] <= entries and needed[1] <= pieces:
            break
        entries, pieces = needed
    entries, pieces = needed
    return Pieces(source[:entries], cell[:entries], piece[:entries], corners[:pieces], weights[:pieces])


def clip_to_cell(surface: Triangles, leaf_size: float, index: tuple[int, int, int]) -> Chunk | None:
    """What of a surface lies in one leaf cell, or None."""
    pieces = clip_to_cells(surface.positions, surface.triangles, leaf_size, index, index)
    if len(pieces.source) == 0:
        return None
    return assemble(surface, pieces, np.array(index) * leaf_size)


def assemble(surface: Triangles, pieces: Pieces, lower: NDArray[np.float64]) -> Chunk:
    """One chunk of all entries of `pieces`, relative to `lower` (metres from the grid's corner)."""
    cut = pieces.piece >= 0
    if len(cut) == len(surface.triangles) and not cut.any():
        return replace(surface, positions=surface.positions - lower).chunk()
    whole = surface.triangles[pieces.source[~cut]]
    used = np.zeros(len(surface.positions), dtype=bool)
    used[whole.ravel()] = True
    vertices = np.flatnonzero(used)
    renumbered = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    corners = surface.triangles[pieces.source[cut]]
    weights = pieces.weights[pieces.piece[cut]]
    added = pieces.positions[pieces.piece[cut]].reshape(-1, 3)
    order = np.concatenate([pieces.source[~cut], pieces.source[cut]])
    fresh = np.arange(len(added), dtype=np.uint32).reshape(-1, 3) + np.uint32(len(vertices))
    return Chunk(
        np.concatenate([surface.positions[vertices] - lower, added - lower]).astype(np.float32),
        np.concatenate([surface.normals[vertices], _mixed(surface.normals, corners, weights)]),
        _joined(surface.uvs, vertices, corners, weights),
        _joined_colors(surface.colors, vertices, corners, weights),
        np.concatenate([renumbered[whole], fresh]),
        surface.materials[order],
        surface.objects[order],
    )


def append_pieces(
    chunk: Chunk, whole: NDArray[np.int32], source: NDArray[np.int32], weights: NDArray[np.float64]
) -> Chunk:
    """Some triangles of a chunk whole, and pieces of others, whose corners follow those of the chunk.

    whole: (w,) int32. source: (p,) int32, the triangle of each piece; weights: (p, 3, 3) as in Pieces.
    """
    corners = chunk.triangles[source]
    everything = np.arange(len(chunk.positions))
    fresh = np.arange(3 * len(source), dtype=np.uint32).reshape(-1, 3) + np.uint32(len(everything))
    order = np.concatenate([whole, source])
    if len(source) == 0:
        if len(whole) == len(chunk.triangles):
            return chunk
        return replace(
            chunk, triangles=chunk.triangles[whole], materials=chunk.materials[whole], objects=chunk.objects[whole]
        )
    return Chunk(
        np.concatenate([chunk.positions, _mixed(chunk.positions, corners, weights)]),
        np.concatenate([chunk.normals, _mixed(chunk.normals, corners, weights)]),
        _joined(chunk.uvs, everything, corners, weights),
        _joined_colors(chunk.colors, everything, corners, weights),
        np.concatenate([chunk.triangles[whole], fresh]),
        chunk.materials[order],
        chunk.objects[order],
    )


def _mixed(
    values: NDArray[np.float32], corners: NDArray[np.uint32], weights: NDArray[np.float64]
) -> NDArray[np.float32]:
    mixed = np.einsum("pij,pjk->pik", weights, values[corners].astype(np.float64))
    rows: NDArray[np.float32] = mixed.reshape(-1, values.shape[1]).astype(np.float32)
    return rows


def _joined(
    values: NDArray[np.float32], vertices: NDArray[np.int64], corners: NDArray[np.uint32], weights: NDArray[np.float64]
) -> NDArray[np.float32]:
    return np.concatenate([values[vertices], _mixed(values, corners, weights)]) if len(values) else values


def _joined_colors(
    colors: NDArray[np.uint8], vertices: NDArray[np.int64], corners: NDArray[np.uint32], weights: NDArray[np.float64]
) -> NDArray[np.uint8]:
    if not len(colors):
        return colors
    linear = np.concatenate([LINEAR_OF_BYTE[colors[:, :3]], colors[:, 3:] / np.float32(255)], axis=1)
    mixed = _mixed(linear, corners, weights)
    encoded = np.concatenate([srgb_from_linear(mixed[:, :3]), mixed[:, 3:]], axis=1)
    return np.concatenate([colors[vertices], np.floor(encoded * 255 + 0.5).astype(np.uint8)])
