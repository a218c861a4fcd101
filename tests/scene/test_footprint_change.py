"""Footprints replaced by region give the chunks that reading everything anew gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.scene.footprints.change import Change, Table, replaced
from farfield.scene.footprints.features import Features, by_place, chunk_at
from farfield.scene.footprints.order import Square, split
from farfield.scene.footprints.rings import Rings
from farfield.scene.stored.footprints import decode_features, encode_features

Building = tuple[int, int, int]
"""x, y (tens of metres), and height."""


def table(buildings: Sequence[Building]) -> Table:
    """Boxes of 8 m with a number each."""
    count = len(buildings)
    corner = np.array([(x * 10.0, y * 10.0) for x, y, _ in buildings]).reshape(-1, 2)
    box = np.array([(0, 0), (8, 0), (8, 8), (0, 8)]) + np.pi
    rings = Rings(
        (corner[:, None] + box).reshape(-1, 2), np.arange(count + 1) * 4, np.arange(count + 1), np.arange(count)
    )
    top = np.array([float(height) for *_, height in buildings])
    features = Features(rings, np.zeros(count), top, np.array([hash(b) & 0xFFFF for b in buildings], np.uint32))
    return Table(features, {"height": [height for *_, height in buildings]})


@dataclass(frozen=True)
class Chunk:
    square: Square
    held: Table

    @property
    def count(self) -> int:
        return len(self.held.features)

    def table(self) -> Table:
        return self.held


def chunks(whole: Table, most: int) -> list[Chunk]:
    codes, rows = by_place(whole.features.boxes, np.arange(len(whole.features)))
    return [Chunk(square, whole.of(rows[low:high])) for square, low, high in split(codes, most)]


def told(found: Sequence[Chunk]) -> dict[Square, tuple[bytes, list[int]]]:
    return {c.square: (encode_features(c.held.features), c.held.columns["height"]) for c in found}


def result(standing: Sequence[Chunk], change: Change) -> list[Chunk]:
    made = [Chunk(chunk.square, Table(chunk.features, columns)) for chunk, columns in change.made]
    return [standing[k] for k in change.kept] + made


BUILDINGS = st.lists(
    st.tuples(st.integers(-40, 40), st.integers(-40, 40), st.integers(3, 30)), max_size=60, unique_by=lambda b: b[:2]
)
SPANS = st.tuples(st.integers(-42, 42), st.integers(1, 30))


@settings(max_examples=200, deadline=None)
@given(BUILDINGS, BUILDINGS, SPANS, SPANS, st.integers(1, 12))
def test_a_region_gives_the_chunks_of_the_whole(
    before: list[Building], after: list[Building], x: tuple[int, int], y: tuple[int, int], most: int
) -> None:
    region = (x[0] * 10.0, y[0] * 10.0, sum(x) * 10.0, sum(y) * 10.0)

    def is_in(building: Building) -> bool:
        middle = (building[0] * 10 + 4 + np.pi, building[1] * 10 + 4 + np.pi)
        return region[0] <= middle[0] < region[2] and region[1] <= middle[1] < region[3]

    fresh = [b for b in after if is_in(b)]
    whole = [b for b in before if not is_in(b)] + fresh
    standing = chunks(table(before), most) if before else []
    change = replaced(standing, table(fresh) if fresh else None, region, most, "a.fgb", True)
    assert told(result(standing, change)) == (told(chunks(table(whole), most)) if whole else {})


@given(BUILDINGS.filter(bool))
def test_footprints_come_back_exactly(buildings: list[Building]) -> None:
    data = encode_features(table(buildings).features)
    assert encode_features(decode_features(data)) == data


def test_a_chunk_is_named_by_its_place() -> None:
    middle = Square(5, 0b11 << 32)
    assert chunk_at(middle, table([(0, 0, 3)]).features, "a.fgb", True).name == "a.fgb, 512 m square at 0, 0"
    assert middle.box == (0.0, 0.0, 512.0, 512.0)
