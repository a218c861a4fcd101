"""The order of a leaf's triangles is decided by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.geometry.morton import codes_along
from farfield.kernels import order
from farfield.represent.chunk import Chunk, fingerprint, ordered


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


@given(st.integers(1, 40), st.integers(0, 1000))
def test_codes_are_those_of_the_middles(count: int, seed: int) -> None:
    corners = np.random.default_rng(seed).normal(0, 30, (count, 3, 3)).astype(np.float32)
    chunk, codes = chunk_of(corners), np.empty(count, np.uint64)
    order.curve_codes(chunk.positions, chunk.triangles, codes)
    np.testing.assert_array_equal(codes, codes_along(corners.astype(np.float64).sum(1)))


def painted(seed: int) -> Chunk:
    """Fifty triangles with everything that a corner can have."""
    r = np.random.default_rng(seed)
    chunk = chunk_of(r.normal(size=(50, 3, 3)).astype(np.float32))
    return replace(
        chunk,
        normals=r.normal(size=(150, 3)).astype(np.float32),
        uvs=r.random((150, 2), np.float32),
        colors=r.integers(0, 256, (150, 4), np.uint8),
    )


def test_a_fingerprint_is_of_corners_not_of_vertices() -> None:
    chunk = painted(3)
    turn = np.random.default_rng(1).permutation(150)
    places = np.argsort(turn).astype(np.uint32)
    other = replace(
        chunk,
        **{name: getattr(chunk, name)[turn] for name in ("positions", "normals", "uvs", "colors")},
        triangles=places[chunk.triangles],
    )
    assert fingerprint(other) == fingerprint(chunk)


@pytest.mark.parametrize("name", ["positions", "normals", "uvs", "colors", "triangles", "materials", "objects"])
def test_a_fingerprint_changes_with_anything_that_is_drawn(name: str) -> None:
    chunk = painted(3)
    found = {fingerprint(chunk)}
    array = getattr(chunk, name)
    for place in np.ndindex(array.shape):
        changed = array.copy()
        # In the last bit; of a triangle, another corner.
        words = changed.view(np.uint32) if changed.dtype == np.float32 else changed
        words[place] ^= 1
        found.add(fingerprint(replace(chunk, **{name: changed})))
    assert len(found) == 1 + array.size
