"""The coordinate reference system of a CityJSON file: its horizontal part, in metres."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError, MissingExtraError
from farfield.scene.footprints.reproject import in_degrees, points_projection, utm_zone
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
"""(n, 3) points to the same in another coordinate reference system, their heights in metres."""
METRES = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Frame:
    """What the points of a file are read in."""

    crs: str | None = None
    project: Projection | None = None
    """None: they are there."""
    unit: tuple[float, float] = METRES
    """Metres of the file's own unit along the ground (1 for degrees) and upwards; templates have it as well."""


@dataclass(frozen=True, slots=True)
class _System:
    """A coordinate reference system as a file has it."""

    code: str
    """Of its horizontal part."""
    geographic: bool = False
    swapped: bool = False
    """Whether latitude comes first."""
    unit: tuple[float, float] = METRES

    @property
    def in_metres(self) -> bool:
        """Along the ground."""
        return self.unit[0] == 1 and not self.geographic


def codes_of(reference: object) -> list[str]:
    """Authority codes such as EPSG:7415 of a URL, a URN or a code; none when it is none of these.

    Of a URN or URL of several parts the first is the horizontal one, the second the vertical one.
    """
    if type(reference) is int:
        return [f"EPSG:{reference}"]
    if not isinstance(reference, str):
        return []
    found = re.findall(r"(?:^\s*|crs[:/])(EPSG|OGC|IGNF|ESRI)(?:[:/][\d.]*)?[:/](\w+)", reference, re.IGNORECASE)
    if found:
        return [f"{authority.upper()}:{number}" for authority, number in found]
    return [f"EPSG:{reference.strip()}"] if re.fullmatch(r"\s*\d{4,6}\s*", reference) else []


def in_metres(reference: object, sample: Points, wanted: str | None, where: str, warnings: list[str]) -> Frame:
    """The frame to read in.

    Its CRS is `wanted`, or else the horizontal part of the file's own, or the local UTM zone when that is in degrees or
    feet. sample: (n, 3) some points of the file. pyproj is only needed for these and for a change; without it, what is
    not in degrees is taken as metres. Raises InputError and MissingExtraError.
    """
    codes = codes_of(reference)
    if not codes:
        if reference is not None:
            warnings.append(f"{where}: its referenceSystem {str(reference)[:60]!r} is no authority code; left out")
        return Frame(wanted)
    system = _system(codes, sample, where, warnings)
    if system is None:
        return Frame(wanted)
    target = wanted or _target(system, codes[0], sample, where, warnings)
    rise = system.unit[1]
    if rise != 1:
        warnings.append(f"{where}: its heights are brought to metres from units of {rise:.7g} m")
    if target == system.code and system.in_metres and rise == 1:
        return Frame(target)
    return Frame(target, _projection(system, target, where), system.unit)


def _target(system: _System, code: str, sample: Points, where: str, warnings: list[str]) -> str:
    """The system itself when it is in metres, else the local UTM zone."""
    if system.in_metres:
        return system.code
    middle = np.median(sample[:, [1, 0] if system.swapped else [0, 1]], axis=0)
    unit = "degrees" if system.geographic else f"units of {system.unit[0]:.7g} m"
    longitude, latitude = middle if system.geographic else in_degrees(middle[None], system.code, where)[0]
    if not np.isfinite([longitude, latitude]).all():
        raise InputError(f"lies nowhere in {code}", where, "check its referenceSystem and transform")
    zone = utm_zone(float(longitude), float(latitude))
    warnings.append(f"{where}: reprojected from {unit} ({code}) to the local UTM zone, {zone}")
    return zone


def _system(codes: list[str], sample: Points, where: str, warnings: list[str]) -> _System | None:
    """The system that codes name; None: it is not known."""
    code = codes[0]
    if code in _HORIZONTAL:
        return _System(_HORIZONTAL[code])
    degrees = len(sample) > 0 and bool((np.abs(sample[:, :2]) <= 360).all())
    try:
        pyproj = load_pyproj(where)
    except MissingExtraError:
        if degrees:
            raise
        return _System(code)
    crs, vertical = _named(code, pyproj), _named(codes[1], pyproj) if codes[1:] else None
    if crs is None:
        warnings.append(f"{where}: its referenceSystem {code} is not known; left out")
        return None
    flat = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d() if len(crs.axis_info) == 3 else crs
    if crs.is_geocentric:
        warnings.append(f"{where}: its referenceSystem {code} is geocentric, which is not read; left out")
        return None
    authority = flat.to_authority(min_confidence=100)
    own = ":".join(authority) if authority else flat.to_wkt()
    if flat.is_geographic and not degrees:
        warnings.append(f"{where}: says it is in degrees, but is not; its coordinates are taken as metres")
        return None
    ground = 1.0 if flat.is_geographic else _metres(flat.axis_info[:1])
    upwards = crs.axis_info[2:] or (vertical.axis_info[-1:] if vertical else [])
    # Without a vertical part heights are in the unit of the horizontal one.
    unit = ground, _metres(upwards) if upwards else ground
    return _System(own, flat.is_geographic, flat.is_geographic and _latitude_first(flat, sample), unit)


def _named(code: str, pyproj: Any) -> Any:
    """The CRS of a code; None when there is none."""
    try:
        return pyproj.CRS.from_user_input(code)
    except pyproj.exceptions.CRSError:
        return None


def _metres(axes: list[Any]) -> float:
    """What a unit of the first of some axes is; 1 where none is told."""
    return float(axes[0].unit_conversion_factor) or 1.0 if axes else 1.0


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


def _projection(system: _System, target: str, where: str) -> Projection:
    """Raises InputError for a target that is not in metres."""
    order = [1, 0] if system.swapped else [0, 1]
    project = None if target == system.code and system.in_metres else points_projection(system.code, target, where)

    def moved(points: Points) -> Points:
        out = np.array(points)
        if project is not None:
            out[:, :2] = project(points[:, order])
        out[:, 2] *= system.unit[1]
        out[~np.isfinite(out).all(1)] = np.nan
        return out

    return moved
