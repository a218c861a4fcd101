"""Footprints in degrees, or in another coordinate reference system than asked for, brought to metres."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.footprints.table import FeatureTable
from farfield.scene.georeference import load_pyproj


def in_metres(table: FeatureTable, wanted: str | None, where: str, warnings: list[str]) -> FeatureTable:
    """The table in `wanted`, or else in its own CRS, or in the local UTM zone when that is in degrees.

    pyproj is only needed for the last and for a change. Raises InputError and MissingExtraError.
    """
    if table.crs is None:
        return table if wanted is None else replace(table, crs=wanted)
    if wanted is not None and wanted != table.crs:
        return _projected(table, wanted, where)
    bounds = _bounds(table.shapes)
    if not np.isfinite(bounds).all() or not _like_degrees(bounds):
        if table.crs in ("EPSG:4326", "OGC:CRS84"):
            warnings.append(f"{where}: says it is in degrees, but is not; its coordinates are taken as metres")
            return replace(table, crs=None)
        return table
    if not load_pyproj(where).CRS.from_user_input(table.crs).is_geographic:
        return table
    zone = _utm_zone((bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2)
    warnings.append(f"{where}: reprojected from degrees ({table.crs[:30]}) to the local UTM zone, {zone}")
    return _projected(table, zone, where)


def _bounds(shapes: NDArray[np.object_]) -> NDArray[np.float64]:
    import shapely

    bounds: NDArray[np.float64] = shapely.total_bounds(shapes)
    return bounds


def _like_degrees(bounds: NDArray[np.float64]) -> bool:
    return bool((np.abs(bounds[[0, 2]]) <= 360).all() and (np.abs(bounds[[1, 3]]) <= 90).all())


def _utm_zone(longitude: float, latitude: float) -> str:
    zone = int(np.floor((longitude + 180) / 6)) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def _projected(table: FeatureTable, crs: str, where: str) -> FeatureTable:
    import shapely

    pyproj = load_pyproj(where)
    try:
        transformer = pyproj.Transformer.from_crs(table.crs, crs, always_xy=True)
    except pyproj.exceptions.CRSError as error:
        raise InputError(f"cannot be brought to {crs}", where, "give an authority code such as EPSG:6677") from error

    def project(points: NDArray[np.float64]) -> NDArray[Any]:
        return np.stack(transformer.transform(points[:, 0], points[:, 1]), -1)

    return replace(table, shapes=shapely.transform(table.shapes, project), crs=crs)
