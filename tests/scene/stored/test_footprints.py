"""Stored footprints: what they tell comes back, and those that tell no details are what they always were."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.scene.footprints.details import Details
from farfield.scene.footprints.features import Features
from farfield.scene.footprints.rings import Rings
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk
from farfield.scene.stored.footprints import KIND, decode_features, encode_features
from farfield.world.keys import content_hash


def features(details: Details | None = None) -> Features:
    """Two boxes."""
    box = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)])
    rings = Rings(np.concatenate([box, box + 20]), np.array([0, 4, 8]), np.arange(3), np.arange(2))
    own = details or Details()
    return Features(rings, np.array([0.0, 1.5]), np.array([9.0, 40.0]), np.array([7, 8], np.uint32), own)


def test_chunks_without_details_keep_their_hash() -> None:
    """Worlds that are there already know them by it."""
    zeros = Details(np.zeros(2), np.zeros((2, 4), np.uint8), np.zeros((2, 4), np.uint8))
    assert content_hash(encode_features(features())) == "ee6888e3eff2140b"
    assert encode_features(features(zeros)) == encode_features(features())


COLOR = st.tuples(*[st.integers(0, 255)] * 3, st.sampled_from([0, 255]))
DETAILS = st.builds(
    lambda lift, wall, roof: Details(
        None if lift is None else np.array(lift),
        None if wall is None else np.array(wall, np.uint8),
        None if roof is None else np.array(roof, np.uint8),
    ),
    *[st.none() | st.tuples(part, part) for part in (st.floats(0, 500), COLOR, COLOR)],
)


@given(DETAILS, DETAILS)
def test_details_come_back_alone_and_joined(one: Details, other: Details) -> None:
    data = encode_features(features(one))
    assert encode_features(decode_features(data)) == data
    both = Features.joined([decode_features(data), features(other)])
    for first, details in ((0, one), (2, other)):
        rows = np.arange(first, first + 2)
        assert encode_features(both.of(rows)) == encode_features(features(details))
    assert encode_features(decode_features(encode_features(both))) == encode_features(both)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("lift", np.zeros(3)), ("lift", np.array([0.0, np.nan])), ("lift", np.array([1, 2])),
        ("wall_color", np.zeros((2, 3), np.uint8)), ("roof_color", np.zeros((1, 4), np.uint8)), ("glow", np.zeros(2)),
    ],
)  # fmt: skip
def test_details_that_do_not_fit_are_refused(name: str, array: np.ndarray) -> None:
    arrays = decode_chunk(encode_features(features()), KIND).arrays
    with pytest.raises(CorruptTileError):
        decode_features(encode_chunk(SceneChunk(KIND, {}, arrays | {name: array})))
