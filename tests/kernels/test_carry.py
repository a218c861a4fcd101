"""Colours carried over against the plain twin, and what they are taken from."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.kernels.carry import cover
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.hlod import ColoredSurface, group_of
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Texture
from kernels.plain_carry import plain_color, plain_cover, plain_nearest

TABLE = MaterialTable.build(
    [Material(base_color=(0.8, 0.4, 0.2, 1)), Material(base_color=(0.1, 0.6, 0.9, 1), unlit=True)]
)


def soup(count: int, seed: int) -> Chunk:
    """Triangles here and there in a cube of 1 m, of two materials, with colours."""
    random = np.random.default_rng(seed)
    middle = random.uniform(0, 1, (count, 1, 3))
    positions = (middle + random.normal(scale=0.1, size=(count, 3, 3))).reshape(-1, 3).astype(np.float32)
    return Chunk(
        positions,
        np.tile(np.array([0, 0, 1], np.float32), (len(positions), 1)),
        np.empty((0, 2), np.float32),
        random.integers(0, 256, (len(positions), 4)).astype(np.uint8),
        np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
        np.concatenate([[0, 1], random.integers(0, 2, count - 2)]).astype(np.uint32),
        np.zeros(count, np.uint32),
    )


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 60), st.integers(0, 10**6), st.sampled_from([0.0, 0.01, 1.0]))
def test_as_the_plain_twin(count: int, seed: int, penalty: float) -> None:
    chunk, random = soup(count, seed), np.random.default_rng(seed + 1)
    surface = ColoredSurface.of(chunk, TABLE)
    # Along a line, as texels are, and far away.
    points = np.concatenate([np.linspace([0, 0.2, 0.1], [1, 0.9, 0.8], 40), random.uniform(-3, 4, (10, 3))])
    toward = random.normal(size=points.shape)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    wanted = random.integers(0, 2, len(points)).astype(np.uint8)
    groups = group_of(TABLE)
    own = groups[chunk.materials]
    wanted = np.where(wanted, *(np.uint8(g) for g in groups)).astype(np.uint8)
    colors, found = surface.colors_at(points, toward, wanted, np.full(len(points), 0.1), penalty**0.5)
    for n, point in enumerate(points):
        near = plain_nearest(chunk, own, point, toward[n], int(wanted[n]), penalty)
        if found[n] != near.triangle:  # One as near.
            other = _only(chunk, int(found[n]))
            alone = plain_nearest(other, groups[other.materials], point, toward[n], int(wanted[n]), penalty)
            assert np.isclose(alone.squared, near.squared, rtol=1e-6, atol=1e-12)
            continue
        np.testing.assert_allclose(colors[n], plain_color(chunk, TABLE, near), atol=1e-4)


def _only(chunk: Chunk, triangle: int) -> Chunk:
    rows = slice(triangle, triangle + 1)
    return Chunk(
        chunk.positions, chunk.normals, chunk.uvs, chunk.colors, chunk.triangles[rows], chunk.materials[rows],
        chunk.objects[rows],
    )  # fmt: skip


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(*[st.integers(-8, 40)] * 6), min_size=1, max_size=6))
def test_samples_are_covered_as_by_the_plain_twin(quarters: list[tuple[int, ...]]) -> None:
    corners = np.array(quarters, np.float64) / 4
    ids = np.full((7, 8), -1, np.int32)
    cover(corners, ids)
    np.testing.assert_array_equal(ids, plain_cover(corners, 7, 8))


def test_a_thin_wall_shows_each_side_its_own() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    positions = np.concatenate([square, square + np.float32([0, 0, 0.01])])
    triangles = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]], np.uint32)
    normals = np.repeat(np.array([[0, 0, -1], [0, 0, 1]], np.float32), 4, axis=0)
    none = np.empty((0, 2), np.float32), np.empty((0, 4), np.uint8)
    chunk = Chunk(positions, normals, *none, triangles, np.array([0, 0, 1, 1], np.uint32), np.zeros(4, np.uint32))
    table = MaterialTable.build([Material(base_color=(1, 0, 0, 1)), Material(base_color=(0, 0, 1, 1))])
    surface = ColoredSurface.of(chunk, table)
    # Both a little on the wrong side.
    points, toward = np.array([[0.3, 0.4, 0.02], [0.3, 0.4, -0.01]]), np.array([[0, 0, -1.0], [0, 0, 1.0]])
    group = np.full(2, group_of(table)[0])
    colors, _ = surface.colors_at(points, toward, group, np.full(2, 0.1), 1.0)
    np.testing.assert_allclose(colors, [[1, 0, 0], [0, 0, 1]])


def test_of_an_image_as_much_is_averaged_as_is_asked_for() -> None:
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[:, ::2, :3] = 0
    table = MaterialTable.build([Material(texture=Texture(pixels))])
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    chunk = Chunk(
        square,
        np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
        square[:, :2].copy(),
        np.empty((0, 4), np.uint8),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        np.zeros(2, np.uint32),
        np.zeros(2, np.uint32),
    )
    surface = ColoredSurface.of(chunk, table)
    np.testing.assert_allclose(surface.density, 64)
    points = np.column_stack([(np.arange(16) + 0.5) / 64, np.full(16, 0.5), np.zeros(16)])
    toward, group = np.tile([0, 0, 1.0], (16, 1)), np.full(16, group_of(table)[0])
    fine, _ = surface.colors_at(points, toward, group, np.full(16, 1 / 64), 1.0)
    coarse, _ = surface.colors_at(points, toward, group, np.full(16, 4 / 64), 1.0)
    np.testing.assert_allclose(fine[:, 0], np.arange(16) % 2, atol=1e-6)
    np.testing.assert_allclose(coarse, 0.5, atol=0.01)
