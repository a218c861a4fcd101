"""Surfaces of all documents of a file, gathered as flat arrays."""

from __future__ import annotations

from array import array
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cityjson.appearance import NO_COLOR, Appearance, Color, is_seen, themed
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.geometry import DEPTH, Surface, is_ring, surfaces_of
from farfield.scene.cityjson.kinds import Family, Role
from farfield.scene.footprints.rings import starts_of


class Gatherer:
    """Grows by one geometry after the other."""

    def __init__(self, faults: Counter[str]) -> None:
        self._faults = faults
        self._points: list[NDArray[np.float64]] = []
        self._usable: NDArray[np.bool_] = np.empty(0, bool)
        self._all_usable = True
        self._before = 0
        self._corners = array("q")
        self._rings = array("q")
        self._faces = array("q")
        self._kinds = array("q")
        self._colors = bytearray()
        self._uv = array("d")
        self._uv_at = array("q")

    def __len__(self) -> int:
        """Surfaces."""
        return len(self._faces)

    def add_points(self, points: NDArray[np.float64]) -> None:
        """(n, 3): what the corners of the geometries that follow are among; NaN where unusable."""
        self._before += len(self._points[-1]) if self._points else 0
        self._points.append(points)
        self._usable = np.asarray(np.isfinite(points).all(axis=1))
        self._all_usable = bool(self._usable.all())

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) of the document at hand."""
        return self._points[-1]

    def add(self, geometry: dict[str, Any], owner: int, family: Family, looks: Appearance) -> None:
        """A geometry that is no instance; what cannot be used of it is counted."""
        material = themed(geometry.get("material"), looks.material_theme)
        texture = themed(geometry.get("texture"), looks.texture_theme)
        single = DEPTH[geometry["type"]] > 0
        for surface in surfaces_of(geometry, material, texture):
            self._surface(surface, owner, family, single, looks)

    def _surface(self, surface: Surface, owner: int, family: Family, single: bool, looks: Appearance) -> None:
        if surface.role == Role.HIDDEN:
            return
        rings = surface.rings
        if type(rings) is not list or not rings or not all(is_ring(ring, len(self._points[-1])) for ring in rings):
            self._faults["surface with vertices that do not exist"] += 1
            return
        if not self._all_usable and not all(self._usable[ring].all() for ring in rings):
            self._faults["surface with vertices that are no numbers"] += 1
            return
        color = _color(surface.material, looks)
        if not is_seen(color):
            self._faults["transparent"] += 1
            return
        image = self._texture(surface.texture, rings, looks)
        for ring in rings:
            self._corners.extend([number + self._before for number in ring])
            self._rings.append(len(ring))
        self._faces.append(len(rings))
        self._kinds.extend((owner, family, surface.role, single, image))
        self._colors.extend(color)

    def _texture(self, given: Any, rings: list[list[int]], looks: Appearance) -> int:
        """The image of a surface, its coordinates noted; -1 for none."""
        if not given or type(given) is not list or given == [[None]]:
            return -1
        numbers = _uv_numbers(given, rings, looks)
        if numbers is None or np.isnan(uvs := looks.uvs[numbers]).any():
            first = given[0][0] if type(given[0]) is list and given[0] else None
            self._faults["texture"] += first is not None
            return -1
        image: int = looks.images[given[0][0]]
        if image >= 0:
            self._uv.frombytes(uvs.tobytes())
            self._uv_at.extend(range(len(self._corners), len(self._corners) + len(uvs)))
        return image

    def faces(self) -> Faces:
        """Everything that was added."""
        kinds = np.array(self._kinds, np.int64).reshape(-1, 5)
        corner = np.array(self._corners, np.int64)
        uv = np.zeros((len(corner) if self._uv_at else 0, 2), np.float32)
        uv[np.array(self._uv_at, np.int64)] = np.array(self._uv).reshape(-1, 2)
        return Faces(
            np.concatenate([*self._points, np.empty((0, 3))]),
            corner,
            starts_of(np.array(self._rings, np.int64)),
            starts_of(np.array(self._faces, np.int64)),
            kinds[:, 0].copy(),
            kinds[:, 1].astype(np.uint8),
            kinds[:, 2].astype(np.uint8),
            kinds[:, 3].astype(np.bool_),
            kinds[:, 4].astype(np.int32),
            np.frombuffer(bytes(self._colors), np.uint8).reshape(-1, 4),
            uv,
        )


def _color(number: Any, looks: Appearance) -> Color:
    return looks.colors[number] if type(number) is int and 0 <= number < len(looks.colors) else NO_COLOR


def _uv_numbers(given: list[Any], rings: list[list[int]], looks: Appearance) -> list[int] | None:
    """Places of the corners' texture coordinates; None when something about them is wrong."""
    if len(given) != len(rings) or type(given[0]) is not list or not is_ring(given[0][:1], len(looks.images)):
        return None
    numbers: list[int] = []
    for ring, own in zip(rings, given, strict=True):
        if type(own) is not list or len(own) != len(ring) + 1 or not is_ring(own[1:], len(looks.uvs)):
            return None
        numbers += own[1:]
    return numbers
