"""Footprints in degrees, or in another coordinate reference system than asked for, brought to metres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.footprints.table import FeatureTable
from farfield.scene.georeference import load_pyproj

Projection = Callable[[NDArray[np.object_]], NDArray[np.object_]]
"""(n,) geometries to the same in another coordinate reference system."""

_BATCH = 16_384
"""Features looked at together for their bounds; those of a file in metres are known after the first."""
_TRY = "give an authority code such as EPSG:6677"


def in_metres(
    table: FeatureTable, wanted: str | None, where: str, warnings: list[str]
) -> tuple[str | None, Projection | None]:
    """The CRS to read the table in, and how its shapes get there (None: they are there).

    It is `wanted`, or else the table's own, or the local UTM zone when that is in degrees. pyproj is only needed for
    the last and for a change. Raises InputError and MissingExtraError.
    """
    if table.crs is None:
        return wanted, None
    if wanted is not None and wanted != table.crs:
        return wanted, _projection(table.crs, wanted, where)
    bounds = _bounds_in_degrees(table)
    if bounds is None:
        if table.crs in ("EPSG:4326", "OGC:CRS84"):
            warnings.append(f"{where}: says it is in degrees, but is not; its coordinates are taken as metres")
            return None, None
        return table.crs, None
    if not load_pyproj(where).CRS.from_user_input(table.crs).is_geographic:
        return table.crs, None
    zone = utm_zone((bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2)
    warnings.append(f"{where}: reprojected from degrees ({table.crs[:30]}) to the local UTM zone, {zone}")
    return zone, _projection(table.crs, zone, where)


def _bounds_in_degrees(table: FeatureTable) -> NDArray[np.float64] | None:
    """(4,) west, south, east, north of all shapes; None when these cannot be degrees, or nothing has a place."""
    import shapely

    bounds = np.full(4, np.nan)
    for shapes in table.batches(_BATCH):
        west, south, east, north = shapely.total_bounds(shapes)
        bounds = np.array([*np.fmin(bounds[:2], [west, south]), *np.fmax(bounds[2:], [east, north])])
        if (np.abs(bounds) > (360, 90, 360, 90)).any():
            return None
    return bounds if np.isfinite(bounds).all() else None


def utm_zone(longitude: float, latitude: float) -> str:
    """Authority code of the zone of WGS 84 that a place is in."""
    zone = int(np.floor((longitude + 180) / 6)) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def _projection(source: str, target: str, where: str) -> Projection:
    import shapely

    project = points_projection(source, target, where)
    return lambda shapes: shapely.transform(shapes, project)


def points_projection(source: str, target: str, where: str) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """(n, 2) points x, y (or longitude, latitude) of one coordinate reference system to the same in another.

    Raises InputError, for a target that is not in metres as well, and MissingExtraError.
    """
    project = _projected(source, target, where)
    axes = load_pyproj(where).CRS.from_user_input(target).axis_info
    if any(axis.unit_conversion_factor != 1 for axis in axes):
        raise InputError(f"cannot be brought to {target}, which is not in metres", where, _TRY)
    return project


def in_degrees(points: NDArray[np.float64], crs: str, where: str) -> NDArray[np.float64]:
    """(n, 2) longitude and latitude of points x, y. Raises InputError and MissingExtraError."""
    return _projected(crs, "OGC:CRS84", where)(points)


def _projected(source: str, target: str, where: str) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    pyproj = load_pyproj(where)
    try:
        transformer = pyproj.Transformer.from_crs(source, target, always_xy=True)
    except pyproj.exceptions.CRSError as error:
        raise InputError(f"cannot be brought to {target}", where, _TRY) from error

    def project(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack(transformer.transform(points[:, 0], points[:, 1]), -1)

    return project
