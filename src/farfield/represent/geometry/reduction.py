"""Fewer triangles by edge collapse (kernels.collapse), and by leaving out parts smaller than its error."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.collapse import collapse, price_edges
from farfield.kernels.quadrics import SHAPE, SLOPE, sum_quadrics, triangles_around
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.wedges import Wedges, distinct

BORDER = 10.0
"""How much more a border counts than a face."""
NORMAL = 0.01
"""What normals apart by a radian count as, in sizes of the mesh."""
COLOR = 0.05
"""What black and white count as, in sizes of the mesh."""
OVERSHOOT = 1.5
"""A pass goes to this times the price of the last edge it would need: so many are in the way of each other."""
STUCK = 0.02
"""A pass that takes less than this share of what is to go has found the edges that may not collapse."""
PART = 0.25
"""A part goes when this times its area over its length is below the error: of a tube or a ball 1.6 radii."""


FIRM = 1e9
"""What a fixed place counts as, in parts of a face as large as the mesh's box."""
DEAREST = 10.0
"""Price of an edge, squared sizes of the mesh, from which on it would move a fixed place."""


def reduced(chunk: Chunk, triangles: int, fixed: NDArray[np.bool_] | None = None) -> Chunk:
    """About as many triangles as asked for, never more than there are; more when their shape needs them.

    Each object keeps its largest part. fixed: (n,) vertices that stay where they are, and with them their parts. Needs
    500 bytes a triangle.
    """
    wedges = Wedges.of(chunk)
    if not len(wedges.triangles):
        return wedges.rebuilt(wedges.triangles, wedges.sums(), wedges.points, chunk.uvs)
    work = _Work.begun(wedges)
    if fixed is not None:
        work.fix(fixed)
    while (unwanted := len(work.triangles) - triangles) > 0:
        is_stuck = work.collapse_edges(triangles) < STUCK * unwanted
        left_out = work.leave_out_parts(triangles, np.inf if is_stuck else work.worst)
        if is_stuck and not left_out:
            break
    return wedges.rebuilt(work.triangles, work.sums, work.positions, work.uvs)


@dataclass(slots=True)
class _Work:
    """A mesh between two passes."""

    wedges: Wedges
    middle: NDArray[np.float64]
    """(3,) metres: where the zero of `points` is."""
    extent: float
    """Metres: their unit, the longest side of the mesh's box."""
    begun_at: NDArray[np.float64]
    """(p, 3) `points` as they were."""
    triangles: NDArray[np.uint32]
    """(m, 3) wedges."""
    component: NDArray[np.int64]
    """(m,) component of each triangle."""
    sizes: NDArray[np.float64]
    """(c,) half the thickness of each component, see PART, in sizes of the mesh; inf: it is to stay."""
    points: NDArray[np.float64]
    """(p, 3) of the places, in sizes of the mesh."""
    attributes: NDArray[np.float64]
    """(w, k) of the wedges: normal, texture coordinates, colour."""
    shapes: NDArray[np.float64]
    slopes: NDArray[np.float64]
    """See `sum_quadrics`."""
    sums: NDArray[np.float64]
    """See `Wedges.sums`."""
    fixed: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    """Places that stay."""
    worst: float = 0.0
    """Error of the dearest edge collapsed, in sizes of the mesh."""

    @property
    def positions(self) -> NDArray[np.float32]:
        """(p, 3) metres; of places that never moved to the bit what they were."""
        moved = self.points != self.begun_at
        return np.where(moved, self.points * self.extent + self.middle, self.wedges.points).astype(np.float32)

    @property
    def uvs(self) -> NDArray[np.float32]:
        """(w, 2), or (0, 2)."""
        return self.attributes[:, 3:5].astype(np.float32) if len(self.wedges.chunk.uvs) else self.wedges.chunk.uvs

    @classmethod
    def begun(cls, wedges: Wedges) -> _Work:
        low, high = wedges.points.min(axis=0).astype(np.float64), wedges.points.max(axis=0)
        extent = max(float((high - low).max()), 1e-30)
        middle = (low + high) / 2
        points = (wedges.points - middle) / extent
        attributes, weights = _attributes(wedges)
        shapes = np.zeros((len(points), SHAPE))
        slopes = np.zeros((len(attributes), SHAPE + SLOPE * attributes.shape[1]))
        start, around = _around(wedges, wedges.triangles)
        sum_quadrics(
            wedges.triangles, wedges.places, wedges.groups, points, attributes, weights, start, around, BORDER, shapes,
            slopes,
        )  # fmt: skip
        component = wedges.components
        sizes = _part_sizes(wedges, component) / extent
        return cls(
            wedges, middle, extent, points.copy(), wedges.triangles, component, sizes, points, attributes, shapes,
            slopes, wedges.sums(),
        )  # fmt: skip

    def fix(self, vertices: NDArray[np.bool_]) -> None:
        """Makes the places of some vertices of the chunk stay, and the parts that have any: such as ground."""
        self.fixed = chosen = np.unique(self.wedges.places[vertices[self.wedges.vertices]]).astype(np.int64)
        points = self.points[chosen]
        self.shapes[chosen, :3] += FIRM
        self.shapes[chosen, 6:9] -= FIRM * points
        self.shapes[chosen, 9] += FIRM * (points**2).sum(axis=1)
        holds = np.isin(self.wedges.places[self.triangles], chosen).any(axis=1)
        self.sizes[self.component[holds]] = np.inf

    def collapse_edges(self, wanted: int) -> int:
        """A pass over all edges. Returns how many triangles went."""
        wedges, before = self.wedges, len(self.triangles)
        start, around = _around(wedges, self.triangles)
        prices = np.empty(3 * before)
        moved, onto = (np.empty(len(prices), np.uint32) for _ in range(2))
        count = price_edges(
            self.triangles, wedges.places, wedges.groups, self.points, self.attributes, self.shapes, self.slopes,
            _single(wedges, self.triangles), start, around, prices, moved, onto,
        )  # fmt: skip
        order, most = _cheapest(prices[:count], before - wanted)
        went, became = (np.arange(n, dtype=np.uint32) for n in (len(self.points), len(wedges.places)))
        collapse(
            self.triangles, wedges.places, wedges.groups, wedges.objects, self.points, self.attributes, self.shapes,
            self.slopes, self.sums, start, around, prices, moved, onto, order, most, before - wanted,
            np.zeros(len(self.points), np.uint8), went, became,
        )  # fmt: skip
        # What went onto them has pulled at them, by less than a millionth.
        self.points[self.fixed] = self.begun_at[self.fixed]
        self.worst = max(self.worst, float(np.sqrt(most)))
        triangles = became[self.triangles]
        self._keep(triangles, distinct(wedges.places[triangles]))
        return before - len(self.triangles)

    def leave_out_parts(self, wanted: int, error: float) -> int:
        """Leaves out the smallest components below an error, as many as must go. Returns how many triangles went."""
        before = len(self.triangles)
        counts = np.bincount(self.component, minlength=len(self.sizes))
        order = np.argsort(self.sizes, kind="stable")
        still_there = before - np.cumsum(counts[order]) + counts[order]
        goes = (self.sizes[order] < error) & (still_there > wanted)
        stays = np.ones(len(self.sizes), np.bool_)
        stays[order[goes]] = False
        self._keep(self.triangles, stays[self.component])
        return before - len(self.triangles)

    def _keep(self, triangles: NDArray[np.uint32], kept: NDArray[np.bool_]) -> None:
        self.triangles, self.component = triangles[kept], self.component[kept]


