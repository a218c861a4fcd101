"""City objects of all documents of a file: their surfaces, placements of templates, and attributes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from farfield.scene.cityjson.appearance import Appearance, Images, appearance_of
from farfield.scene.cityjson.crs import METRES, Frame, in_metres
from farfield.scene.cityjson.document import Document, Header, mapping, open_documents, sequence
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.gather import Gatherer
from farfield.scene.cityjson.geometry import INSTANCE, chosen, drawable
from farfield.scene.cityjson.kinds import Family, family_of
from farfield.scene.cityjson.objects import Group, attributes_of, groups_of
from farfield.scene.cityjson.templates import Placed, Templates, placed
from farfield.scene.options import ReadOptions


@dataclass(frozen=True, slots=True, eq=False)
class City:
    """Everything that a file holds."""

    crs: str | None
    rows: list[dict[str, Any]]
    """Attributes of each object, in the order of the file."""
    faces: Faces
    shared: list[Placed]
    """Objects that are a template each and nothing else."""
    templates: Templates
    images: Images


def read_city(path: Path, options: ReadOptions, faults: Counter[str], warnings: list[str]) -> City:
    """Reads a file; what is left out is counted in `faults`. Raises InputError and MissingExtraError."""
    header, documents = open_documents(path, faults)
    reading = _Reading(path, header, options, faults, warnings)
    for document in documents:
        reading.add(document)
    return reading.city()


class _Reading:
    def __init__(
        self, path: Path, header: Header, options: ReadOptions, faults: Counter[str], warnings: list[str]
    ) -> None:
        self._where, self._header, self._options = str(path), header, options
        self._faults, self._warnings = faults, warnings
        self._gatherer = Gatherer(faults)
        self._rows: list[dict[str, Any]] = []
        self._placed: list[Placed] = []
        self._mixed: set[int] = set()
        """Objects that are more than one template."""
        self._images = Images(path)
        self._given = mapping(header.json.get("appearance"))
        self._looks = appearance_of(self._given, self._images)
        self._frame: Frame | None = None

    def add(self, document: Document) -> None:
        """Gathers the objects of a document."""
        points = document.vertices
        known = points[~np.isnan(points[:, 0])]
        if self._frame is None and len(known):
            options = self._options
            self._frame = in_metres(self._header.reference, known, options.crs, self._where, self._warnings)
        if self._frame is not None and self._frame.project is not None:
            points = self._frame.project(points)
        self._gatherer.add_points(points)
        looks = self._looks if document.appearance is self._given else appearance_of(document.appearance, self._images)
        for group in groups_of(document.objects, self._faults):
            self._add_group(group, looks)

    def _add_group(self, group: Group, looks: Appearance) -> None:
        owner, gatherer = len(self._rows), self._gatherer
        templates = self._header.templates
        self._count_undrawable(group)
        geometries = [
            (geometry, family_of(member.get("type")))
            for member, found in zip(group.members, chosen(group.members, self._options.lod, templates), strict=True)
            for geometry in found
        ]
        surfaces, placements = len(gatherer), len(self._placed)
        for geometry, family in geometries:
            if geometry["type"] == INSTANCE:
                self._place(geometry, owner, family)
            else:
                gatherer.add(geometry, owner, family, looks)
        used = len(self._placed) - placements + (len(gatherer) > surfaces)
        if used > 1:
            self._mixed.add(owner)
        if used:
            self._rows.append(attributes_of(group))
        elif group.members[0].get("type") != "CityObjectGroup":
            self._faults["object without geometry"] += 1

    def _count_undrawable(self, group: Group) -> None:
        for member in group.members:
            for geometry in sequence(member.get("geometry")):
                entry = mapping(geometry)
                if entry.get("type") in ("MultiPoint", "MultiLineString"):
                    self._faults["shape of points or lines"] += 1
                elif not drawable(entry, self._header.templates):
                    self._faults["shape that cannot be read"] += 1

    def _place(self, geometry: dict[str, Any], owner: int, family: Family) -> None:
        unit = self._frame.unit if self._frame else METRES
        one = placed(geometry, owner, family, self._gatherer.points, unit)
        if one is None:
            self._faults["shape that cannot be read"] += 1
        else:
            self._placed.append(one)

    def city(self) -> City:
        """What was gathered."""
        templates = Templates(self._header, self._looks, self._faults)
        # Buildings have façades of their own, which follow from how high they are.
        alone = [one for one in self._placed if one.owner not in self._mixed and one.family != Family.BUILDING]
        chosen_ones = {id(one) for one in alone}
        copies = templates.copies([one for one in self._placed if id(one) not in chosen_ones])
        faces = Faces.joined([self._gatherer.faces(), *copies])
        crs = self._frame.crs if self._frame else self._options.crs
        shared = [one for one in alone if len(templates.faces(one.template))]
        return City(crs, self._rows, faces, shared, templates, self._images)
