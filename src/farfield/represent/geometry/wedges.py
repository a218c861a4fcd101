"""A chunk as edge collapse sees it: places, wedges of attributes at them, connected components."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.kernels.collapse import join_places
from farfield.represent.chunk import Chunk

_POWERS = np.array([pow(0xD1342543DE82EF95, k, 1 << 64) for k in range(1, 10)], dtype=np.uint64)


@dataclass(frozen=True, slots=True)
class Wedges:
    """A place is a position; a wedge a place with one set of attributes, one material and one object."""

    chunk: Chunk
    triangles: NDArray[np.uint32]
    """(m, 3) uint32 wedges; none has two corners at one place."""
    rows: NDArray[np.int64]
    """(m,) int64 triangle of the chunk that each is."""
    places: NDArray[np.uint32]
    """(w,) uint32 place of each wedge."""
    groups: NDArray[np.uint32]
    """(w,) uint32 number of its material and object."""
    points: NDArray[np.float32]
    """(p, 3) float32 position of each place, metres."""
    vertices: NDArray[np.int64]
    """(w,) int64 a vertex of the chunk that has the wedge's attributes."""
    keys: NDArray[np.uint64]
    """(g,) uint64 of each group: material, and object in the lower half."""

    @classmethod
    def of(cls, chunk: Chunk) -> Wedges:
        """Corners at the same place made one; what has no area there is left out.

        Places and wedges are numbered by what they are, so the order of the chunk's vertices does not matter.
        """
        positions = chunk.positions + np.float32(0)  # -0 is the same place as 0
        at = _hashed(positions.view(np.uint32))
        looks = [chunk.normals.view(np.uint32), chunk.uvs.view(np.uint32), chunk.colors.view(np.uint32)]
        like = _hashed(np.concatenate([at.view(np.uint32).reshape(-1, 2), *(c for c in looks if len(c))], axis=1))
        keys, group = np.unique(chunk.materials.astype(np.uint64) << np.uint64(32) | chunk.objects, return_inverse=True)
        corners = like[chunk.triangles] + group[:, None].astype(np.uint64) * _POWERS[8]
        _, first, wedge = np.unique(corners.ravel(), return_index=True, return_inverse=True)
        vertices = chunk.triangles.ravel()[first].astype(np.int64)
        _, one, place = np.unique(at[vertices], return_index=True, return_inverse=True)
        triangles = wedge.reshape(-1, 3).astype(np.uint32)
        places = place.astype(np.uint32)
        groups = group[first // 3].astype(np.uint32)
        points = positions[vertices[one]]
        kept = np.flatnonzero(distinct(places[triangles]))
        return cls(chunk, triangles[kept], kept, places, groups, points, vertices, keys)

    @property
    def objects(self) -> NDArray[np.uint32]:
        """(w,) uint32 object of each wedge."""
        return (self.keys[self.groups] & np.uint64(0xFFFFFFFF)).astype(np.uint32)

    @property
    def components(self) -> NDArray[np.int64]:
        """(m,) int64: connected component of each triangle, numbered from 0."""
        component = np.arange(len(self.points), dtype=np.uint32)
        join_places(self.triangles, self.places, component)
        _, number = np.unique(component[self.places[self.triangles[:, 0]]], return_inverse=True)
        return number.astype(np.int64)

    @property
    def area_vectors(self) -> NDArray[np.float64]:
        """(m, 3) float64: normals of the triangles, as long as their areas, square metres."""
        a, b, c = (self.points[self.places[self.triangles[:, k]]].astype(np.float64) for k in range(3))
        return np.asarray(np.cross(b - a, c - a) / 2)

    def sums(self) -> NDArray[np.float64]:
        """(w, 3, or 7 with colours) float64: normals and, in linear light, colours, times the area around, and it."""
        chunk, count = self.chunk, len(self.vertices)
        area = np.linalg.norm(self.area_vectors, axis=1)
        share = np.bincount(self.triangles.ravel(), np.repeat(area, 3), count).astype(np.float64)
        sums: list[NDArray[np.float64]] = [chunk.normals[self.vertices].astype(np.float64) * share[:, None]]
        if len(chunk.colors):
            colors = chunk.colors[self.vertices]
            linear = np.column_stack([LINEAR_OF_BYTE[colors[:, :3]].astype(np.float64), colors[:, 3] / 255.0])
            sums += [linear * share[:, None], share[:, None]]
        return np.concatenate(sums, axis=1)

    def rebuilt(
        self,
        triangles: NDArray[np.uint32],
        sums: NDArray[np.float64],
        positions: NDArray[np.float32],
        uvs: NDArray[np.float32],
    ) -> Chunk:
        """Chunk of some triangles of the wedges; normals and colours are means of all that became each wedge.

        positions: (p, 3) of the places. uvs: (w, 2) or (0, 2).
        """
        chunk = self.chunk
        used, corners = np.unique(triangles, return_inverse=True)
        vertices = self.vertices[used]
        key = self.keys[self.groups[triangles[:, 0]]]
        return Chunk(
            positions[self.places[used]],
            _unit(sums[used, :3], chunk.normals[vertices]),
            uvs[used] if len(uvs) else uvs,
            _mean_colors(sums[used, 3:], chunk.colors[vertices]) if len(chunk.colors) else chunk.colors,
            corners.reshape(-1, 3).astype(np.uint32),
            (key >> np.uint64(32)).astype(np.uint32),
            (key & np.uint64(0xFFFFFFFF)).astype(np.uint32),
        )


def _hashed(words: NDArray[np.uint32]) -> NDArray[np.uint64]:
    """(n, k <= 8) uint32 -> (n,) uint64 that tell different rows apart, against chance."""
    total = np.zeros(len(words), np.uint64)
    for column, power in zip(words.T, _POWERS[:8], strict=False):
        mixed = (column + np.uint64(1)) * power
        total += mixed ^ (mixed >> np.uint64(31))
    return np.asarray((total ^ (total >> np.uint64(29))) * _POWERS[1])


def distinct(corners: NDArray[np.uint32]) -> NDArray[np.bool_]:
    a, b, c = corners.T
    return np.asarray((a != b) & (b != c) & (c != a))


def _unit(sums: NDArray[np.float64], otherwise: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normals along sums; where they cancel out those of the vertex."""
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 1e-12, sums / np.maximum(length, 1e-300), otherwise).astype(np.float32)


def _mean_colors(sums: NDArray[np.float64], otherwise: NDArray[np.uint8]) -> NDArray[np.uint8]:
    area = sums[:, 4:]
    mean = np.clip(sums[:, :4] / np.maximum(area, 1e-300), 0, 1)
    rgb = BYTE_OF_LINEAR[np.round(mean[:, :3] * 4095).astype(np.uint16)]
    alpha = np.round(mean[:, 3:] * 255).astype(np.uint8)
    return np.where(area > 0, np.concatenate([rgb, alpha], axis=1), otherwise)
