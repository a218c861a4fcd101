"""Shapes that are no polygon, cross themselves or have no area: repaired or left out, and counted."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.faults import counted

SMALLEST = 0.01
"""Square metres; footprints below it count as having no area."""

_REPORTS = {
    "other": ("left out", "feature", "that are not areas"),
    "missing": ("left out", "feature", "without a shape"),
    "mended": ("repaired", "footprint", "with self-crossing rings"),
    "broken": ("left out", "footprint", "with self-crossing rings that cannot be repaired"),
    "small": ("left out", "footprint", "of no area"),
}
"""What is counted, in the order of its lines: what was done, to what, and why."""


def repaired(shapes: NDArray[np.object_], faults: Counter[str]) -> NDArray[np.object_]:
    """(n,) polygons and multipolygons; None for what has no area even after repair. Both are added to `faults`."""
    import shapely

    shapes = shapes.copy()
    present = ~shapely.is_missing(shapes) & ~shapely.is_empty(shapes)
    polygonal = np.isin(shapely.get_type_id(shapes), (3, 6, 7))
    shapes[~(present & polygonal)] = None
    there = ~shapely.is_missing(shapes)
    crossing = np.flatnonzero(there & ~shapely.is_valid(shapes))
    if len(crossing):
        shapes[crossing] = [_mended(shape) for shape in shapes[crossing]]
        there = ~shapely.is_missing(shapes)
    wide = shapely.area(shapes) > SMALLEST
    faults.update(
        other=int((present & ~polygonal).sum()),
        missing=int((~present).sum()),
        mended=int(wide[crossing].sum()),
        broken=int((~there[crossing]).sum()),
        small=int((there & ~wide).sum()),
    )
    shapes[~wide] = None
    return shapes


def reports(faults: Counter[str], where: str) -> list[str]:
    """A line for each kind of fault that was met."""
    return [
        f"{where}: {done} {counted(faults[kind], noun)} {why}"
        for kind, (done, noun, why) in _REPORTS.items()
        if faults[kind]
    ]


def _mended(shape: Any) -> Any:
    """The shape without self-crossings, empty when nothing is left; None when it cannot be repaired."""
    import shapely

    try:
        valid = shapely.make_valid(shape)
        areas = [part for part in shapely.get_parts(valid) if part.geom_type in ("Polygon", "MultiPolygon")]
        return shapely.union_all(areas)
    except shapely.errors.GEOSException:
        return None
