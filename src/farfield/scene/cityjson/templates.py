"""Instances of geometry templates: placements of shared meshes, or surfaces of their own where an object has more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cityjson.appearance import Appearance
from farfield.scene.cityjson.document import Header, mapping, sequence
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.gather import Gatherer
from farfield.scene.cityjson.geometry import is_ring
from farfield.scene.cityjson.kinds import Family

MOST_CORNERS = 50_000_000
"""Of surfaces that are copied from templates, all together: a small file can ask for any number."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A template, placed."""

    owner: int
    family: Family
    template: int
    transform: NDArray[np.float64]
    """(3, 4) from the template to coordinates of the CRS."""


def placed(
    geometry: dict[str, Any], owner: int, family: Family, points: NDArray[np.float64], unit: tuple[float, float]
) -> Placed | None:
    """The placement that an instance asks for; None when its matrix or reference point is none.

    points: (n, 3) of the document, in the CRS that is read in. unit: metres of the template's, along the ground and up.
    """
    ring = sequence(geometry.get("boundaries"))[:1]
    if not is_ring(ring, len(points)):
        return None
    try:
        matrix = np.array(geometry.get("transformationMatrix", np.eye(4)), np.float64).reshape(4, 4)[:3].copy()
    except (ValueError, TypeError, OverflowError):
        return None
    matrix *= np.array([[unit[0]], [unit[0]], [unit[1]]])
    matrix[:, 3] += points[ring[0]]
    return Placed(owner, family, geometry["template"], matrix) if np.isfinite(matrix).all() else None


class Templates:
    """The templates of a file, each made once."""

    def __init__(self, header: Header, looks: Appearance, faults: Counter[str]) -> None:
        self._header, self._looks, self._faults = header, looks, faults
        self._made: dict[int, Faces] = {}
        self._copied = 0

    def faces(self, template: int) -> Faces:
        """Surfaces of a template, in its own frame, of object 0."""
        if template not in self._made:
            gatherer = Gatherer(self._faults)
            gatherer.add_points(self._header.template_vertices)
            geometry = mapping(self._header.templates[template])
            gatherer.add(geometry, 0, Family.OTHER, self._looks)
            faces = gatherer.faces()
            self._made[template] = faces.of(np.arange(len(faces)))
        return self._made[template]

    def copies(self, wanted: Sequence[Placed]) -> list[Faces]:
        """Surfaces of their own for some placements, as many as there is room for; the others are counted."""
        found = []
        for one in wanted:
            faces = self.faces(one.template)
            self._copied += len(faces.corner)
            if self._copied > MOST_CORNERS:
                self._faults["instance of a template beyond 50 million corners"] += 1
            else:
                found.append(_moved(faces, one))
        return found


def of_family(faces: Faces, family: Family) -> Faces:
    """The same, of another family."""
    return replace(faces, family=np.full(len(faces), family, np.uint8))


def _moved(faces: Faces, one: Placed) -> Faces:
    linear = one.transform[:, :3]
    return replace(
        of_family(faces, one.family),
        points=faces.points @ linear.T + one.transform[:, 3],
        owner=np.full(len(faces), one.owner, np.int64),
        # What is mirrored turns the other way; seen from both sides that does not matter.
        single=faces.single & bool(np.linalg.det(linear) > 0),
    )
