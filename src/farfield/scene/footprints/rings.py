"""Footprints as flat arrays of rings, repaired and oriented."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.faults import counted

SMALLEST = 0.01
"""Square metres; footprints below it count as having no area."""


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Polygons of several features. Outer rings run counter-clockwise, holes clockwise, and are not closed."""

    xy: NDArray[np.floating]
    """(v, 2) metres."""
    ring_start: NDArray[np.int64]
    """(r + 1,) into xy."""
    polygon_start: NDArray[np.int64]
    """(p + 1,) into rings; the first ring of a polygon is its outer one."""
    polygon_feature: NDArray[np.int64]
    """(p,) feature of each polygon, ascending."""

    def of_features(self, first: int, last: int) -> Rings:
        """Rings of the features first .. last - 1, numbered from 0. No copies."""
        p0, p1 = np.searchsorted(self.polygon_feature, [first, last])
        r0, r1 = self.polygon_start[[p0, p1]]
        v0, v1 = self.ring_start[[r0, r1]]
        return Rings(
            self.xy[v0:v1],
            self.ring_start[r0 : r1 + 1] - v0,
            self.polygon_start[p0 : p1 + 1] - r0,
            self.polygon_feature[p0:p1] - first,
        )


def repaired(shapes: NDArray[np.object_], where: str, warnings: list[str]) -> NDArray[np.object_]:
    """(n,) polygons and multipolygons; None for what has no area even after repair. Both are counted."""
    import shapely

    shapes = np.asarray(shapes, object).copy()
    present = ~shapely.is_missing(shapes) & ~shapely.is_empty(shapes)
    polygonal = np.isin(shapely.get_type_id(shapes), (3, 6, 7))
    _count(int((present & ~polygonal).sum()), "feature", "that are not areas", where, warnings)
    _count(int((~present).sum()), "feature", "without a shape", where, warnings)
    shapes[~(present & polygonal)] = None
    crossing = np.flatnonzero(~shapely.is_missing(shapes) & ~shapely.is_valid(shapes))
    if len(crossing):
        shapes[crossing] = [_mended(shape) for shape in shapes[crossing]]
    lost = crossing[shapely.is_missing(shapes[crossing])]
    mended = int((shapely.area(shapes[crossing]) > SMALLEST).sum())
    if mended:
        warnings.append(f"{where}: repaired {counted(mended, 'footprint')} with self-crossing rings")
    _count(len(lost), "footprint", "with self-crossing rings that cannot be repaired", where, warnings)
    small = ~shapely.is_missing(shapes) & ~(shapely.area(shapes) > SMALLEST)
    _count(int(small.sum()), "footprint", "of no area", where, warnings)
    shapes[small] = None
    return shapes


def flat_rings(shapes: NDArray[np.object_]) -> Rings:
    """Rings of polygons and multipolygons, none missing; feature = row."""
    import shapely

    parts, feature = shapely.get_parts(shapes, return_index=True)
    nested = shapely.get_type_id(parts) != 3
    if nested.any():
        parts, inner = shapely.get_parts(parts, return_index=True)
        feature = feature[inner]
        areas = shapely.get_type_id(parts) == 3
        parts, feature = parts[areas], feature[areas]
    lines, polygon = shapely.get_rings(parts, return_index=True)
    sizes = shapely.get_num_coordinates(lines) - 1
    points, ring = shapely.get_coordinates(lines, return_index=True)
    last = np.append(ring[1:] != ring[:-1], True)
    first_ring = np.searchsorted(polygon, np.arange(len(parts) + 1))
    starts = np.concatenate([[0], np.cumsum(sizes)])
    rings = Rings(points[~last], starts, first_ring.astype(np.int64), feature.astype(np.int64))
    return _oriented(rings)


def next_in_ring(ring_start: NDArray[np.int64]) -> NDArray[np.int64]:
    """(v,): the vertex that follows each vertex in its ring."""
    following = np.arange(1, ring_start[-1] + 1)
    following[ring_start[1:] - 1] = ring_start[:-1]
    return following


def ring_areas(rings: Rings) -> NDArray[np.float64]:
    """(r,) signed areas, counter-clockwise positive."""
    start = rings.xy[np.repeat(rings.ring_start[:-1], np.diff(rings.ring_start))]
    a = rings.xy - start
    b = a[next_in_ring(rings.ring_start)]
    cross: NDArray[np.float64] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return 0.5 * np.add.reduceat(cross, rings.ring_start[:-1])


def _oriented(rings: Rings) -> Rings:
    outer = np.zeros(len(rings.ring_start) - 1, bool)
    outer[rings.polygon_start[:-1]] = True
    wrong = (ring_areas(rings) > 0) != outer
    sizes = np.diff(rings.ring_start)
    order = np.arange(len(rings.xy))
    mirrored = np.repeat(rings.ring_start[:-1] + rings.ring_start[1:] - 1, sizes) - order
    order = np.where(np.repeat(wrong, sizes), mirrored, order)
    return Rings(rings.xy[order], rings.ring_start, rings.polygon_start, rings.polygon_feature)


def _mended(shape: Any) -> Any:
    """The shape without self-crossings, empty when nothing is left; None when it cannot be repaired."""
    import shapely

    try:
        valid = shapely.make_valid(shape)
        areas = [part for part in shapely.get_parts(valid) if part.geom_type in ("Polygon", "MultiPolygon")]
        return shapely.union_all(areas)
    except shapely.errors.GEOSException:
        return None


def _count(count: int, noun: str, why: str, where: str, warnings: list[str]) -> None:
    if count:
        warnings.append(f"{where}: left out {counted(count, noun)} {why}")
