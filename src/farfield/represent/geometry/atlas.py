"""Charts of a surface, each seen along an axis, and where they lie in one image.

    charts = charts_of(chunk)
    atlas = packed(charts, np.flatnonzero(charts.areas > 16 * texel**2), texel)

Corners of triangles lie in the middle of texels or between such, so that bilinear look-ups never leave a chart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.collapse import join_places
from farfield.represent.chunk import Chunk

MOST_SIDE = 8192
"""Texels (spec/world.md, Limits)."""
_WIDTHS = (1.0, 1.06, 1.12, 1.2, 1.3, 1.5, 1.8)
"""Times the side of a square of the area of all charts: widths of images that are tried."""
_ACROSS = np.array([[1, 2], [2, 0], [0, 1]])
"""For each axis the two others."""


@dataclass(frozen=True, slots=True)
class Charts:
    """Connected triangles of one material that face along the same of six directions."""

    chart: NDArray[np.int64]
    """(m,) of each triangle, 0 .. count - 1."""
    flat: NDArray[np.float64]
    """(m, 3, 2) metres: its corners, from the lower corner of the chart's box."""
    size: NDArray[np.float64]
    """(count, 2) metres of the boxes, the longer side first."""
    areas: NDArray[np.float64]
    """(count,) square metres, as they are seen along the axis."""

    def __len__(self) -> int:
        return len(self.areas)


@dataclass(frozen=True, slots=True)
class Atlas:
    """Charts in an image."""

    rows: NDArray[np.int64]
    """(k,) triangles that lie in it, ascending."""
    corners: NDArray[np.float64]
    """(k, 3, 2) texels: x and y of their corners; texel (i, j) is from i to i + 1."""
    boxes: NDArray[np.int64]
    """(c, 4) texels: x, y, width and height of each chart."""
    width: int
    height: int


def charts_of(chunk: Chunk) -> Charts:
    """All that a chunk has. Those of its triangles that have no area lie in charts of no size."""
    corners = chunk.positions[chunk.triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normal).argmax(axis=1)
    along = np.take_along_axis(normal, axis[:, None], 1)[:, 0]
    label = (2 * axis + (along < 0)) + 6 * chunk.materials.astype(np.int64)
    chart = _joined(chunk, label)
    count = int(chart.max(initial=-1)) + 1
    flat = np.take_along_axis(corners, np.repeat(_ACROSS[axis][:, None], 3, axis=1), 2)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(axis=1))
    np.maximum.at(high, chart, flat.max(axis=1))
    flat -= low[chart][:, None]
    size = high - low
    # Lying, so that they stand on shelves of little height.
    stands = size[:, 1] > size[:, 0]
    flat[stands[chart]] = flat[stands[chart]][..., ::-1]
    size[stands] = size[stands][:, ::-1]
    return Charts(chart, flat, size, np.bincount(chart, np.abs(along) / 2, count).astype(np.float64))


def packed(charts: Charts, chosen: NDArray[np.int64], texel: float) -> Atlas:
    """Some of the charts, one or more, in as small an image as is found. texel: metres along its side."""
    sides = np.maximum(np.ceil(charts.size[chosen] / texel - 1e-6).astype(np.int64) + 1, 2)
    places, width, height = _on_shelves(sides)
    number = np.full(len(charts), -1)
    number[chosen] = np.arange(len(chosen))
    rows = np.flatnonzero(number[charts.chart] >= 0)
    own = number[charts.chart[rows]]
    inner = np.minimum(charts.flat[rows] / texel, (sides[own] - 1)[:, None])
    corners = inner + 0.5 + places[own][:, None]
    return Atlas(rows, corners, np.concatenate([places, sides], axis=1), width, height)


def fits(charts: Charts, chosen: NDArray[np.int64], texel: float, most: int) -> bool:
    """Whether these charts take no more than so many texels, and none is longer than an image may be."""
    sides = charts.size[chosen] / texel + 1
    return bool(sides.max(initial=0) < MOST_SIDE / 2 and sides.prod(axis=1).sum() <= most)


def _joined(chunk: Chunk, label: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m,) component of each triangle, joined to those of its label with which it shares a place."""
    positions = chunk.positions + np.float32(0)  # -0 is the same place as 0
    _, place = np.unique(positions, axis=0, return_inverse=True)
    corners = place.ravel()[chunk.triangles] + len(positions) * label[:, None]
    names, corners = np.unique(corners, return_inverse=True)
    component = np.arange(len(names), dtype=np.uint32)
    triangles = corners.reshape(-1, 3).astype(np.uint32)
    join_places(triangles, np.arange(len(names), dtype=np.uint32), component)
    _, chart = np.unique(component[triangles[:, 0]], return_inverse=True)
    return chart.astype(np.int64)


def _on_shelves(sides: NDArray[np.int64]) -> tuple[NDArray[np.int64], int, int]:
    """(n, 2) places of rectangles (n, 2), and the width and height of the image: one shelf above the other."""
    order = np.lexsort((np.arange(len(sides)), -sides[:, 0], -sides[:, 1]))
    listed = sides[order].tolist()
    area, widest = float(sides.prod(axis=1).sum()), int(sides[:, 0].max())
    best: tuple[int, list[tuple[int, int]], int, int] | None = None
    for share in _WIDTHS:
        room = min(max(widest, int(np.ceil(share * area**0.5))), MOST_SIDE)
        places, width, height = _shelved(listed, room)
        if best is None or width * height < best[0]:
            best = width * height, places, width, height
    assert best is not None
    _, places, width, height = best
    found = np.empty((len(sides), 2), np.int64)
    found[order] = places
    return found, width, height


def _shelved(sides: list[list[int]], room: int) -> tuple[list[tuple[int, int]], int, int]:
    """Rectangles by descending height, on shelves that are `room` wide; each on the first that has room for it."""
    narrowest = min(wide for wide, _ in sides)
    shelves: list[list[int]] = []  # How far each is filled, how high its board is; full ones are left out.
    places, top, width = [], 0, 0
    for wide, high in sides:
        shelf = next((one for one in shelves if one[0] + wide <= room), None)
        if shelf is None:
            shelf = [0, top]
            shelves.append(shelf)
            top += high
        places.append((shelf[0], shelf[1]))
        shelf[0] += wide
        width = max(width, shelf[0])
        if shelf[0] + narrowest > room:
            shelves.remove(shelf)
    return places, width, top
