"""Aggregates, such as the leaves of a tree or a heap of stones: fewer of them, each enlarged (Cook et al. 2007,
Stochastic simplification of aggregate detail).

Collapsing the edges of a thousand cards leaves slivers of them, and a bald tree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.morton import codes_along
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.wedges import Wedges

FEWEST = 32
"""Parts of one material and object that make an aggregate."""
LARGEST = 8.0
"""A part of more than so many times the median area is no member."""
SLENDER = 0.05
"""Second over first moment of a part below which it is a twig, not a member, unless it is a sheet."""
WITHIN = 0.35
"""Share of the spread of an aggregate that its parts may have in themselves."""


@dataclass(frozen=True, slots=True)
class Aggregate:
    """Parts of about one size, of one material and object."""

    rows: NDArray[np.int64]
    """(k,) int64 triangles of the chunk."""
    parts: NDArray[np.int64]
    """(k,) int64 part of each, 0 .. count - 1, in an order whose every beginning is spread evenly over all."""
    count: int


def aggregates(chunk: Chunk, wedges: Wedges) -> list[Aggregate]:
    """All that a mesh has; wedges: of the chunk, with all its triangles."""
    component = wedges.components
    count = int(component.max(initial=-1)) + 1
    if count < FEWEST:
        return []
    parts = _Parts.of(wedges, component, count)
    group = wedges.groups[wedges.triangles[:, 0]].astype(np.int64)
    lowest, highest = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(lowest, component, group)
    np.maximum.at(highest, component, group)
    found = []
    for number in np.unique(group):
        members = np.flatnonzero((lowest == number) & (highest == number) & parts.is_bulky)
        if len(members) >= FEWEST:
            members = members[parts.areas[members] <= LARGEST * np.median(parts.areas[members])]
        if len(members) >= FEWEST:
            rank = np.full(count, -1)
            rank[members[_spread(parts.centers[members])]] = np.arange(len(members))
            rows = np.flatnonzero(rank[component] >= 0)
            found.append(Aggregate(wedges.rows[rows], rank[component[rows]], len(members)))
    return found


def thinned(chunk: Chunk, aggregate: Aggregate, triangles: int) -> Chunk:
    """The parts that come first, at least one, with no more triangles than asked for.

    They are enlarged to the area of all, and moved towards the middle until they spread as far as all did: else a crown
    would grow by half a leaf, and its leaves are four times as large.
    """
    counts = np.bincount(aggregate.parts)
    kept = max(int((np.cumsum(counts) <= triangles).sum()), 1)
    area = _areas(chunk, aggregate.rows)
    middle, whole = _moments(chunk, aggregate.rows, area)
    chosen = aggregate.parts < kept
    rows, part, area, total = aggregate.rows[chosen], aggregate.parts[chosen], area[chosen], float(area.sum())
    corners = chunk.positions[chunk.triangles[rows]].astype(np.float64).mean(axis=1)
    weight = np.maximum(np.bincount(part, area), 1e-300)
    centers = np.column_stack([np.bincount(part, area * corners[:, axis]) / weight for axis in range(3)])
    vertices, first = np.unique(chunk.triangles[rows].ravel(), return_index=True)
    own = centers[part[first // 3]]
    around = chunk.positions[vertices] - own
    centered = chunk.positions.copy()
    centered[vertices] = around
    within = _moments(replace(chunk, positions=centered), rows, area)[1]
    between = np.average((centers - middle) ** 2, axis=0, weights=weight)
    # By the axis in the middle: a heap may be flat, but a fir is not to become a pole.
    most = np.median(WITHIN * whole / np.maximum(within, 1e-300))
    squared = max(min(total / max(float(area.sum()), 1e-300), float(most)), 1.0)
    nearer = np.sqrt(np.clip((whole - squared * within) / np.maximum(between, 1e-300), 0, 1))
    around *= np.sqrt(squared)
    positions = chunk.positions.copy()
    positions[vertices] = middle + nearer * (own - middle) + around
    return replace(
        chunk,
        positions=positions,
        triangles=chunk.triangles[rows],
        materials=chunk.materials[rows],
        objects=chunk.objects[rows],
    )


@dataclass(frozen=True, slots=True)
class _Parts:
    """Connected components as a whole, a row each."""

    areas: NDArray[np.float64]
    centers: NDArray[np.float64]
    is_bulky: NDArray[np.bool_]
    """Sheets, and what is no twig."""

    @classmethod
    def of(cls, wedges: Wedges, component: NDArray[np.int64], count: int) -> _Parts:
        area = np.linalg.norm(wedges.area_vectors, axis=1)
        areas = np.maximum(np.bincount(component, area, count), 1e-300)
        middle = wedges.points[wedges.places[wedges.triangles]].astype(np.float64).mean(axis=1)
        centers = np.column_stack([np.bincount(component, area * middle[:, k], count) / areas for k in range(3)])
        return cls(areas, centers, ~_slender(wedges, component, centers) | _sheets(wedges, component, count))


def _slender(wedges: Wedges, component: NDArray[np.int64], centers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(c,) bool: much longer than wide, by the second moments of the corners."""
    count = len(centers)
    moments = np.zeros((count, 3, 3))
    for corner in range(3):
        away = wedges.points[wedges.places[wedges.triangles[:, corner]]] - centers[component]
        for i in range(3):
            for j in range(3):
                moments[:, i, j] += np.bincount(component, away[:, i] * away[:, j], count)
    spread = np.linalg.eigvalsh(moments)
    return np.asarray(spread[:, 1] < SLENDER * spread[:, 2])


def _sheets(wedges: Wedges, component: NDArray[np.int64], count: int) -> NDArray[np.bool_]:
    """(c,) bool: every triangle lies at the border, as those of cards and blades do."""
    corners = wedges.places[wedges.triangles].astype(np.int64)
    other = np.roll(corners, -1, axis=1)
    edges = np.minimum(corners, other) * len(wedges.points) + np.maximum(corners, other)
    _, edge, uses = np.unique(edges.ravel(), return_inverse=True, return_counts=True)
    inside = (uses[edge].reshape(-1, 3) > 1).all(axis=1)
    return np.asarray(np.bincount(component[inside], minlength=count) == 0)


def _moments(
    chunk: Chunk, rows: NDArray[np.int64], area: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3,) middle of some triangles' corners, weighted by area, and (3,) mean squares of their distances from it."""
    corners = chunk.positions[chunk.triangles[rows]].astype(np.float64)
    weight = np.maximum(area, 1e-300)
    middle = np.average(corners.mean(axis=1), axis=0, weights=weight)
    return middle, np.average(((corners - middle) ** 2).mean(axis=1), axis=0, weights=weight)


def _areas(chunk: Chunk, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (chunk.positions[chunk.triangles[rows, k]].astype(np.float64) for k in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _spread(centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order in which every beginning is spread evenly: along a space-filling curve, by bits of the place reversed."""
    along = np.argsort(codes_along(centers), kind="stable")
    bits = max(int(len(along) - 1).bit_length(), 1)
    place, turned = np.arange(len(along)), np.zeros(len(along), np.int64)
    for _ in range(bits):
        turned = (turned << 1) | (place & 1)
        place >>= 1
    return along[np.argsort(turned, kind="stable")]
