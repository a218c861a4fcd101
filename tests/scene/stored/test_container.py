"""Scene chunks come back as they were, and nothing but a whole one is read."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk

CHUNK = SceneChunk(
    "mesh",
    {"name": "pan", "count": 3},
    {
        "positions": np.arange(12.0).reshape(4, 3),
        "triangles": np.array([[0, 1, 2]], np.uint32),
        "colors": np.array([[1, 2, 3]], np.uint8),
        "none": np.empty((0, 2), np.float32),
    },
)


def test_a_chunk_comes_back() -> None:
    read = decode_chunk(encode_chunk(CHUNK), "mesh")
    assert read.about == CHUNK.about
    assert list(read.arrays) == list(CHUNK.arrays)
    for name, array in CHUNK.arrays.items():
        assert read.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(read.arrays[name], array)
    assert encode_chunk(read) == encode_chunk(CHUNK)


def test_another_kind_is_refused() -> None:
    with pytest.raises(CorruptTileError, match="holds 'mesh', not 'footprints'"):
        decode_chunk(encode_chunk(CHUNK), "footprints", "record/chunk/0")


def test_objects_are_no_numbers() -> None:
    with pytest.raises(ValueError, match="names is of object"):
        encode_chunk(SceneChunk("mesh", {}, {"names": np.array(["a"], object)}))


@given(st.integers(0, 8 * len(encode_chunk(CHUNK)) - 1))
def test_any_flipped_bit_is_noticed(bit: int) -> None:
    data = bytearray(encode_chunk(CHUNK))
    data[bit // 8] ^= 1 << bit % 8
    with pytest.raises(CorruptTileError):
        decode_chunk(bytes(data), "mesh")


@given(st.integers(0, len(encode_chunk(CHUNK)) - 1))
def test_any_cut_is_noticed(length: int) -> None:
    with pytest.raises(CorruptTileError):
        decode_chunk(encode_chunk(CHUNK)[:length], "mesh")
