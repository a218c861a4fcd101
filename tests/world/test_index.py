"""Tiles that an index picks: as written and as read."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.world.index import CellEntry, IndexTile, decode_index, encode_index, write_picks

BOUNDS = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
TILES = tuple((direction, layer, 1000) for direction in range(8) for layer in range(2))
GAINS = st.lists(st.floats(0.01, 60_000), max_size=16).map(lambda gains: sorted(gains, reverse=True))


def index_of(picks: tuple[int, ...]) -> bytes:
    entry = CellEntry(key="0/0/0/0", bounds=BOUNDS, error=1.0, tiles=TILES, picks=(picks,) * 26)
    return encode_index(IndexTile("0/0/0/0", (entry,)))


@given(GAINS)
def test_gains_come_back_within_a_tenth(gains: list[float]) -> None:
    picks = write_picks(enumerate(gains))
    entry = decode_index(index_of(picks), "test").cells[0]
    found = entry.picks_from(3)
    assert [place for place, _ in found] == list(range(len(gains)))
    assert [gain for _, gain in found] == pytest.approx(gains, rel=0.1)


@pytest.mark.parametrize(
    "picks", [(0,), (16, 0), (0, 256), (0, 1, 0, 1)], ids=["half a pair", "no such tile", "too far down", "twice"]
)
def test_picks_that_cannot_be_are_damage(picks: tuple[int, ...]) -> None:
    with pytest.raises(CorruptTileError):
        decode_index(index_of(picks), "test")
