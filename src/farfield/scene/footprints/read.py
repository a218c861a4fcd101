"""A file of footprints as a Scene: features read once, then held as compact chunks that extrude when loaded."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.assembly import scene_of
from farfield.scene.faults import EXPORT_AGAIN, counted
from farfield.scene.footprints import order
from farfield.scene.footprints.details import Form
from farfield.scene.footprints.features import Features, by_place, centres_of, chunk_at
from farfield.scene.footprints.form import form_of
from farfield.scene.footprints.heights import TALLEST, named_column, numbers
from farfield.scene.footprints.ogr import read_ogr, read_ogr_column
from farfield.scene.footprints.order import split
from farfield.scene.footprints.osm import read_osm
from farfield.scene.footprints.outlines import BATCH, Outlines, outlines_of
from farfield.scene.footprints.parquet import read_parquet
from farfield.scene.footprints.repair import reports
from farfield.scene.footprints.reproject import in_metres
from farfield.scene.footprints.seeds import content_seeds
from farfield.scene.footprints.table import FeatureTable
from farfield.scene.footprints.use import uses_of, with_use
from farfield.scene.georeference import local_origin
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions, inside


def read_footprints(path: Path, options: ReadOptions, batch: int = BATCH) -> Scene:
    """The buildings of a file, one object each, ordered by place. Raises InputError when it holds none.

    batch: features drawn together; it changes the memory that is needed, never the scene. Tokyo's 1.8 million buildings
    take 0.7 GB at most. With a region the scene has those whose middle lies in it, and may be empty.
    """
    where = str(path)
    warnings: list[str] = []
    table = _table(path, options)
    if not len(table) and options.region is None:
        why = f"; {table.notes[0]}" if table.notes else ""
        raise InputError(f"holds no features{why}", where, EXPORT_AGAIN)
    if not len(table):
        return scene_of([], np.empty(0, np.int32), np.empty((0, 3, 4)), crs=options.crs, families=(where,),
                        source_bytes=path.stat().st_size, credits=table.credits)  # fmt: skip
    warnings += [f"{where}: {line}" for line in table.notes]
    crs, project = in_metres(table, options.crs, where, warnings)
    base = _base(table, path, options, warnings)
    form = form_of(table, base, options, where, warnings)
    use = _use(table, options, where)
    faults: Counter[str] = Counter()
    outlines = outlines_of(table, project, batch, faults)
    warnings += reports(faults, where)
    chosen = ~np.isnan(form.height[outlines.row])
    if lost := int((~chosen).sum()):
        what = f"{counted(lost, 'footprint')} without height (above 0 and below {TALLEST:,.0f} m)"
        warnings.append(f"{where}: left out {what}; a default_height keeps them")
    if options.region is not None:
        chosen &= inside(centres_of(outlines.box), options.region)
    elif not chosen.any():
        why = f"; {warnings[0].removeprefix(where + ': ')}" if warnings else ""
        raise InputError(f"holds no footprint that can be extruded{why}", where, "check its shapes and heights")
    lift = None if form.details.lift is None else form.details.lift[outlines.row]
    codes, features = by_place(outlines.box, np.flatnonzero(chosen), lift)
    ranges = split(codes, options.buildings_per_mesh or order.most_in_mesh(options.facades))
    chunks = [
        chunk_at(square, _features(outlines, features[a:b], base, form, use), where, options.facades)
        for square, a, b in ranges
    ]
    corners = np.array([chunk.corner for chunk in chunks]).reshape(-1, 3)
    origin = (0.0, 0.0, 0.0) if crs is None or not chunks else local_origin(tuple(corners.min(axis=0)))
    transforms = np.tile(np.eye(4)[:3], (len(chunks), 1, 1))
    transforms[:, :, 3] = corners - origin
    counts = np.array([len(chunk.features) for chunk in chunks], np.int64)
    rows = outlines.row[features]
    return scene_of(
        chunks, np.arange(len(chunks), dtype=np.int32), transforms, counts,
        crs=crs, origin=origin, source_bytes=path.stat().st_size, warnings=tuple(warnings), families=(where,),
        credits=table.credits,
        attributes={name: table.columns.pop(name)[rows] for name in list(table.columns)},
    )  # fmt: skip


def _table(path: Path, options: ReadOptions) -> FeatureTable:
    if _is_parquet(path):
        return read_parquet(path)
    if _is_osm(path):
        return read_osm(path, options.default_height)
    return read_ogr(path, options.layer, options.region, options.crs)


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() in (".parquet", ".geoparquet")


def _is_osm(path: Path) -> bool:
    return path.suffix.lower() in (".pbf", ".osm")


def _is_whole(path: Path) -> bool:
    """Whether all of it is read, whatever the region."""
    return _is_parquet(path) or _is_osm(path)


def _base(table: FeatureTable, path: Path, options: ReadOptions, warnings: list[str]) -> NDArray[np.float64]:
    """(n,) altitude of the ground; where it is unknown the median of the whole file, 0 where that is."""
    named, where = options.base_attribute, str(path)
    if named is None:
        return np.zeros(len(table))
    base = numbers(table.columns[named_column(table.columns, named, where)])
    unknown = np.isnan(base)
    if not unknown.any():
        return base
    warnings.append(
        f"{where}: {counted(int(unknown.sum()), 'footprint')} without {named} stand on the median of the others"
    )
    part = options.region is not None and not _is_whole(path)
    every = numbers(read_ogr_column(path, options.layer, named)) if part else base
    return np.where(unknown, 0.0 if np.isnan(every).all() else np.nanmedian(every), base)


def _use(table: FeatureTable, options: ReadOptions, where: str) -> NDArray[np.uint32] | None:
    """(n,) what buildings are used for, where façades show it."""
    if options.facades != "unique":
        return None
    if options.use_attribute is None:
        return np.zeros(len(table), np.uint32)
    return uses_of(table.columns[named_column(table.columns, options.use_attribute, where)])


def _features(
    outlines: Outlines,
    features: NDArray[np.int64],
    base: NDArray[np.float64],
    form: Form,
    use: NDArray[np.uint32] | None,
) -> Features:
    rows = outlines.row[features]
    height, details = form.height[rows], form.details.of(rows)
    seeds = form.seed[rows] if form.seed is not None else content_seeds(centres_of(outlines.box[features]), height)
    if use is not None:
        seeds = with_use(seeds, use[rows])
    bottom = base[rows] if details.lift is None else base[rows] + details.lift
    return Features(outlines.rings.of_features(features), bottom, base[rows] + height, seeds, details)