def _attributes(wedges: Wedges) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(w, k) and the weights of `sum_quadrics`."""
    chunk, vertices = wedges.chunk, wedges.vertices
    columns, weights = [chunk.normals[vertices].astype(np.float64)], [NORMAL] * 3
    if len(chunk.uvs):
        # A texture that is shifted by a metre is as wrong as a surface that is a metre away.
        columns.append(chunk.uvs[vertices].astype(np.float64))
        weights += [-1.0] * 2
    if len(chunk.colors):
        columns.append(LINEAR_OF_BYTE[chunk.colors[vertices, :3]].astype(np.float64) ** 0.5)
        weights += [COLOR] * 3
    return np.concatenate(columns, axis=1), np.array(weights)


def _around(wedges: Wedges, triangles: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    start, around = np.empty(len(wedges.points) + 1, np.int64), np.empty(3 * len(triangles), np.uint32)
    triangles_around(triangles, wedges.places, start, around)
    return start, around


def _single(wedges: Wedges, triangles: NDArray[np.uint32]) -> NDArray[np.uint8]:
    used = np.zeros(len(wedges.places), np.bool_)
    used[triangles.ravel()] = True
    counts = np.bincount(wedges.places[used], minlength=len(wedges.points))
    return np.asarray(counts == 1).astype(np.uint8)


def _cheapest(prices: NDArray[np.float64], unwanted: int) -> tuple[NDArray[np.int64], float]:
    """Edges in the order of their prices, and the highest to pay in this pass. An edge takes two triangles away."""
    order = np.argsort(prices, kind="stable")
    order = order[: np.searchsorted(prices[order], DEAREST)]
    last = min(max(unwanted // 2, 1), len(order)) - 1
    return order, min(float(prices[order[last]]) * OVERSHOOT, DEAREST) if len(order) else 0.0


def _part_sizes(wedges: Wedges, component: NDArray[np.int64]) -> NDArray[np.float64]:
    """(c,) metres, see `_Work.sizes`; inf for the largest of each object."""
    area = np.bincount(component, np.linalg.norm(wedges.area_vectors, axis=1))
    objects = wedges.objects[wedges.triangles[:, 0]]
    sizes = PART * area / np.maximum(_lengths(wedges, component, len(area)), 1e-30)
    order = np.lexsort((-area[component], objects))
    _, first = np.unique(objects[order], return_index=True)
    sizes[component[order[first]]] = np.inf
    return np.asarray(sizes)


def _lengths(wedges: Wedges, component: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """(c,) longest side of each component's box, metres."""
    order = np.argsort(component, kind="stable")
    first = np.searchsorted(component[order], np.arange(count))
    corners = wedges.points[wedges.places[wedges.triangles[order]]]
    low, high = np.minimum.reduceat(corners.min(axis=1), first), np.maximum.reduceat(corners.max(axis=1), first)
    return np.asarray((high - low).max(axis=1), dtype=np.float64)
