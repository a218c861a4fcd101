"""The triangles of other pieces that touch a piece: with them its normals are those of the whole surface."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.stored.order import TRIANGLE, Order
from farfield.scene.stored.sorting import SortedRecords, grouped

_USE = np.dtype([("vertex", "<i8"), ("piece", "<i8")])
_MEETING = np.dtype([("piece", "<i8"), ("vertex", "<i8"), ("other", "<i8")])
_RING = np.dtype([("piece", "<i8"), ("triangle", "<i8"), ("corners", "<i8", (3,))])


def rings(order: Order, cuts: list[tuple[int, int]], folder: Path) -> Iterator[NDArray[Any]]:
    """For each piece, in turn, TRIANGLE: those of the others that have a vertex in common with it.

    folder: for files of some hundred bytes for each vertex at a border. In memory are a piece and its ring, which is
    small but where very many triangles meet in one vertex.
    """
    uses = SortedRecords(folder / "uses", _USE)
    for piece, cut in enumerate(cuts):
        vertices = np.unique(order.part(*cut)["corners"])
        uses.add(_records(_USE, vertices, np.full(len(vertices), piece)))
    meetings = SortedRecords(folder / "meetings", _MEETING)
    for batch in _whole_vertices(uses.batches()):
        meetings.add(_meetings(batch))
    ring = SortedRecords(folder / "ring", _RING)
    for piece, met in grouped(meetings.batches()):
        for records in _touching(order.part(*cuts[piece]), met):
            ring.add(records)
    found = grouped(ring.batches())
    piece, records = next(found, (len(cuts), np.empty(0, _RING)))
    for number in range(len(cuts)):
        if number < piece:
            yield np.empty(0, TRIANGLE)
        else:
            yield records[["triangle", "corners"]].astype(TRIANGLE)
            piece, records = next(found, (len(cuts), records))


def _records(dtype: np.dtype[Any], *columns: NDArray[Any]) -> NDArray[Any]:
    records = np.empty(len(columns[0]), dtype)
    for name, column in zip(dtype.names or (), columns, strict=True):
        records[name] = column
    return records


def _whole_vertices(batches: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """The same, divided so that all uses of a vertex are in one batch."""
    kept = np.empty(0, _USE)
    for batch in batches:
        uses = np.concatenate([kept, batch])
        end = int(np.searchsorted(uses["vertex"], uses["vertex"][-1]))
        yield uses[:end]
        kept = uses[end:]
    yield kept


def _meetings(uses: NDArray[Any]) -> NDArray[Any]:
    """For each vertex every two pieces that use it, either way round."""
    vertices = uses["vertex"]
    starts = np.flatnonzero(np.append(True, vertices[1:] != vertices[:-1]))[: len(uses)]
    group = np.diff(np.append(starts, len(uses)))
    each = np.repeat(group, group)
    one = np.repeat(np.arange(len(uses)), each)
    other = np.arange(len(one)) - np.repeat(np.cumsum(each) - each, each) + np.repeat(np.repeat(starts, group), each)
    apart = one != other
    one, other = one[apart], other[apart]
    return _records(_MEETING, uses["piece"][one], vertices[one], uses["piece"][other])


def _touching(triangles: NDArray[Any], met: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """_RING for each other piece: the triangles with any of the vertices that it has in common with this one."""
    corners = triangles["corners"].ravel()
    by_vertex = np.argsort(corners, kind="stable")
    vertices = corners[by_vertex]
    met = met[np.argsort(met["other"], kind="stable")]
    starts = np.flatnonzero(np.append(True, met["other"][1:] != met["other"][:-1]))
    for part in np.split(met, starts[1:]):
        first, last = (np.searchsorted(vertices, part["vertex"], side) for side in ("left", "right"))
        count = last - first
        places = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        chosen = triangles[np.unique(by_vertex[places] // 3)]
        yield _records(_RING, np.full(len(chosen), part["other"][0]), chosen["triangle"], chosen["corners"])
