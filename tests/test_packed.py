"""Packed values: what comes back, and what is refused, with a dictionary and without."""

from __future__ import annotations

import contextlib
import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.packed import pack, unpack
from farfield.represent.geometry.dictionary import DICTIONARY, parsed

MAGIC = b"TEST"
SPEC = Path(__file__).parents[1] / "spec/world.md"
LIKE_THE_DICTIONARY = st.integers(0, len(DICTIONARY) - 1).map(lambda start: DICTIONARY[start : start + 300])
PARTS = st.lists(st.binary(max_size=60) | LIKE_THE_DICTIONARY, min_size=1, max_size=4)
VALUE = pack(MAGIC, DICTIONARY[2000:2600], bytes(range(256)), dictionary=DICTIONARY)


def unpacked(value: bytes, dictionary: bytes = DICTIONARY, largest: int = 1 << 20) -> bytes:
    return unpack(value, MAGIC, largest, "a value", "test", dictionary=dictionary)


@given(PARTS, st.sampled_from([b"", DICTIONARY, b"{" * 40_000]))
def test_parts_come_back_as_one(parts: list[bytes], dictionary: bytes) -> None:
    value = pack(MAGIC, *parts, dictionary=dictionary)
    assert value[4] == 1 + bool(dictionary)
    assert unpacked(value, dictionary) == b"".join(parts)


def test_a_reader_with_a_dictionary_reads_values_without() -> None:
    assert unpacked(pack(MAGIC, b"content")) == b"content"


def test_what_the_dictionary_has_costs_next_to_nothing() -> None:
    assert len(pack(MAGIC, DICTIONARY[1000:3000], dictionary=DICTIONARY)) < 16 + 50


def test_version_2_is_unknown_to_kinds_without_a_dictionary() -> None:
    with pytest.raises(CorruptTileError, match="known version"):
        unpacked(VALUE, b"")
    for version in (0, 3):
        with pytest.raises(CorruptTileError, match="known version"):
            unpacked(VALUE[:4] + bytes([version]) + VALUE[5:])


@pytest.mark.parametrize("dictionary", [DICTIONARY[:-1], DICTIONARY[-1000:], b" "])
def test_another_dictionary_is_damage(dictionary: bytes) -> None:
    with pytest.raises(CorruptTileError, match="damaged"):
        unpacked(VALUE, dictionary)


@given(st.integers(0, 8 * len(VALUE) - 1))
def test_a_changed_bit_is_refused_or_says_nothing(bit: int) -> None:
    changed = bytearray(VALUE)
    changed[bit // 8] ^= 1 << bit % 8
    with contextlib.suppress(CorruptTileError):
        assert unpacked(bytes(changed)) == unpacked(VALUE)


@given(st.integers(0, len(VALUE) - 1), st.binary(max_size=40))
def test_values_that_are_cut_short_or_go_on_otherwise(end: int, tail: bytes) -> None:
    if VALUE[:end] + tail != VALUE:
        with pytest.raises(CorruptTileError):
            unpacked(VALUE[:end] + tail)


@pytest.mark.parametrize("told", [0, 599, 601, 1 << 20, (1 << 20) + 1, 2**32 - 1])
def test_lengths_that_are_not_those_of_the_content(told: int) -> None:
    with pytest.raises(CorruptTileError):
        unpacked(VALUE[:8] + struct.pack("<I", told) + VALUE[12:])


def test_the_dictionary_is_that_of_the_specification() -> None:
    told = f"{len(DICTIONARY):,} bytes with the CRC-32 `{zlib.crc32(DICTIONARY):08x}`"
    assert told in SPEC.read_text(encoding="utf-8"), "values that were packed with another could not be read any more"


def test_how_a_dictionary_is_written() -> None:
    assert parsed('# a comment\n{"a\n":\\x00\\xff#}\n\n# another\n\\x20') == b'{"a":\0\xff#} '
