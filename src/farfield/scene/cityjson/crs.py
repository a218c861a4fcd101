"""The coordinate reference system of a CityJSON file: its horizontal part, in metres."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import MissingExtraError
from farfield.scene.footprints.reproject import points_projection, utm_zone
from farfield.scene.georeference import load_pyproj

_HORIZONTAL = {
    "EPSG:7415": "EPSG:28992",
    "EPSG:7405": "EPSG:27700",
    "EPSG:5554": "EPSG:25831",
    "EPSG:5555": "EPSG:25832",
    "EPSG:5556": "EPSG:25833",
    "EPSG:5698": "EPSG:2154",
    "EPSG:5972": "EPSG:25832",
    "EPSG:5973": "EPSG:25833",
    "EPSG:6190": "EPSG:31370",
}
"""Compound systems that are met often → their horizontal part, so that these need no pyproj."""

Points = NDArray[np.float64]
Projection = Callable[[Points], Points]
"""(n, 3) points, heights kept, to the same in another coordinate reference system."""


def code_of(reference: object) -> str | None:
    """Authority code such as EPSG:7415 of a URL, a URN or a code; None when it is none of these.

    Of a URN or URL of several parts it is the first, which is the horizontal one.
    """
    if type(reference) is int:
        return f"EPSG:{reference}"
    if not isinstance(reference, str):
        return None
    found = re.search(r"(?:^\s*|crs[:/])(EPSG|OGC|IGNF|ESRI)(?:[:/][\d.]*)?[:/](\w+)", reference, re.IGNORECASE)
    if found:
        return f"{found[1].upper()}:{found[2]}"
    return f"EPSG:{reference.strip()}" if re.fullmatch(r"\s*\d{4,6}\s*", reference) else None


def in_metres(
    reference: object, sample: Points, wanted: str | None, where: str, warnings: list[str]
) -> tuple[str | None, Projection | None]:
    """The CRS to read in, and how points get there (None: they are there).

    It is `wanted`, or else the horizontal part of the file's own, or the local UTM zone when that is in degrees.
    sample: (n, 3) some points of the file. pyproj is only needed for degrees and for a change.
    Raises InputError and MissingExtraError.
    """
    code = code_of(reference)
    if code is None:
        if reference is not None:
            warnings.append(f"{where}: its referenceSystem {str(reference)[:60]!r} is no authority code; left out")
        return wanted, None
    own, geographic, swapped = _horizontal(code, sample, where, warnings)
    if own is None:
        return wanted, None
    target = wanted
    if target is None and geographic:
        middle = np.median(sample[:, [1, 0] if swapped else [0, 1]], axis=0)
        target = utm_zone(*middle.tolist())
        warnings.append(f"{where}: reprojected from degrees ({code}) to the local UTM zone, {target}")
    if target is None or target == own:
        return own, None
    return target, _projection(own, target, swapped, where)


def _horizontal(code: str, sample: Points, where: str, warnings: list[str]) -> tuple[str | None, bool, bool]:
    """The horizontal part, whether it is in degrees, and whether latitude comes first; None: it is not known."""
    if code in _HORIZONTAL:
        return _HORIZONTAL[code], False, False
    degrees = len(sample) > 0 and bool((np.abs(sample[:, :2]) <= 360).all())
    try:
        pyproj = load_pyproj(where)
    except MissingExtraError:
        if degrees:
            raise
        return code, False, False
    try:
        crs = pyproj.CRS.from_user_input(code)
    except pyproj.exceptions.CRSError:
        warnings.append(f"{where}: its referenceSystem {code} is not known; left out")
        return None, False, False
    flat = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d() if len(crs.axis_info) == 3 else crs
    if crs.is_geocentric:
        warnings.append(f"{where}: its referenceSystem {code} is geocentric, which is not read; left out")
        return None, False, False
    authority = flat.to_authority(min_confidence=100)
    own = ":".join(authority) if authority else flat.to_wkt()
    if flat.is_geographic and degrees:
        return own, True, _latitude_first(flat, sample)
    if flat.is_geographic:
        warnings.append(f"{where}: says it is in degrees, but is not; its coordinates are taken as metres")
        return None, False, False
    return own, False, False


def _latitude_first(crs: Any, sample: Points) -> bool:
    """Whether points are latitude, longitude: where they lie in the area of the CRS tells, else its own order."""
    by_crs = bool(crs.axis_info) and crs.axis_info[0].direction == "north"
    a, b = np.median(sample[:, :2], axis=0)
    area = crs.area_of_use
    if area is None:
        return by_crs
    as_is, turned = (_within(area.bounds, x, y) for x, y in ((a, b), (b, a)))
    return by_crs if as_is == turned else turned


def _within(bounds: tuple[float, ...], longitude: float, latitude: float) -> bool:
    west, south, east, north = bounds
    inside = west <= longitude <= east if west <= east else longitude >= west or longitude <= east
    return inside and south <= latitude <= north


def _projection(own: str, target: str, swapped: bool, where: str) -> Projection:
    project = points_projection(own, target, where)
    order = [1, 0] if swapped else [0, 1]

    def moved(points: Points) -> Points:
        out = np.array(points)
        out[:, :2] = project(points[:, order])
        out[~np.isfinite(out).all(1)] = np.nan
        return out

    return moved
