"""Converts a packed archive of Tokyo's buildings (buildings.npz, roofs.npz) to FlatGeobuf.

    python scripts/convert_tokyo.py roofs.npz tokyo.fgb --bbox -500,-500,500,500

Each feature is a footprint with its `height` in metres, in JGD2011 plane IX (EPSG:6677). The archives hold rings as
differences of decimetres; `building_rings`, `ring_size`, `ring_is_hole`, `anchor_*` and `delta_*` are their columns.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

CRS = "EPSG:6677"
INDEXED = 10_000
"""Buildings from which a file has a spatial index: a square of 400 m of all Tokyo is then read in milliseconds."""
BATCH = 65_536
"""Buildings whose shapely objects exist at the same time."""
Box = tuple[float, float, float, float]
Kind = Literal["Polygon", "MultiPolygon"]


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """Buildings as they are packed. Building b has the rings first_ring[b] .. first_ring[b + 1] - 1."""

    first_ring: NDArray[np.int64]
    """(b + 1,)"""
    ring_start: NDArray[np.int64]
    """(r + 1,) vertices before each ring."""
    hole: NDArray[np.bool_]
    """(r,); a hole belongs to the last outer ring before it."""
    anchor: NDArray[np.int64]
    """(r, 2) first vertex of each ring, decimetres from the origin."""
    delta: NDArray[np.int16]
    """(v - r, 2) steps from vertex to vertex within the rings, decimetres."""
    height: NDArray[np.float64]
    """(b,) metres."""
    origin: NDArray[np.float64]
    """(2,) EPSG:6677 coordinates of the archive's zero."""

    def inside(self, box: Box | None) -> NDArray[np.int64]:
        """Buildings whose first vertex lies in the box (metres from the origin), or all."""
        if box is None:
            return np.arange(len(self.height))
        first = self.anchor[self.first_ring[:-1]] * 0.1
        return np.flatnonzero(((first >= box[:2]) & (first < box[2:])).all(axis=1))

    def kind(self, buildings: NDArray[np.int64]) -> Kind:
        """Polygon when each has one outer ring."""
        outer = np.add.reduceat(~self.hole, self.first_ring[:-1], dtype=np.int64)
        return "Polygon" if (outer[buildings] == 1).all() else "MultiPolygon"

    def shapes(self, buildings: NDArray[np.int64]) -> NDArray[np.object_]:
        """(k,) polygons, or multipolygons where there are several outer rings; EPSG:6677, to 0.1 m."""
        per_building = np.diff(self.first_ring)[buildings]
        rings = stretches(self.first_ring[buildings], per_building)
        sizes = np.diff(self.ring_start)[rings]
        points = np.round(self._vertices(rings, sizes) * 0.1 + self.origin, 1)
        lines = shapely.linearrings(points, indices=np.repeat(np.arange(len(rings)), sizes))
        outer = ~self.hole[rings]
        polygons = shapely.polygons(lines, indices=np.cumsum(outer) - 1)
        return gathered(polygons, np.repeat(np.arange(len(buildings)), per_building)[outer])

    def _vertices(self, rings: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
        """(v, 2) decimetres: the running sum of the steps within each ring, from its anchor."""
        starts = np.cumsum(sizes) - sizes
        inner = np.ones(sizes.sum(), bool)
        inner[starts] = False
        total = np.zeros((len(inner), 2), np.int64)
        total[inner] = self.delta[stretches(self.ring_start[rings] - rings, sizes - 1)]
        np.cumsum(total, axis=0, out=total)
        return total + np.repeat(self.anchor[rings] - total[starts], sizes, axis=0)


def open_archive(path: Path) -> Archive:
    """The arrays of a .npz."""
    with np.load(path) as packed:
        return Archive(
            first_ring=np.concatenate([[0], np.cumsum(packed["building_rings"], dtype=np.int64)]),
            ring_start=np.concatenate([[0], np.cumsum(packed["ring_size"], dtype=np.int64)]),
            hole=packed["ring_is_hole"].astype(bool),
            anchor=np.stack([packed["anchor_x"], packed["anchor_y"]], -1).astype(np.int64),
            delta=np.stack([packed["delta_x"], packed["delta_y"]], -1),
            height=np.round(packed["height_dm"].astype(np.float64) * 0.1, 1),
            origin=packed["origin_m"].astype(np.float64),
        )


def read_archive(path: Path, box: Box | None = None) -> tuple[NDArray[np.object_], NDArray[np.float64]]:
    """Polygons in EPSG:6677 and their heights in metres; those whose first vertex lies in `box`.

    box: (x0, y0, x1, y1) in metres from the archive's own origin.
    """
    archive = open_archive(path)
    buildings = archive.inside(box)
    return archive.shapes(buildings), archive.height[buildings]


def stretches(first: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.int64]:
    """The numbers first[0] .. first[0] + size[0] - 1, then those from first[1], ..."""
    return np.arange(size.sum()) + np.repeat(first - np.cumsum(size) + size, size)


def gathered(polygons: NDArray[np.object_], owner: NDArray[np.int64]) -> NDArray[np.object_]:
    """(k,): the polygon of each owner, or a multipolygon of all it has. owner: (p,) 0 .. k - 1, ascending."""
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    shapes = polygons[first]
    several = np.bincount(owner) > 1
    of_several = several[owner]
    if several.any():
        number = np.cumsum(several) - 1
        shapes[several] = shapely.multipolygons(polygons[of_several], indices=number[owner[of_several]])
    return shapes


def encoded(shapes: NDArray[np.object_], kind: Kind) -> NDArray[np.object_]:
    """(k,) WKB, all of one kind."""
    if kind == "MultiPolygon":
        parts, owner = shapely.get_parts(shapes, return_index=True)
        shapes = shapely.multipolygons(parts, indices=owner)
    wkb: NDArray[np.object_] = shapely.to_wkb(shapes)
    return wkb


def write_flatgeobuf(path: Path, shapes: NDArray[np.object_], heights: NDArray[np.float64]) -> None:
    """Polygons and heights."""
    kind: Kind = "Polygon" if (shapely.get_type_id(shapes) == 3).all() else "MultiPolygon"
    write_encoded(path, encoded(shapes, kind), heights, kind)


def write_encoded(path: Path, wkb: NDArray[np.object_], heights: NDArray[np.float64], kind: Kind) -> None:
    """Shapes of one kind and their heights; with a spatial index only where it is worth a third more bytes."""
    index = "YES" if len(wkb) > INDEXED else "NO"
    pyogrio.raw.write(
        path, wkb, [heights.astype(np.float32)], ["height"], driver="FlatGeobuf",
        geometry_type=kind, crs=CRS, SPATIAL_INDEX=index,
    )  # fmt: skip


def convert(source: Path, target: Path, box: Box | None) -> int:
    """Number of buildings written. They are encoded a batch at a time: WKB takes a third of shapely's memory."""
    archive = open_archive(source)
    buildings = archive.inside(box)
    kind = archive.kind(buildings)
    batches = [buildings[first : first + BATCH] for first in range(0, len(buildings), BATCH)]
    wkb = [encoded(archive.shapes(batch), kind) for batch in batches]
    write_encoded(target, np.concatenate(wkb), archive.height[buildings], kind)
    return len(buildings)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("archive", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--bbox", help="x0,y0,x1,y1 in metres from the archive's origin")
    given = parser.parse_args()
    box = tuple(float(value) for value in given.bbox.split(",")) if given.bbox else None
    count = convert(given.archive, given.output, box)
    print(f"{count:,} buildings, {given.output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
