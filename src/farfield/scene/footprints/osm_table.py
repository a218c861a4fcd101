"""Buildings of OpenStreetMap as a table: their parts in place of outlines, heights, colours and tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.faults import counted
from farfield.scene.footprints.colours import colours_of, materials_of
from farfield.scene.footprints.details import Details, Form
from farfield.scene.footprints.heights import numbers
from farfield.scene.footprints.osm_heights import HEIGHT_KEYS, known_heights, lifts, underground, usual_heights
from farfield.scene.footprints.osm_parts import Parts, remainders
from farfield.scene.footprints.seeds import content_seeds
from farfield.scene.footprints.table import FeatureTable

CREDIT = "© OpenStreetMap contributors, ODbL 1.0"

_OWN_TAGS = (*HEIGHT_KEYS, "building:part", "roof:shape", "roof:orientation", "roof:direction")
"""Tags of a part that are not those of its building where it has none."""
_SHARED_TAGS = (
    "building", "name", "name:en", "alt_name", "addr:housenumber", "addr:housename", "addr:street", "addr:place",
    "addr:postcode", "addr:city", "addr:country", "start_date", "architect", "operator", "amenity", "shop", "office",
    "tourism", "leisure", "historic", "man_made", "religion", "denomination", "building:use", "ele",
    "building:colour", "building:material", "roof:colour", "roof:material", "wikidata", "wikipedia", "website",
)  # fmt: skip
TAGS = (*_SHARED_TAGS, *_OWN_TAGS)
"""Columns of the table, beside `id` and `outline`: the same whatever the file, so that parts of it fit together."""
KEPT = frozenset(TAGS)
_NUMBERS = frozenset(HEIGHT_KEYS) - {"location"} | {"ele"}
_ON_EQUATOR = 111_320.0
"""Metres of a degree."""


@dataclass(frozen=True, slots=True)
class Building:
    """A way or a multipolygon that is a building or a part of one."""

    kind: str
    """way or relation."""
    id: int
    tags: dict[str, str]
    """Those of KEPT."""
    wkb: str
    """Hexadecimal, degrees: of a way the closed line, of a relation the multipolygon."""


def is_building(tags: Mapping[str, str]) -> bool:
    """Whether it is the outline of one."""
    return tags.get("building", "no") != "no"


def is_part(tags: Mapping[str, str]) -> bool:
    """Whether it is a part of one."""
    return tags.get("building:part", "no") != "no"


def table_of(found: Sequence[Building], default_height: float | None, notes: Sequence[str]) -> FeatureTable:
    """The buildings above the ground, parts in place of their outlines. notes: of reading; more are added."""
    below = underground([own.tags for own in found])
    lines = [*notes] + ([f"left out {counted(int(below.sum()), 'building')} below the ground"] if below.any() else [])
    standing = [own for own, hidden in zip(found, below, strict=True) if not hidden]
    if not standing:
        return FeatureTable([], {}, "EPSG:4326", credits=(CREDIT,), notes=tuple(lines))
    tags = [own.tags for own in standing]
    shapes = _shapes(standing)
    valid = _valid(shapes)
    parts = Parts.of(valid, np.array([is_building(t) for t in tags]), np.array([is_part(t) for t in tags]))
    height, guessed = _heights(tags, valid, parts, default_height)
    lift = lifts(tags, height)
    left = remainders(valid, parts, height, lift)
    for row, shape in left.items():
        shapes[row] = shape
    rows = np.array([row for row in range(len(standing)) if left.get(row, shapes[row]) is not None], np.int64)
    if guessed[rows].any():
        lines.append(_guess(int(guessed[rows].sum()), default_height))
    details = Details(lift, *(_colors(tags, parts, side, rows, lines) for side in ("building", "roof")))
    form = Form(height[rows], details.of(rows), _seeds(standing, parts)[rows])
    columns = _columns(standing, parts, rows)
    return FeatureTable([_encoded(shapes[rows])], columns, "EPSG:4326", form, (CREDIT,), tuple(lines))


def _guess(count: int, default_height: float | None) -> str:
    usual = "what is usual for their kind" if default_height is None else f"the default of {default_height:g} m"
    return f"{counted(count, 'building')} without height stand at {usual}"


def _shapes(buildings: Sequence[Building]) -> NDArray[np.object_]:
    """(n,) polygons and multipolygons, as they are."""
    import shapely

    shapes: NDArray[np.object_] = shapely.from_wkb(np.array([own.wkb for own in buildings], object))
    for row in np.flatnonzero(shapely.get_type_id(shapes) == 1):
        points = shapely.get_coordinates(shapes[row])
        shapes[row] = shapely.Polygon(points) if len(points) > 3 else shapely.Polygon()
    return shapes


def _valid(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    """The same, what crosses itself repaired."""
    import shapely

    valid, crossing = shapes.copy(), ~shapely.is_valid(shapes)
    valid[crossing] = shapely.buffer(shapely.make_valid(shapes[crossing]), 0.0)
    return valid


def _heights(
    tags: list[dict[str, str]], shapes: NDArray[np.object_], parts: Parts, default: float | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(n,) metres, and which are not told by any tag. A part of unknown height is as high as its building."""
    import shapely

    told = known_heights(tags)
    bounds = shapely.bounds(shapes)
    square_metres = shapely.area(shapes) * _ON_EQUATOR**2 * np.cos(np.radians(np.nan_to_num(bounds[:, 1])))
    usual = usual_heights(tags, square_metres) if default is None else np.full(len(tags), default)
    height, guessed = np.where(np.isnan(told), usual, told), np.isnan(told)
    of_building = guessed & (parts.outline >= 0)
    height[of_building] = height[parts.outline[of_building]]
    guessed[of_building] = guessed[parts.outline[of_building]]
    return height, guessed


