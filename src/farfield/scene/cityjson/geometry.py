"""Geometries of city objects: which level of detail is taken, and their nested boundaries as flat surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from farfield.scene.cityjson.document import mapping, sequence
from farfield.scene.cityjson.kinds import Role, role_of

DEPTH = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}
"""Type of a geometry → lists round its surfaces, beyond the one of a MultiSurface."""
INSTANCE = "GeometryInstance"
_INT = {int}
_Rank = tuple[float, bool, bool, int]
"""Level of detail, whether it has looks, whether it has semantics, and solids before surfaces."""


class Surface(NamedTuple):
    """A surface of a geometry."""

    rings: Any
    """As the file gives them."""
    role: Role
    material: Any
    texture: Any


def chosen(members: list[dict[str, Any]], most: float | None, templates: tuple[Any, ...]) -> list[list[dict[str, Any]]]:
    """The geometries to draw of each member of a group.

    Of every member the highest level of detail that is not above `most`; when all of the group are, the lowest. Of
    several geometries of that level those that say most about their surfaces. An object whose parts are more detailed
    (by whole levels) than itself is drawn by its parts alone.
    """
    ranked = [
        [(_rank(entry, templates), entry) for entry in _mappings(member.get("geometry")) if drawable(entry, templates)]
        for member in members
    ]
    below = any(most is None or rank[0] <= most for own in ranked for rank, _ in own)
    picked = [_best(own, most, below) for own in ranked]
    of_parts = [
        level
        for (level, found), member in zip(picked[1:], members[1:], strict=True)
        if found and str(member.get("type")).endswith("Part")
    ]
    if picked[0][1] and of_parts and math.floor(picked[0][0]) < math.floor(max(of_parts)):
        picked[0] = (picked[0][0], [])
    return [found for _, found in picked]


def _mappings(given: object) -> list[dict[str, Any]]:
    """The objects in a list."""
    return [entry for entry in sequence(given) if isinstance(entry, dict)]


def drawable(geometry: dict[str, Any], templates: tuple[Any, ...]) -> bool:
    """True for surfaces, solids, and instances of such."""
    kind = geometry.get("type")
    if kind == INSTANCE:
        return template_of(geometry, templates) is not None
    return isinstance(kind, str) and kind in DEPTH


def template_of(geometry: dict[str, Any], templates: tuple[Any, ...]) -> dict[str, Any] | None:
    """The template of an instance, or None when there is none that can be drawn."""
    number = geometry.get("template")
    if type(number) is not int or not 0 <= number < len(templates):
        return None
    template = mapping(templates[number])
    return template if template.get("type") in DEPTH else None


def _best(
    ranked: list[tuple[_Rank, dict[str, Any]]], most: float | None, below: bool
) -> tuple[float, list[dict[str, Any]]]:
    """Level and geometries. below: whether levels above `most` are out of question."""
    levels = {rank[0] for rank, _ in ranked}
    fitting = {level for level in levels if most is None or level <= most} if below else levels
    if not fitting:
        return -1.0, []
    level = max(fitting) if below else min(fitting)
    best = max(rank for rank, _ in ranked if rank[0] == level)
    return level, [entry for rank, entry in ranked if rank == best]


def _rank(geometry: dict[str, Any], templates: tuple[Any, ...]) -> _Rank:
    told = geometry
    if geometry.get("type") == INSTANCE:
        told = template_of(geometry, templates) or {}
    looks = bool(told.get("texture") or told.get("material"))
    return _level(told.get("lod")), looks, bool(told.get("semantics")), DEPTH[told["type"]]


def _level(given: object) -> float:
    try:
        level = float(given)  # type: ignore[arg-type]
    except (ValueError, TypeError, OverflowError):
        return -1.0
    return level if math.isfinite(level) else -1.0


def surfaces_of(geometry: dict[str, Any], material: dict[str, Any], texture: dict[str, Any]) -> Iterator[Surface]:
    """The surfaces of a geometry that is no instance; a list in the place of another is walked as far as it goes.

    material, texture: what it says for the theme that is drawn.
    """
    semantics = mapping(geometry.get("semantics"))
    roles = [role_of(entry.get("type")) for entry in map(mapping, sequence(semantics.get("surfaces")))]
    one = material.get("value")
    walk = _walk(geometry.get("boundaries"), DEPTH[geometry["type"]], semantics.get("values"), material.get("values"),
                 texture.get("values"))  # fmt: skip
    for rings, semantic, own, uvs in walk:
        known = type(semantic) is int and 0 <= semantic < len(roles)
        yield Surface(rings, roles[semantic] if known else Role.UNSAID, one if own is None else own, uvs)


def _walk(boundaries: object, depth: int, *values: object) -> Iterator[tuple[Any, ...]]:
    """Every surface with what the parallel lists say of it, None where these are shorter."""
    lists = [sequence(value) for value in values]
    for place, inner in enumerate(sequence(boundaries)):
        own = [value[place] if place < len(value) else None for value in lists]
        if depth:
            yield from _walk(inner, depth - 1, *own)
        else:
            yield (inner, *own)


def is_ring(ring: Any, count: int) -> bool:
    """True for a list of whole numbers from 0 to below count."""
    return type(ring) is list and set(map(type, ring)) == _INT and min(ring) >= 0 and max(ring) < count
