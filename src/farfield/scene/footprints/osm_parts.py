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
    other = parts[which] != buildings[tree]
    which, candidate = which[other], buildings[tree[other]]
    share = shapely.area(shapely.intersection(shapes[parts[which]], shapes[candidate])) / shapely.area(
        shapes[parts[which]]
    )
    # Of two that hold all of it the difference is rounding.
    order = np.lexsort((candidate, shapely.area(shapes[candidate]), -np.round(share, 3), which))
    order = order[share[order] >= _OWN]
    rows, first = np.unique(which[order], return_index=True)
    found[rows] = candidate[order[first]]
    return found


def remainders(
    shapes: NDArray[np.object_], parts: Parts, height: NDArray[np.float64], lift: NDArray[np.float64]
) -> dict[int, Any]:
    """What is left of every outline that has parts: row -> its shape, or None where nothing of it is drawn.

    Parts that begin on its roof, or above, take nothing away from it.
    """
    import shapely

    left: dict[int, Any] = {}
    rows = np.flatnonzero(parts.outline >= 0)
    if not len(rows):
        return left
    rows = rows[np.argsort(parts.outline[rows], kind="stable")]
    outlines, first = np.unique(parts.outline[rows], return_index=True)
    for outline, own in zip(outlines.tolist(), np.split(rows, first[1:]), strict=True):
        whole = shapes[outline]
        area = shapely.area(whole)
        if shapely.area(shapely.intersection(whole, shapely.union_all(shapes[own]))) >= COVERED * area:
            left[outline] = None
            continue
        within = own[lift[own] < height[outline]]
        rest = shapely.difference(whole, shapely.union_all(shapes[within]))
        left[outline] = rest if shapely.area(rest) > 0 else None
    return left
