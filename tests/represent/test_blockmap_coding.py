"""BlockMaps and their object ids as bytes: what comes back, and what is refused."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, OptionError
from farfield.represent.blockmap.blockmap import SIZES, BlockMap, BlockMapSize
from farfield.represent.blockmap.coding import (
    decode_blockmap,
    decode_objects,
    encode_blockmap,
    encode_objects,
    with_objects,
)
from fuzz.shells import deflated, sealed
from represent.random_maps import random_map

HEADER = 40


def smooth(blockmap: BlockMap) -> BlockMap:
    """With colours that a lossy picture keeps."""
    rows, columns = blockmap.colors.shape[:2]
    y, x = np.mgrid[:rows, :columns]
    return replace(blockmap, colors=np.stack([40 + y, 200 - x // 4, 90 + x // 8], axis=-1).astype(np.uint8))


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10**6), st.booleans(), st.booleans(), st.sampled_from([0.0, 0.5]), st.integers(0, 2),
    st.floats(-1e4, 1e4), st.floats(1e-3, 10),
)  # fmt: skip
def test_what_is_encoded_comes_back(
    seed: int, by_area: bool, sloped: bool, hanging: float, number: int, low: float, step: float
) -> None:
    low, step = float(np.float32(low)), float(np.float32(step))
    made = smooth(replace(random_map(seed, by_area, sloped, number, hanging=hanging), low=low, step=step))
    data = encode_blockmap(made, 90)
    found = decode_blockmap(data, "")
    for name in ("size", "low", "step", "least", "density", "scale", "by_area"):
        assert getattr(found, name) == getattr(made, name), name
    for name in ("codes", "slopes", "border", "turns", "floors"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name), name)
    assert found.colors.shape == made.colors.shape
    assert np.abs(found.colors.astype(int) - made.colors).max() < 16
    assert found.objects is None
    for part in ("sides", "places", "normal"):
        np.testing.assert_array_equal(getattr(found.unfolded, part), getattr(made.unfolded, part))
    np.testing.assert_array_equal(found.azimuths, made.azimuths)
    assert encode_blockmap(made, 90) == data


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.sampled_from([16, 32, 64]), st.sampled_from([1, 2, 300, 10**6]))
def test_object_ids_come_back(seed: int, side: int, kinds: int) -> None:
    random = np.random.default_rng(seed)
    ids = random.integers(0, 2**32, kinds)[random.integers(0, kinds, (side, side))].astype(np.uint32)
    data = encode_objects(ids)
    np.testing.assert_array_equal(decode_objects(data, ""), ids)
    assert encode_objects(ids) == data


@pytest.mark.parametrize("by_area", [False, True])
def test_every_bit_is_guarded(by_area: bool) -> None:
    made = random_map(1, by_area, True)
    for data, decode in (
        (encode_blockmap(made, 50), decode_blockmap),
        (encode_objects(objects_of(made)), decode_objects),
    ):
        for at in [*range(HEADER), *range(HEADER, len(data), 7)]:
            for bad in (data[:at], data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :]):
                with pytest.raises(CorruptTileError):
                    decode(bad, "")
        with pytest.raises(CorruptTileError):
            decode(data + b"\0", "")


def objects_of(blockmap: BlockMap) -> NDArray[np.uint32]:
    assert blockmap.objects is not None
    return blockmap.objects


SOUND = encode_blockmap(random_map(1, True, True), 50)


@pytest.mark.parametrize(
    ("at", "layout", "value"),
    [
        (0, "4s", b"FFBO"),
        (4, "H", 2),
        (6, "B", 17),
        (6, "B", 0),
        (7, "B", 4),
        (7, "B", 1),
        (8, "H", 192),
        (10, "B", 8),
        (11, "B", 0),
        (12, "H", 0),
        (12, "H", 65535),
        (14, "H", 1),
        (16, "f", float("nan")),
        (16, "f", float("inf")),
        (20, "f", 0.0),
        (20, "f", -1.0),
        (20, "f", float("nan")),
        (20, "f", 2e9),
        (24, "I", 0),
        (24, "I", 2**32 - 1),
        (28, "I", 0),
        (32, "I", 1),
    ],
)
def test_headers_that_tell_what_cannot_be(at: int, layout: str, value: object) -> None:
    part = struct.pack("<" + layout, value)
    bad = sealed(SOUND[:at] + part + SOUND[at + len(part) :])
    assert bad != SOUND
    with pytest.raises(CorruptTileError):
        decode_blockmap(bad, "")


def with_heights(content: bytes) -> bytes:
    """With another stream of heights and rim."""
    (length,) = struct.unpack_from("<I", SOUND, 24)
    stream = deflated(content)
    head = SOUND[:24] + struct.pack("<I", len(stream)) + SOUND[28:HEADER]
    return sealed(head + stream + SOUND[HEADER + length :])


def test_streams_that_hold_less_or_more_or_another_number_of_walls() -> None:
    (length,) = struct.unpack_from("<I", SOUND, 24)
    heights = zlib.decompress(SOUND[HEADER : HEADER + length], -15)
    assert with_heights(heights) == SOUND or decode_blockmap(with_heights(heights), "")
    for bad in (heights[:-1], heights + b"\0", b"", bytes(len(heights)), bytes([9]) * 256 + heights[256:]):
        with pytest.raises(CorruptTileError):
            decode_blockmap(with_heights(bad), "")


def test_object_ids_that_name_none_of_those_that_are_listed() -> None:
    ids = np.arange(256, dtype=np.uint32).reshape(16, 16)
    data = encode_objects(ids)
    for content in (
        ids.astype("<u4").tobytes() + bytes([255]) * 512,
        ids.astype("<u4").tobytes()[:-4] + bytes(512),
        bytes(1 << 16),
    ):
        body = deflated(content)
        checksum = zlib.crc32(data[:12] + bytes(4) + body)
        with pytest.raises(CorruptTileError):
            decode_objects(data[:12] + struct.pack("<I", checksum) + body, "")


def test_object_ids_of_a_blockmap_of_another_size() -> None:
    made = random_map(1, True, True)
    own = encode_objects(objects_of(made))
    np.testing.assert_array_equal(objects_of(with_objects(decode_blockmap(SOUND, ""), own, "")), made.objects)
    other = encode_objects(np.ones((32, 32), np.uint32))
    with pytest.raises(CorruptTileError, match="another BlockMap"):
        with_objects(made, other, "")


def test_sizes_are_those_of_the_paper_and_no_others() -> None:
    assert [BlockMapSize.parse(text) for text in ("16:64", "32:192", "64:256")] == list(SIZES)
    assert [str(size) for size in SIZES] == ["16:64", "32:192", "64:256"]
    for text in ("", "64", "64:192", "64:256:1", "a:b", "128:512"):
        with pytest.raises(OptionError):
            BlockMapSize.parse(text)
