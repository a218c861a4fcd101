"""The order of a leaf's triangles is decided by themselves."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.represent.chunk import Chunk, ordered


def chunk_of(triangles: np.ndarray) -> Chunk:
    """Of (m, 3, 3) corners, each triangle its own object."""
    count = len(triangles)
    return Chunk(
        triangles.reshape(-1, 3),
        np.zeros((3 * count, 3), np.float32),
        np.empty((0, 2), np.float32),
        np.empty((0, 4), np.uint8),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
        np.zeros(count, np.uint32),
        np.arange(count, dtype=np.uint32),
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 40), st.integers(0, 1000))
def test_whatever_order_they_come_in(count: int, seed: int) -> None:
    """Many of them in the same place: corners are a few whole numbers, in every order."""
    chance = np.random.default_rng(seed)
    triangles = np.unique(chance.integers(0, 2, (count, 3, 3)), axis=0).astype(np.float32)
    shuffled = triangles[chance.permutation(len(triangles))]
    one, other = (ordered(chunk_of(own)) for own in (triangles, shuffled))
    np.testing.assert_array_equal(one.positions[one.triangles], other.positions[other.triangles])
    np.testing.assert_array_equal(shuffled[other.objects], other.positions[other.triangles])


def test_neighbours_follow_each_other() -> None:
    corners = np.random.default_rng(1).random((2000, 1, 3), np.float32) + np.zeros((1, 3, 1), np.float32)
    found = ordered(chunk_of(corners))
    steps = np.linalg.norm(np.diff(found.positions[found.triangles][:, 0], axis=0), axis=1)
    assert np.median(steps) < 0.15
