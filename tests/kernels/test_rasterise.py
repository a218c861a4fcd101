"""The two rasterisers against each other and against the plain twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.kernels.lanes import LANES
from farfield.kernels.rasterise import TILE, rasterise
from farfield.kernels.rasterise_key import EMPTY, depth_of, key_of, rasterise_key, unpack_keys
from farfield.kernels.surface import FAR, NOTHING, Materials, Surface
from kernels import plain_raster
from kernels.surfaces import PLAIN, masked, surface_of

Buffers = tuple[NDArray[np.float32], NDArray[np.uint32]]
FLOATS = st.floats(-(2.0**127), 2.0**127, width=32)
UNLIMITED = np.empty((0, 0), dtype=np.float32)
AS_THEY_COME = np.empty(0, dtype=np.uint32)


def visibility(
    screen: NDArray[np.float32],
    surface: Surface,
    materials: Materials,
    size: tuple[int, int],
    behind: NDArray[np.float32],
) -> Buffers:
    depth, ids = np.full(size, FAR, dtype=np.float32), np.full(size, NOTHING, dtype=np.uint32)
    rasterise(screen, surface, materials, behind, AS_THEY_COME, UNLIMITED, depth, ids)
    return depth, ids


def sorted_visibility(
    screen: NDArray[np.float32],
    surface: Surface,
    materials: Materials,
    size: tuple[int, int],
    behind: NDArray[np.float32],
) -> Buffers:
    """Front to back, hidden triangles rejected by tiles."""
    depth, ids = np.full(size, FAR, dtype=np.float32), np.full(size, NOTHING, dtype=np.uint32)
    order = np.argsort(screen[:, 2][surface.triangles].min(1), kind="stable").astype(np.uint32)
    farthest = np.empty((-(-size[0] // TILE), -(-size[1] // TILE)), dtype=np.float32)
    rasterise(screen, surface, materials, behind, order, farthest, depth, ids)
    return depth, ids


def keyed(
    screen: NDArray[np.float32],
    surface: Surface,
    materials: Materials,
    size: tuple[int, int],
    behind: NDArray[np.float32],
) -> Buffers:
    keys = np.full((size[0], size[1] + LANES), EMPTY, dtype=np.int64)
    rasterise_key(screen, surface, materials, behind, AS_THEY_COME, keys)
    depth, ids = np.empty(size, dtype=np.float32), np.empty(size, dtype=np.uint32)
    unpack_keys(keys, depth, ids)
    return depth, ids


def soup(seed: int, count: int, extent: float, width: int, height: int) -> tuple[NDArray[np.float32], Surface]:
    """Random triangles about `extent` samples large, many of them with corners on samples, edges and each other."""
    generator = np.random.default_rng(seed)
    middle = generator.uniform(-5, [width + 5, height + 5], (count, 1, 2))
    xy = (middle + generator.normal(0, extent, (count, 3, 2))).reshape(-1, 2)
    coarse = generator.random(len(xy)) < 0.3
    xy = np.where(coarse[:, None], np.round(xy * 2) / 2, np.round(xy * 256) / 256)
    screen = np.ones((len(xy), 4), dtype=np.float32)
    screen[:, :2] = xy
    screen[:, 2] = generator.uniform(-50, 50, len(xy)).round(generator.integers(0, 3))
    uvs = generator.uniform(-2, 2, (len(xy), 2)).astype(np.float32)
    triangles = generator.permutation(len(xy)).astype(np.uint32).reshape(-1, 3)
    materials = (generator.random(count) < 0.3).astype(np.uint32)
    return screen, surface_of(triangles, len(xy), uvs, materials=materials)


@pytest.mark.parametrize("extent", [0.4, 2.0, 6.0, 60.0, 300.0])
@pytest.mark.parametrize("limited", [False, True])
def test_both_rasterisers_draw_the_same(extent: float, limited: bool) -> None:
    generator = np.random.default_rng(9)
    pixels = generator.integers(0, 256, (8, 8, 4), dtype=np.uint8)
    size = (90, 130)
    behind = generator.uniform(-60, 20, (size[0], size[1] + LANES)).astype(np.float32) if limited else UNLIMITED
    screen, surface = soup(int(extent * 10), 800, extent, size[1], size[0])
    one = visibility(screen, surface, masked(pixels), size, behind)
    other = keyed(screen, surface, masked(pixels), size, behind)
    third = sorted_visibility(screen, surface, masked(pixels), size, behind)
    assert np.array_equal(one[0], third[0])
    assert np.array_equal(one[1], third[1])
    np.testing.assert_array_equal(one[1], other[1])
    np.testing.assert_array_equal(one[0], other[0])
    assert (one[1] != NOTHING).sum() > 300


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.5, 2.0, 8.0, 90.0]), st.booleans())
def test_samples_and_depths_are_those_of_the_plain_twin(seed: int, extent: float, limited: bool) -> None:
    size = (9, 11)
    screen, surface = soup(seed, 12, extent, size[1], size[0])
    surface = surface._replace(materials=np.zeros_like(surface.materials))
    behind = np.full((size[0], size[1] + LANES), -7.25, dtype=np.float32) if limited else UNLIMITED
    depth, ids = visibility(screen, surface, PLAIN.arrays, size, behind)
    expected, names = plain_raster.rasterise(screen, surface.triangles, size[1], size[0], behind if limited else None)
    np.testing.assert_allclose(depth, expected, rtol=1e-5, atol=2e-4)
    # Another triangle may win only where depths are equal up to rounding; limits are judged up to rounding too.
    for y, x in zip(*np.nonzero(ids != names), strict=True):
        alone = surface._replace(
            triangles=surface.triangles[[ids[y, x], names[y, x]]], materials=np.zeros(2, dtype=np.uint32)
        )
        both = [plain_raster.rasterise(screen, alone.triangles[k : k + 1], size[1], size[0])[0][y, x] for k in range(2)]
        assert abs(both[0] - both[1]) < 1e-3


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from([3.0, 20.0, 200.0]), st.booleans())
def test_a_fan_covers_every_sample_once(seed: int, extent: float, on_samples: bool) -> None:
    """Triangles around a point, wound either way: samples on shared edges belong to exactly one."""
    generator = np.random.default_rng(seed)
    size = (40, 40)
    step = 0.5 if on_samples else 1 / 256
    angles = np.sort(generator.uniform(0, 2 * np.pi, 7)) + generator.uniform(0, 1)
    rim = 20 + extent * np.stack([np.cos(angles), np.sin(angles)], 1)
    points = np.round(np.concatenate([[[20.5, 19.5]], rim]) / step) * step
    spoke = points[1:] - points[0]
    if (np.cross(np.pad(spoke, ((0, 0), (0, 1))), np.pad(np.roll(spoke, -1, 0), ((0, 0), (0, 1))))[:, 2] <= 0).any():
        return
    fan = [[0, 1 + k, 1 + (k + 1) % 7][:: -1 if k % 2 else 1] for k in range(7)]
    counts = np.zeros(size, dtype=int)
    screen = np.ones((8, 4), dtype=np.float32)
    screen[:, :2] = points
    inside = np.zeros(size, dtype=bool)
    for triangle in fan:
        surface = surface_of(np.array([triangle], dtype=np.uint32), 8)
        for drawn in (
            visibility(screen, surface, PLAIN.arrays, size, UNLIMITED),
            keyed(screen, surface, PLAIN.arrays, size, UNLIMITED),
        ):
            counts += drawn[1] != NOTHING
        inside |= plain_raster.rasterise(screen, surface.triangles, 40, 40)[1] != NOTHING
    assert (counts[inside] == 2).all()
    assert (counts[~inside] == 0).all()


def test_equal_depths_go_to_the_lower_triangle() -> None:
    screen = np.array([[0, 0, 3, 1], [20, 0, 3, 1], [0, 20, 3, 1]], dtype=np.float32)
    surface = surface_of(np.array([[0, 1, 2], [2, 1, 0], [1, 2, 0]], dtype=np.uint32), 3)
    for draw in (visibility, keyed):
        _, ids = draw(screen, surface, PLAIN.arrays, (30, 30), UNLIMITED)
        assert set(np.unique(ids)) == {0, NOTHING}


def test_slivers_and_points_draw_nothing_and_break_nothing() -> None:
    screen = np.array(
        [[5, 5, 1, 1], [9, 5, 1, 1], [7, 5, 1, 1], [np.nan, 5, 1, 1], [1e30, 5, 1, 1], [-1e30, 9, 1, 1]],
        dtype=np.float32,
    )
    triangles = np.array([[0, 0, 0], [0, 1, 2], [0, 1, 3], [3, 3, 3], [0, 4, 5]], dtype=np.uint32)
    for draw in (visibility, keyed):
        _, ids = draw(screen, surface_of(triangles, 6), PLAIN.arrays, (12, 12), UNLIMITED)
        assert not np.isin(ids, [0, 1, 3]).any()


def test_a_mask_cuts_where_the_nearest_texel_has_no_alpha() -> None:
    pixels = np.zeros((4, 4, 4), dtype=np.uint8)
    pixels[1, 2, 3] = 255
    screen = np.array([[0, 0, 1, 1], [16, 0, 1, 1], [16, 16, 1, 1], [0, 16, 1, 1]], dtype=np.float32)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    surface = surface_of(
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32), 4, uvs, materials=np.ones(2, dtype=np.uint32)
    )
    expected = np.zeros((16, 16), dtype=bool)
    expected[4:8, 8:12] = True
    for draw in (visibility, keyed):
        _, ids = draw(screen, surface, masked(pixels), (16, 16), UNLIMITED)
        np.testing.assert_array_equal(ids != NOTHING, expected)


@settings(deadline=None)
@given(FLOATS, FLOATS, st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_keys_order_like_depth_and_triangle(z: float, y: float, a: int, b: int) -> None:
    one, other = key_of(np.float32(z), a), key_of(np.float32(y), b)
    assert (one < other) == ((z, a) < (y, b))
    assert depth_of(one) == np.float32(z)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([3.0, 12.0, 25.0]))
def test_a_mask_cuts_out_the_texels_it_should(seed: int, extent: float) -> None:
    """One triangle of an orthographic view: what is drawn of it are the samples whose texel is kept."""
    generator = np.random.default_rng(seed)
    pixels = generator.integers(0, 256, (5, 12, 4), dtype=np.uint8)
    size = (40, 50)
    screen, surface = soup(seed, 1, extent, size[1], size[0])
    screen[:, 3] = 1.0
    surface = surface._replace(materials=np.zeros_like(surface.materials))
    table = masked(pixels)
    _, solid = visibility(screen, surface, PLAIN.arrays, size, UNLIMITED)
    rows, columns = np.nonzero(solid != NOTHING)
    corners = surface.triangles[0]
    a, b, c = screen[corners, :2].astype(np.float64)
    points = np.stack([columns + 0.5, rows + 0.5], -1)
    weights = np.linalg.solve(np.array([b - a, c - a]).T, (points - a).T).T if len(points) else np.zeros((0, 2))
    uvs = surface.uvs[corners].astype(np.float64)
    texel = (uvs[0] + weights @ (uvs[1:] - uvs[0])) * [12, 5]
    clear = (np.abs(texel - np.round(texel)) > 1e-3).all(1)
    whole = np.floor(texel).astype(int)
    kept = pixels[whole[:, 1] % 5, whole[:, 0] % 12, 3] * np.float32(1 / 255) >= table.cutoff[0]
    for draw in (visibility, keyed):
        drawn = draw(screen, surface, table, size, UNLIMITED)[1][rows, columns] != NOTHING
        assert np.array_equal(drawn[clear], kept[clear])
