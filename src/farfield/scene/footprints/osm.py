"""Buildings of OpenStreetMap extracts (.osm.pbf, .osm), read by osmium."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from farfield.errors import InputError, MissingExtraError
from farfield.scene.faults import EXPORT_AGAIN, counted
from farfield.scene.footprints.osm_table import KEPT, Building, is_building, is_part, table_of
from farfield.scene.footprints.table import FeatureTable

_MULTIPOLYGONS = ("multipolygon", "boundary")
_REPORTS = {
    "open": ("way", "that do not close"),
    "cut": ("outline", "with points that the file lacks, as at the border of an extract"),
    "small": ("outline", "of less than three points"),
    "broken": ("multipolygon", "that are not whole or cross themselves"),
    "repeated": ("way", "that a multipolygon has as well"),
}
"""What is left out and counted, in the order of its lines."""


def read_osm(path: Path, default_height: float | None = None) -> FeatureTable:
    """The buildings of an extract and their parts, in degrees, each with its form.

    default_height: of those whose tags tell none; None: what is usual for their kind. The file is read twice, for
    multipolygons may come after their ways. Raises InputError, and MissingExtraError without osmium.
    """
    try:
        import osmium
    except ImportError as error:
        raise MissingExtraError("OpenStreetMap extracts need osmium", "geo", str(path)) from error
    found = _Found(osmium)
    try:
        for element in _elements(osmium, path):
            found.add(element)
    except (RuntimeError, ValueError, osmium.InvalidLocationError) as error:
        if "out of order" in str(error):
            raise InputError("is not sorted by id", str(path), "sort it with: osmium sort") from error
        raise InputError("is damaged: it cannot be read as OpenStreetMap data", str(path), EXPORT_AGAIN) from error
    return table_of(found.buildings(), default_height, found.notes())


def _elements(osmium: Any, path: Path) -> Iterator[Any]:
    """Ways and relations with a building's tags, and the areas of both. They are valid only until the next one."""
    file = osmium.io.File(str(path), "osm" if path.suffix.lower() == ".osm" else "pbf")
    keys = osmium.filter.KeyFilter("building", "building:part")
    kinds = osmium.osm.WAY | osmium.osm.RELATION | osmium.osm.AREA
    processor = osmium.FileProcessor(file).with_areas(keys)
    return iter(processor.with_filter(osmium.filter.EntityFilter(kinds)).with_filter(keys))


class _Found:
    """Buildings so far, and what of them cannot be used."""

    def __init__(self, osmium: Any) -> None:
        self._osmium, self._shapes = osmium, osmium.geom.WKBFactory()
        self._ways: list[Building] = []
        self._areas: list[Building] = []
        self._wanted: set[int] = set()
        """Multipolygons of buildings."""
        self._outer: set[tuple[int, bool]] = set()
        """Ways that are an outer side of such, and whether of a building or only of a part."""
        self._faults: Counter[str] = Counter()

    def add(self, element: Any) -> None:
        """Takes a way, a relation or an area."""
        tags = {key: value for key, value in element.tags if key in KEPT}
        if not (is_building(tags) or is_part(tags)) or element.deleted:
            return
        if element.is_way():
            self._add_way(element, tags)
        elif element.is_relation():
            self._add_relation(element, tags)
        elif not element.from_way() and element.num_rings()[0]:
            wkb = self._shapes.create_multipolygon(element)
            self._areas.append(Building("relation", element.orig_id(), tags, wkb))

    def _add_way(self, way: Any, tags: dict[str, str]) -> None:
        """Its shape is made of its points as they are, for what crosses itself is repaired later."""
        if len(way.nodes) < 4:
            self._faults["small"] += 1
        elif not way.ends_have_same_id():
            self._faults["open"] += 1
        else:
            try:
                self._ways.append(Building("way", way.id, tags, self._shapes.create_linestring(way)))
            except self._osmium.InvalidLocationError:
                self._faults["cut"] += 1
            except RuntimeError:
                self._faults["small"] += 1

    def _add_relation(self, relation: Any, tags: dict[str, str]) -> None:
        if relation.tags.get("type") not in _MULTIPOLYGONS:
            return
        self._wanted.add(relation.id)
        outer = (member.ref for member in relation.members if member.type == "w" and member.role in ("outer", ""))
        self._outer.update((ref, is_building(tags)) for ref in outer)

    def buildings(self) -> list[Building]:
        """All of them, ways first."""
        made = {area.id for area in self._areas}
        self._faults["broken"] = len(self._wanted - made)
        ways = [way for way in self._ways if (way.id, is_building(way.tags)) not in self._outer]
        self._faults["repeated"] = len(self._ways) - len(ways)
        return ways + self._areas

    def notes(self) -> list[str]:
        """A line for each kind of fault that was met."""
        lines = ((self._faults[kind], noun, why) for kind, (noun, why) in _REPORTS.items())
        return [f"left out {counted(count, noun)} {why}" for count, noun, why in lines if count]
