"""Parts and outlines of buildings in OpenStreetMap: where parts are, they are drawn instead of the outline.

Simple 3D Buildings (wiki.openstreetmap.org/wiki/Simple_3D_Buildings).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

COVERED = 0.6
"""Share of an outline that its parts cover from which on it is not drawn at all; below, what they leave of it is."""
_OWN = 0.5
"""Share of a part that lies in its outline, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """Which outline each of n shapes is a part of."""

    outline: NDArray[np.int64]
    """(n,) row of it; -1: none."""

    @classmethod
    def of(cls, shapes: NDArray[np.object_], building: NDArray[np.bool_], part: NDArray[np.bool_]) -> Parts:
        """shapes: (n,) valid areas. What is tagged as both is a part only of another building than itself."""
        outline = np.full(len(shapes), -1)
        both = np.flatnonzero(building & part)
        outline[both] = _outlines(shapes, both, np.flatnonzero(building))
        while (inner := np.flatnonzero((outline >= 0) & (outline[outline] >= 0))).size:
            outline[inner] = outline[outline[inner]]
        single = np.flatnonzero(part & ~building)
        outline[single] = _outlines(shapes, single, np.flatnonzero(building & (outline < 0)))
        return cls(outline)


def _outlines(shapes: NDArray[np.object_], parts: NDArray[np.int64], buildings: NDArray[np.int64]) -> NDArray[np.int64]:
    """(k,) the building that holds most of each part, of several the smallest; -1: none holds half of it."""
    import shapely

    found = np.full(len(parts), -1)
    if not len(parts) or not len(buildings):
        return found
    which, tree = shapely.STRtree(shapes[buildings]).query(shapes[parts], predicate="intersects")
    area = shapely.area(shapes)
    own, candidate = parts[which], buildings[tree]
    # Of what is tagged as both the larger is never a part of the smaller.
    larger = (area[candidate] > area[own]) | ((area[candidate] == area[own]) & (candidate < own))
    larger = (larger | ~np.isin(own, buildings)) & (area[own] > 0)
    which, own, candidate = which[larger], own[larger], candidate[larger]
    share = shapely.area(shapely.intersection(shapes[own], shapes[candidate])) / area[own]
    # Of two that hold all of it the difference is rounding.
    order = np.lexsort((candidate, area[candidate], -np.round(share, 3), which))
    order = order[share[order] >= _OWN]
    rows, first = np.unique(which[order], return_index=True)
    found[rows] = candidate[order[first]]
    return found


def remainders(
    shapes: NDArray[np.object_], parts: Parts, height: NDArray[np.float64], lift: NDArray[np.float64]
) -> dict[int, Any]:
    """What is left of the outlines that parts take away from: row -> its shape, or None where nothing of it is drawn.

    Parts that begin on the roof of their outline, or above, take nothing away from it: it is what they stand on.
    """
    import shapely

    left: dict[int, Any] = {}
    rows = np.flatnonzero(parts.outline >= 0)
    if not len(rows):
        return left
    rows = rows[np.argsort(parts.outline[rows], kind="stable")]
    outlines, first = np.unique(parts.outline[rows], return_index=True)
    for outline, own in zip(outlines.tolist(), np.split(rows, first[1:]), strict=True):
        within = own[lift[own] < height[outline]]
        if not len(within):
            continue
        whole, drawn = shapes[outline], shapely.union_all(shapes[within])
        covered = shapely.area(shapely.intersection(whole, drawn)) >= COVERED * shapely.area(whole)
        rest = None if covered else shapely.difference(whole, drawn)
        left[outline] = rest
    return left
