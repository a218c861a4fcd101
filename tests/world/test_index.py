"""Tiles that an index picks: as written and as read."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.world.index import CellEntry, IndexTile, decode_index, encode_index, pack_picks

BOUNDS = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
TILES = tuple((direction, layer, 1000) for direction in range(8) for layer in range(2))
GAINS = st.lists(st.floats(0.01, 60_000), max_size=16).map(lambda gains: sorted(gains, reverse=True))


def index_of(picked: tuple[str, ...] = (), picks: tuple[tuple[int, ...], ...] = ()) -> bytes:
    entry = CellEntry(key="0/0/0/0", bounds=BOUNDS, error=1.0, tiles=TILES, picked=picked, picks=picks)
    return encode_index(IndexTile("0/0/0/0", (entry,)))


@given(st.lists(GAINS, max_size=26))
def test_gains_come_back_within_a_tenth(gains: list[list[float]]) -> None:
    entry = decode_index(index_of(pack_picks(map(enumerate, gains))), "test").cells[0]
    for n, own in enumerate(gains):
        found = entry.picks_from(n)
        assert [place for place, _ in found] == list(range(len(own)))
        assert [gain for _, gain in found] == pytest.approx(own, rel=0.1)
        assert entry.directions_from(n) == list(range((len(own) + 1) // 2))
    assert len(gains) == 26 or entry.picks_from(25) == entry.directions_from(25) == []


@pytest.mark.parametrize(
    "picked",
    [("%", "#", "#"), ("$", "$$", "#"), ("$",), ("$", "#", "#", "#"), ('$"', "#", "#"), ("$" * 27, "#" * 27, "#" * 27),
     ("$", "3", "#"), ("$", "#", "ģ"), ("%", "##", "##")],
    ids=["fewer than said", "more", "no places", "too many", "below 0", "27 bins", "no tile", "too far down", "twice"],
)  # fmt: skip
def test_picked_tiles_that_cannot_be_are_damage(picked: tuple[str, ...]) -> None:
    assert decode_index(index_of(("$", "#", "#")), "test").cells[0].picks_from(0) == [(0, 65536.0)]
    with pytest.raises(CorruptTileError):
        decode_index(index_of(picked), "test")


def test_picked_tiles_are_texts() -> None:
    """The same as in the viewer's tests."""
    gains = [[(2, 65536 / 2), (0, 65536 / 8)], [], [(1, 65536 * 2.0 ** (-255 / 4))]]
    assert pack_picks(gains) == ("%#$", "%#$", "'+\u0122")


def test_picks_of_older_worlds_are_read() -> None:
    entry = decode_index(index_of(picks=((2, 4, 0, 8),) * 26), "test").cells[0]
    assert entry.picks_from(25) == [(2, 32768.0), (0, 8192.0)]
    assert entry.directions_from(25) == [1, 0]


@pytest.mark.parametrize(
    "picks", [(0,), (16, 0), (0, 256), (0, 1, 0, 1)], ids=["half a pair", "no such tile", "too far down", "twice"]
)
def test_picks_that_cannot_be_are_damage(picks: tuple[int, ...]) -> None:
    with pytest.raises(CorruptTileError):
        decode_index(index_of(picks=(picks,) * 26), "test")