def _colors(
    tags: list[dict[str, str]], parts: Parts, side: str, rows: NDArray[np.int64], lines: list[str]
) -> NDArray[np.uint8]:
    """(n, 4) by the colour, else the material, else those of the building that it is a part of."""
    color = np.zeros((len(tags), 4), np.uint8)
    for key, meaning in ((f"{side}:colour", colours_of), (f"{side}:material", materials_of)):
        found, _ = meaning(words := np.array([own.get(key) for own in tags], object))
        color = np.where(color[:, 3:] > 0, color, found)
        if unknown := meaning(words[rows])[1]:
            lines.append(f"{counted(unknown, 'value')} of {key} that are not known")
    inherits = (color[:, 3] == 0) & (parts.outline >= 0)
    color[inherits] = color[parts.outline[inherits]]
    return color


def _seeds(buildings: Sequence[Building], parts: Parts) -> NDArray[np.uint32]:
    """(n,) by the id of a building, so that its parts look alike."""
    ids = np.array([(own.id, own.kind == "way") for own in buildings], np.float64)
    whole = np.where(parts.outline >= 0, parts.outline, np.arange(len(ids)))
    return content_seeds(ids, np.zeros(len(ids)))[whole]


def _columns(buildings: Sequence[Building], parts: Parts, rows: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """Tags of the rows; a part has those of its building where it has none of its own."""
    names = [f"{own.kind}/{own.id}" for own in buildings]
    outline = parts.outline[rows].tolist()
    columns: dict[str, list[Any]] = {"id": [names[row] for row in rows.tolist()]}
    columns["outline"] = [names[row] if row >= 0 else None for row in outline]
    shared = [{} if of < 0 else _shared(buildings[of].tags) for of in outline]
    tags = [of | buildings[row].tags for of, row in zip(shared, rows.tolist(), strict=True)]
    columns |= {key: [own.get(key) for own in tags] for key in TAGS}
    arrays = {name: np.array(values, object) for name, values in columns.items()}
    return {name: numbers(column) if name in _NUMBERS else column for name, column in arrays.items()}


def _shared(tags: dict[str, str]) -> dict[str, str]:
    return {key: value for key, value in tags.items() if key in _SHARED_TAGS}


def _encoded(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    import shapely

    return np.array(shapely.to_wkb(shapes), object)
