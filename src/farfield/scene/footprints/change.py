"""Replacing the footprints of a region: the chunks come out as if the whole file had been read again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.features import Features, FootprintChunk, by_place, centres_of, chunk_at
from farfield.scene.footprints.order import Square, split
from farfield.scene.options import Facades, Region, inside

Columns = dict[str, list[Any]]
"""Attributes: name -> a value for each feature."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Footprints and their attributes."""

    features: Features
    columns: Columns

    def of(self, rows: NDArray[np.int64]) -> Table:
        """Copies of some, in the order given."""
        chosen = rows.tolist()
        columns = {name: [column[row] for row in chosen] for name, column in self.columns.items()}
        return Table(self.features.of(rows), columns)

    @classmethod
    def joined(cls, parts: Sequence[Table]) -> Table:
        """Several, one after the other; at least one. None stands where one lacks a column."""
        names = dict.fromkeys(name for part in parts for name in part.columns)
        columns: Columns = {name: [] for name in names}
        for part in parts:
            for name, column in columns.items():
                column += part.columns.get(name) or [None] * len(part.features)
        return cls(Features.joined([part.features for part in parts]), columns)


class Standing(Protocol):
    """A chunk of the scene as it stands."""

    @property
    def square(self) -> Square:
        """Where its features are."""
        ...

    @property
    def count(self) -> int:
        """How many they are."""
        ...

    def table(self) -> Table:
        """Reads them."""
        ...


def meets(square: Square, region: Region) -> bool:
    """Whether something in the square may lie in the region."""
    x0, y0, x1, y1 = square.box
    return x0 < region[2] and region[0] < x1 and y0 < region[3] and region[1] < y1


@dataclass(frozen=True, slots=True)
class Change:
    """What becomes of a file's chunks."""

    kept: list[int]
    """Those that stay as they are."""
    made: list[tuple[FootprintChunk, Columns]]
    """Those that are new, with the attributes of their buildings."""


def replaced(
    standing: Sequence[Standing], fresh: Table | None, region: Region, most: int, family: str, facades: Facades
) -> Change:
    """The chunks of a file whose features with their middle in `region` are replaced by those of `fresh`.

    standing: chunks of disjoint squares. most: features a chunk, as when the file was read.
    """
    touched = {k for k, chunk in enumerate(standing) if meets(chunk.square, region)}
    tables = [_outside(standing[k].table(), region) for k in sorted(touched)] + ([fresh] if fresh else [])
    tables = [table for table in tables if len(table.features)]
    loose = Table.joined(tables) if tables else None
    codes, rows = by_place_of(loose)
    still = [k for k in range(len(standing)) if k not in touched]
    all_codes = np.concatenate([codes, np.array([standing[k].square.codes[0] for k in still], np.uint64)])
    weights = np.concatenate([np.ones(len(codes), np.int64), [standing[k].count for k in still]]).astype(np.int64)
    order = np.argsort(all_codes, kind="stable")
    kept: list[int] = []
    made: list[tuple[FootprintChunk, Columns]] = []
    for square, low, high in split(all_codes[order], most, weights[order]):
        own = order[low:high]
        old = [still[k - len(codes)] for k in own[own >= len(codes)].tolist()]
        new = rows[own[own < len(codes)]]
        if len(old) == 1 and not len(new) and standing[old[0]].square == square:
            kept.append(old[0])
            continue
        parts = [standing[k].table() for k in old] + ([loose.of(new)] if loose is not None and len(new) else [])
        table = Table.joined(parts)
        table = table.of(by_place_of(table)[1])
        made.append((chunk_at(square, table.features, family, facades), table.columns))
    return Change(kept, made)


def by_place_of(table: Table | None) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    """See `by_place`; of all features."""
    if table is None:
        return np.empty(0, np.uint64), np.empty(0, np.int64)
    features = table.features
    return by_place(features.boxes, np.arange(len(features)), features.details.lift)


def tables_of(chunks: Sequence[FootprintChunk], columns: Mapping[str, Any], first: Sequence[int]) -> Iterator[Table]:
    """Chunks that were just read, with their attributes; first: number of the first object of each, from 1."""
    for chunk, begin in zip(chunks, first, strict=True):
        rows = slice(begin - 1, begin - 1 + len(chunk.features))
        yield Table(chunk.features, {name: np.asarray(column)[rows].tolist() for name, column in columns.items()})


def _outside(table: Table, region: Region) -> Table:
    return table.of(np.flatnonzero(~inside(centres_of(table.features.boxes), region)))
