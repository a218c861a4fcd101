"""Walls of coarser BlockMaps from finer ones as the plain twin gathers them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.kernels.regather import gather_walls
from kernels.plain_regather import FineMaps, gathered

N, M = 4, 12
"""Texels a side, and columns of the image of walls."""
ROWS = np.array([0, 0, 1, 2, 4])
"""Of walls; 0: there is none."""


def random_walls(random: np.random.Generator, maps: int, across: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """(maps, 4 n n, 3) places and (maps, 4 n n, 2) ends, which are often just as high as those of others."""
    rows = random.choice(ROWS, (maps, 4 * N * N))
    first = random.integers(0, M - across + 1, rows.shape)
    lower = random.integers(0, 24, rows.shape) / 4
    ends = np.stack([lower + random.integers(0, 24, rows.shape) / 4, lower], axis=-1)
    return np.stack([first, random.integers(0, N - rows + 1), rows], axis=-1).astype(np.int32), ends.astype(np.float32)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([1, 2]), st.sampled_from([1, 2]), st.integers(1, 2), st.integers(1, 4))
def test_walls_are_those_of_the_plain_twin(seed: int, wide: int, deep: int, layers: int, across: int) -> None:
    random = np.random.default_rng(seed)
    maps, fine_across = layers * wide * deep, int(random.integers(1, 4))
    source = random.permutation(maps).reshape(layers, deep, wide).astype(np.int32)
    source[random.random(source.shape) < 0.2] = -1
    angles = random.uniform(0, 2 * np.pi, (maps, 4 * N * N)).astype(np.float32)
    fine = FineMaps(
        source,
        *random_walls(random, maps, fine_across),
        random.integers(0, 256, (maps, N, N + M, 3)).astype(np.uint8),
        np.stack([np.cos(angles), np.sin(angles)], axis=-1),
        random.integers(1, fine_across + 1, maps).astype(np.int32),
    )
    (places,), (ends,) = random_walls(random, 1, across)
    sides = np.flatnonzero(places[:, 2]).astype(np.int32)
    sums, normals = np.zeros((N, M, 4), np.float32), np.zeros((4 * N * N, 3), np.float32)
    gather_walls(*fine, wide, deep, sides, places, ends, across, sums, normals)
    plain_sums, plain_normals = gathered(fine, wide, deep, sides, places, ends, across)
    np.testing.assert_allclose(sums, plain_sums, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(normals[:, :2], plain_normals, atol=1e-4)
    assert not normals[:, 2].any()


def test_a_wall_where_no_finer_one_faces_that_way_has_the_colour_of_others_and_no_normal_of_theirs() -> None:
    south = 4 * 1 + 2
    fine_places, fine_ends = np.zeros((1, 4 * N * N, 3), np.int32), np.zeros((1, 4 * N * N, 2), np.float32)
    # Of the texel's western side alone.
    fine_places[0, south - 2] = 5, 0, N
    fine_ends[0, south - 2] = 8, 0
    colors = np.zeros((1, N, N + M, 3), np.uint8)
    colors[:, :, N + 5] = 255, 0, 0
    azimuths = np.tile(np.array([-1, 0], np.float32), (1, 4 * N * N, 1))
    fine = FineMaps(np.zeros((1, 1, 1), np.int32), fine_places, fine_ends, colors, azimuths, np.ones(1, np.int32))
    places, ends = np.zeros((4 * N * N, 3), np.int32), np.zeros((4 * N * N, 2), np.float32)
    places[south], ends[south] = (3, 1, 2), (8, 0)
    sums, normals = np.zeros((N, M, 4), np.float32), np.zeros((4 * N * N, 3), np.float32)
    gather_walls(*fine, 1, 1, np.array([south], np.int32), places, ends, 1, sums, normals)
    np.testing.assert_allclose(sums[1:3, 3, :3] / sums[1:3, 3, 3:], [[1, 0, 0]] * 2, atol=1e-5)
    assert not normals.any()
