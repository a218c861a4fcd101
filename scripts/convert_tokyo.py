"""Converts a packed archive of Tokyo's buildings (buildings.npz, roofs.npz) to FlatGeobuf.

    python scripts/convert_tokyo.py roofs.npz tokyo.fgb --bbox -500,-500,500,500

Each feature is a footprint with its `height` in metres, in JGD2011 plane IX (EPSG:6677). The archives hold rings as
differences of decimetres; `building_rings`, `ring_size`, `ring_is_hole`, `anchor_*` and `delta_*` are their columns.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

CRS = "EPSG:6677"
Box = tuple[float, float, float, float]


def read_archive(path: Path, box: Box | None = None) -> tuple[NDArray[np.object_], NDArray[np.float64]]:
    """Polygons in EPSG:6677 and their heights in metres; those whose first vertex lies in `box`.

    box: (x0, y0, x1, y1) in metres from the archive's own origin.
    """
    with np.load(path) as archive:
        sizes = archive["ring_size"].astype(np.int64)
        starts = np.concatenate([[0], np.cumsum(sizes)])
        xy = np.stack([_undo_differences(archive, axis, sizes, starts) for axis in "xy"], -1) * 0.1
        holes = archive["ring_is_hole"].astype(bool)
        first_ring = np.concatenate([[0], np.cumsum(archive["building_rings"].astype(np.int64))])
        heights = archive["height_dm"].astype(np.float64) * 0.1
        origin = archive["origin_m"].astype(np.float64)
    anchors = xy[starts[first_ring[:-1]]]
    inside = np.ones(len(anchors), bool)
    if box is not None:
        inside = ((anchors >= box[:2]) & (anchors < box[2:])).all(axis=1)
    rows = np.flatnonzero(inside)
    shapes = [_shape(xy, starts, holes, int(first_ring[row]), int(first_ring[row + 1])) for row in rows]
    moved = shapely.transform(np.array(shapes, object), lambda points: np.round(points + origin, 1))
    return moved, np.round(heights[rows], 1)


def _undo_differences(
    archive: dict[str, NDArray[np.int64]], axis: str, sizes: NDArray[np.int64], starts: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(v,) decimetres: the running sum of the differences within each ring, from its anchor."""
    steps = np.zeros(starts[-1], np.int64)
    inner = np.ones(starts[-1], bool)
    inner[starts[:-1]] = False
    steps[inner] = archive[f"delta_{axis}"]
    total = np.cumsum(steps)
    return total - np.repeat(total[starts[:-1]] - archive[f"anchor_{axis}"].astype(np.int64), sizes)


def _shape(
    xy: NDArray[np.float64], starts: NDArray[np.int64], holes: NDArray[np.bool_], first: int, last: int
) -> shapely.Geometry:
    """Rings first .. last - 1; a hole belongs to the last outer ring before it."""
    polygons: list[tuple[NDArray[np.float64], list[NDArray[np.float64]]]] = []
    for ring in range(first, last):
        points = xy[starts[ring] : starts[ring + 1]]
        if holes[ring]:
            polygons[-1][1].append(points)
        else:
            polygons.append((points, []))
    parts = [shapely.Polygon(outer, inner) for outer, inner in polygons]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def write_flatgeobuf(path: Path, shapes: NDArray[np.object_], heights: NDArray[np.float64]) -> None:
    """Polygons and heights, without a spatial index (it would add a third to a small file)."""
    multi = np.array(
        [shape if shape.geom_type == "MultiPolygon" else shapely.MultiPolygon([shape]) for shape in shapes]
    )
    kind = "Polygon" if all(shape.geom_type == "Polygon" for shape in shapes) else "MultiPolygon"
    chosen = shapes if kind == "Polygon" else multi
    pyogrio.raw.write(
        path, shapely.to_wkb(chosen), [heights.astype(np.float32)], ["height"], driver="FlatGeobuf",
        geometry_type=kind, crs=CRS, SPATIAL_INDEX="NO",
    )  # fmt: skip


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("archive", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--bbox", help="x0,y0,x1,y1 in metres from the archive's origin")
    given = parser.parse_args()
    box = tuple(float(value) for value in given.bbox.split(",")) if given.bbox else None
    shapes, heights = read_archive(given.archive, box)
    write_flatgeobuf(given.output, shapes, heights)
    print(f"{len(shapes):,} buildings, {given.output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
