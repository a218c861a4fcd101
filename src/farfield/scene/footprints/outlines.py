"""The areas of a file's features as flat arrays, drawn from their shapes a batch at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.repair import repaired
from farfield.scene.footprints.reproject import Projection
from farfield.scene.footprints.rings import Rings, flat_rings, starts_of
from farfield.scene.footprints.table import FeatureTable

BATCH = 16_384
"""Features whose shapely objects are made together: 10 MB of buildings, and 8 MB for their parts."""
_GROWTH = 1.125
"""Factor of an array's length when it is full; what it has too much is memory while it grows."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The features that have an area."""

    row: NDArray[np.int64]
    """(n,) of each in the file, ascending."""
    box: NDArray[np.float64]
    """(n, 4) x0, y0, x1, y1, metres."""
    rings: Rings
    """Their feature is the row of this table, not of the file."""


def outlines_of(table: FeatureTable, project: Projection | None, batch: int, faults: Counter[str]) -> Outlines:
    """Outlines of all features with an area, their repairs counted in `faults`. The table's WKB is used up."""
    growing = _Growing()
    first = 0
    for shapes in _one_ahead(_areas(table, project, batch, faults)):
        growing.add(shapes, first)
        first += len(shapes)
    return growing.outlines()


def _areas(
    table: FeatureTable, project: Projection | None, batch: int, faults: Counter[str]
) -> Iterator[NDArray[np.object_]]:
    """Polygons and multipolygons of every batch, None for features without an area."""
    for shapes in table.batches(batch, release=True):
        yield repaired(shapes if project is None else project(shapes), faults)


def _one_ahead(batches: Iterator[NDArray[np.object_]]) -> Iterator[NDArray[np.object_]]:
    """The same batches; a thread makes each while the one before is used, as GEOS needs no interpreter lock."""
    with ThreadPoolExecutor(1) as thread:
        following = thread.submit(next, batches, None)
        while (batch := following.result()) is not None:
            following = thread.submit(next, batches, None)
            yield batch


@dataclass(slots=True)
class _Growing:
    """Outlines of the batches so far. Only the vertices are many: the other arrays are joined at the end."""

    xy: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    """(capacity, 2). It grows in place (realloc moves the pages of large blocks), so it is never there twice."""
    vertices: int = 0
    row: list[NDArray[np.int64]] = field(default_factory=list)
    box: list[NDArray[np.float64]] = field(default_factory=list)
    ring_size: list[NDArray[np.int64]] = field(default_factory=list)
    """Vertices of each ring."""
    polygon_size: list[NDArray[np.int64]] = field(default_factory=list)
    """Rings of each polygon."""
    polygon_row: list[NDArray[np.int64]] = field(default_factory=list)
    """Feature of each polygon, by its row in the file."""

    def add(self, shapes: NDArray[np.object_], first: int) -> None:
        """first: row of the first shape in the file."""
        import shapely

        rows = np.flatnonzero(~shapely.is_missing(shapes))
        rings = flat_rings(shapes[rows])
        self._add_vertices(rings.xy)
        self.row.append(rows + first)
        self.box.append(shapely.bounds(shapes[rows]))
        self.ring_size.append(np.diff(rings.ring_start))
        self.polygon_size.append(np.diff(rings.polygon_start))
        self.polygon_row.append(self.row[-1][rings.polygon_feature])

    def _add_vertices(self, xy: NDArray[np.floating]) -> None:
        count = self.vertices + len(xy)
        if count > len(self.xy):
            self.xy.resize((max(count, int(_GROWTH * len(self.xy))), 2), refcheck=False)
        self.xy[self.vertices : count] = xy
        self.vertices = count

    def outlines(self) -> Outlines:
        """All that was added; it takes the vertices with it."""
        self.xy.resize((self.vertices, 2), refcheck=False)
        row = np.concatenate(self.row)
        rings = Rings(
            self.xy,
            starts_of(np.concatenate(self.ring_size)),
            starts_of(np.concatenate(self.polygon_size)),
            np.searchsorted(row, np.concatenate(self.polygon_row)),
        )
        return Outlines(row, np.concatenate(self.box), rings)
