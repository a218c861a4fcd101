"""A file of footprints as a Scene: features read once, then held as compact chunks that extrude when loaded."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.assembly import scene_of
from farfield.scene.faults import EXPORT_AGAIN, counted
from farfield.scene.footprints.heights import heights_of, named_column, numbers
from farfield.scene.footprints.ogr import read_ogr
from farfield.scene.footprints.order import morton_codes, split
from farfield.scene.footprints.outlines import BATCH, Outlines, outlines_of
from farfield.scene.footprints.parquet import read_parquet
from farfield.scene.footprints.prisms import Buildings, prism_mesh
from farfield.scene.footprints.repair import reports
from farfield.scene.footprints.reproject import in_metres
from farfield.scene.footprints.rings import Rings
from farfield.scene.footprints.table import FeatureTable
from farfield.scene.georeference import local_origin
from farfield.scene.model import Mesh, Scene
from farfield.scene.options import ReadOptions


@dataclass(frozen=True, slots=True, eq=False)
class FootprintChunk:
    """Nearby buildings of one file, about 400 kB for 4,096. It carries its rings, so workers never read the file."""

    name: str
    buildings: Buildings
    facades: bool

    def load(self) -> Mesh:
        """Extrudes the buildings: 4,096 take about 0.1 s."""
        return prism_mesh(self.buildings, self.facades)


def read_footprints(path: Path, options: ReadOptions, batch: int = BATCH) -> Scene:
    """The buildings of a file, one object each, ordered by place. Raises InputError when it holds none.

    batch: features drawn together; it changes the memory that is needed, never the scene. Tokyo's 1.8 million buildings
    take 0.7 GB at most.
    """
    where = str(path)
    warnings: list[str] = []
    table = read_parquet(path) if path.suffix.lower() in (".parquet", ".geoparquet") else read_ogr(path, options.layer)
    if not len(table):
        raise InputError("holds no features", where, EXPORT_AGAIN)
    crs, project = in_metres(table, options.crs, where, warnings)
    height = heights_of(table.columns, len(table), options.height_attribute, options.default_height, where)
    base = _base(table, options.base_attribute, where, warnings)
    faults: Counter[str] = Counter()
    outlines = outlines_of(table, project, batch, faults)
    warnings += reports(faults, where)
    known = ~np.isnan(height[outlines.row])
    if lost := int((~known).sum()):
        warnings.append(f"{where}: left out {counted(lost, 'footprint')} without height; a default_height keeps them")
    if not known.any():
        why = f"; {warnings[0].removeprefix(where + ': ')}" if warnings else ""
        raise InputError(f"holds no footprint that can be extruded{why}", where, "check its shapes and heights")
    codes, features = _by_place(outlines, np.flatnonzero(known))
    ranges = split(codes, options.buildings_per_mesh)
    corners, chunks = _chunks(path, outlines, [features[a:b] for a, b in ranges], base, height, options.facades)
    origin = (0.0, 0.0, 0.0) if crs is None else local_origin(tuple(corners.min(axis=0)))
    transforms = np.tile(np.eye(4)[:3], (len(chunks), 1, 1))
    transforms[:, :, 3] = corners - origin
    counts = np.diff(ranges, axis=1)[:, 0]
    rows = outlines.row[features]
    return scene_of(
        chunks, np.arange(len(chunks), dtype=np.int32), transforms, counts,
        crs=crs, origin=origin, source_bytes=path.stat().st_size, warnings=tuple(warnings),
        attributes={name: table.columns.pop(name)[rows] for name in list(table.columns)},
    )  # fmt: skip


def _base(table: FeatureTable, named: str | None, where: str, warnings: list[str]) -> NDArray[np.float64]:
    """(n,) altitude of the ground; 0 where it is unknown."""
    if named is None:
        return np.zeros(len(table))
    base = numbers(table.columns[named_column(table.columns, named, where)])
    if unknown := int(np.isnan(base).sum()):
        warnings.append(f"{where}: {counted(unknown, 'footprint')} without {named} stand on the median of the others")
    return np.where(np.isnan(base), np.nanmedian(base) if unknown < len(base) else 0.0, base)


def _by_place(outlines: Outlines, features: NDArray[np.int64]) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    """The features' places as sorted Morton codes, and the features in that order; those in one square by centre."""
    centres = _centres(outlines.box[features])
    codes = morton_codes(centres)
    order = np.lexsort((centres[:, 1], centres[:, 0], codes))
    return codes[order], features[order]


def _centres(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) of (n, 4) x0, y0, x1, y1."""
    return (boxes[:, :2] + boxes[:, 2:]) / 2


def _chunks(
    path: Path,
    outlines: Outlines,
    groups: list[NDArray[np.int64]],
    base: NDArray[np.float64],
    height: NDArray[np.float64],
    facades: bool,
) -> tuple[NDArray[np.float64], list[FootprintChunk]]:
    """A chunk for each group of features, and (groups, 3) where its zero lies: its lowest corner, whole metres."""
    corners = np.empty((len(groups), 3))
    chunks: list[FootprintChunk] = []
    for k, features in enumerate(groups):
        rows, boxes = outlines.row[features], outlines.box[features]
        bottom, top = base[rows], base[rows] + height[rows]
        corners[k] = np.floor([*boxes[:, :2].min(axis=0), bottom.min()])
        seeds = content_seeds(_centres(boxes), height[rows])
        buildings = _buildings(outlines.rings.of_features(features), corners[k], bottom, top, seeds)
        chunks.append(FootprintChunk(f"{path}, part {k + 1}", buildings, facades))
    return corners, chunks


def _buildings(
    rings: Rings,
    corner: NDArray[np.float64],
    bottom: NDArray[np.float64],
    top: NDArray[np.float64],
    seeds: NDArray[np.uint32],
) -> Buildings:
    """Coordinates become float32 from the chunk's corner: 0.1 mm at 1 km, half the memory."""
    local = replace(rings, xy=(rings.xy - corner[:2]).astype(np.float32))
    return Buildings(local, (bottom - corner[2]).astype(np.float32), (top - corner[2]).astype(np.float32), seeds)


def content_seeds(centres: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.uint32]:
    """(n,) uint32 from a building's place and height to 0.1 m: its looks do not depend on its neighbours or order."""
    with np.errstate(over="ignore"):
        mixed = _decimetres(centres[:, 0])
        for part in (_decimetres(centres[:, 1]), _decimetres(height)):
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9) + part
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (mixed >> np.uint64(32)).astype(np.uint32)


def _decimetres(metres: NDArray[Any]) -> NDArray[np.uint64]:
    return np.round(metres * 10).astype(np.int64).astype(np.uint64)
