"""Which city objects belong together, and what is told of them."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cityjson.document import mapping, sequence

MOST_COLUMNS = 512
"""Attributes of a file; those that the fewest objects have are left out beyond it."""
_GROUP = "CityObjectGroup"
_LARGEST_INT = 1 << 53


@dataclass(frozen=True, slots=True)
class Group:
    """A city object at the top, and all below it."""

    id: str
    members: list[dict[str, Any]]
    """The object itself, then its descendants in the order of the file."""


def groups_of(objects: dict[str, Any], faults: Counter[str]) -> list[Group]:
    """In the order of the file; objects in a circle of parents are left out and counted."""
    known = {name: entry for name, entry in objects.items() if isinstance(entry, dict)}
    faults["object that cannot be read"] += len(objects) - len(known)
    parent = _parents(known)
    top: dict[str, str | None] = {}
    members: dict[str, list[dict[str, Any]]] = {}
    for name in known:
        root = _root(name, parent, top)
        if root is None:
            faults["object whose parents go in a circle"] += 1
        elif root == name:
            members.setdefault(root, []).insert(0, known[name])
        else:
            members.setdefault(root, []).append(known[name])
    return [Group(name, members[name]) for name in known if name in members]


def _parents(known: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Of each object that has one; membership in a CityObjectGroup does not count."""
    parent: dict[str, str] = {}
    for name, entry in known.items():
        if entry.get("type") == _GROUP:
            continue
        for child in sequence(entry.get("children")):
            if isinstance(child, str) and child in known:
                parent.setdefault(child, name)
    for name, entry in known.items():
        for above in sequence(entry.get("parents")):
            if isinstance(above, str) and above in known and known[above].get("type") != _GROUP:
                parent[name] = above
                break
    return parent


def _root(name: str, parent: dict[str, str], top: dict[str, str | None]) -> str | None:
    """The object at the top of all parents, None when these go in a circle; `top` remembers."""
    trail: dict[str, None] = {}
    while name in parent and name not in top and name not in trail:
        trail[name] = None
        name = parent[name]
    found = None if name in trail else top.get(name, name)
    top.update(dict.fromkeys(trail, found))
    top.setdefault(name, found)
    return found


def attributes_of(group: Group) -> dict[str, Any]:
    """Attributes of the object at the top, then those that only its parts have: of each the first that has a value."""
    found: dict[str, Any] = {"id": _text(group.id), "type": _text(str(group.members[0].get("type", "")))}
    for member in group.members:
        own = mapping(member.get("attributes"))
        if "address" in member:
            own = {"address": member["address"], **own}
        for name, value in own.items():
            label = f"attributes.{name}" if name in ("id", "type") else _text(name)
            if value is not None and label not in found:
                found[label] = _plain(value)
    return found


def columns_of(rows: list[dict[str, Any]], faults: Counter[str]) -> dict[str, NDArray[Any]]:
    """Columns with a value for each row: numbers where all are, NaN where missing; else objects, None where missing."""
    counts = Counter(name for row in rows for name in row)
    chosen = [name for name, _ in counts.most_common(MOST_COLUMNS)]
    faults["attribute beyond the most frequent"] += len(counts) - len(chosen)
    return {name: _column([row.get(name) for row in rows]) for name in counts if name in set(chosen)}


def _column(values: list[Any]) -> NDArray[Any]:
    kinds = {type(value) for value in values}
    if kinds <= {int} and all(abs(value) <= _LARGEST_INT for value in values):
        return np.array(values, np.int64)
    if kinds <= {int, float, type(None)} and kinds != {type(None)}:
        return np.array([math.nan if value is None else float(value) for value in values])
    column = np.empty(len(values), object)
    column[:] = values
    return column


def _plain(value: Any) -> Any:
    """What a table holds: text, numbers and truth values; anything else as JSON text."""
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool) or (isinstance(value, int) and abs(value) <= _LARGEST_INT):
        return value
    if isinstance(value, int | float):
        try:
            number = float(value)
        except OverflowError:
            return None
        return number if math.isfinite(number) else None
    try:
        return json.dumps(value)
    except RecursionError:
        return None


def _text(value: str) -> str:
    """Without halves of surrogate pairs, which no UTF-8 holds."""
    return value.encode("utf-8", "replace").decode("utf-8")
