"""Samples to pixels, against the plain twin."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from farfield.geometry import normals
from farfield.geometry.directions import principal
from farfield.kernels.quantise import quantise
from farfield.kernels.rasterise import rasterise
from farfield.kernels.resolve import PLANES, resolve
from farfield.kernels.surface import FAR, NOTHING, Surface
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material
from kernels import plain_resolve

MATERIALS = MaterialTable.build([Material(base_color=(0.9, 0.4, 0.2, 1)), Material(unlit=True)]).arrays


def rough_sheet(seed: int, axes: NDArray[np.float32], width: int, height: int) -> tuple[NDArray[np.float32], Surface]:
    """A crumpled, torn sheet of triangles with colours, and where its corners fall on the screen."""
    generator = np.random.default_rng(seed)
    step = generator.uniform(1.3, 6)
    columns, rows = int(width / step) + 2, int(height / step) + 2
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2) * step
    grid += generator.normal(0, 0.3, grid.shape)
    screen = np.ones((len(grid), 4), dtype=np.float32)
    screen[:, :2] = np.round(grid * 256) / 256
    screen[:, 2] = generator.uniform(0, 9, len(grid))
    corner = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (k.ravel() for k in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([d, b, c], 1)]).astype(np.uint32)
    triangles = triangles[generator.random(len(triangles)) < 0.8]
    up = np.where(seed % 2, axes[2], -axes[2]) + generator.normal(0, 0.02, (len(grid), 3))
    surface = Surface(
        (screen[:, :3] @ axes).astype(np.float32),
        (up / np.linalg.norm(up, axis=1, keepdims=True)).astype(np.float32),
        np.empty((0, 2), dtype=np.float32),
        generator.integers(0, 256, (len(grid), 4), dtype=np.uint8),
        triangles,
        generator.integers(0, 2, len(triangles), dtype=np.uint32),
        generator.integers(1, 99, len(triangles), dtype=np.uint32),
    )
    return screen, surface


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_pixels_are_those_of_the_plain_twin(samples: int, seed: int) -> None:
    axes = principal(seed * 5).axes.astype(np.float32)
    shape = (14 * samples, 17 * samples)
    screen, surface = rough_sheet(seed, axes, shape[1], shape[0])
    depth, ids = np.full(shape, FAR, dtype=np.float32), np.full(shape, NOTHING, dtype=np.uint32)
    unlimited = np.empty((0, 0), dtype=np.float32)
    rasterise(screen, surface, MATERIALS, unlimited, np.empty(0, dtype=np.uint32), unlimited, depth, ids)
    pixels = np.empty((14, 17, PLANES), dtype=np.float32)
    objects = np.empty((14, 17), dtype=np.uint32)
    behind = np.zeros((shape[0], shape[1] + 8), dtype=np.float32)
    valid = resolve(screen, surface, MATERIALS, axes, samples, 4.0, depth, ids, behind, pixels, objects)
    expected = plain_resolve.resolve(screen, surface, MATERIALS, axes, samples, 4.0, depth, ids)
    assert valid == (expected[..., 0] < FAR).sum()
    np.testing.assert_allclose(pixels, expected, rtol=1e-4, atol=2e-3)
    blocks = depth.reshape(14, samples, 17, samples).transpose(0, 2, 1, 3).reshape(14, 17, -1)
    names = ids.reshape(14, samples, 17, samples).transpose(0, 2, 1, 3).reshape(14, 17, -1)
    nearest = np.take_along_axis(names, blocks.argmin(-1)[..., None], -1)[..., 0]
    named = np.where(nearest == NOTHING, 0, surface.objects[np.minimum(nearest, len(surface.objects) - 1)])
    np.testing.assert_array_equal(objects, named)
    limit = np.where(blocks.min(-1) < FAR, blocks.min(-1) + np.float32(4.0), FAR)
    np.testing.assert_array_equal(behind[:, : shape[1]], limit.repeat(samples, 0).repeat(samples, 1))


def test_quantised_pixels_are_within_half_a_step() -> None:
    generator = np.random.default_rng(3)
    pixels = np.empty((40, 50, PLANES), dtype=np.float32)
    pixels[..., 0] = generator.uniform(-900, 900, (40, 50))
    pixels[..., 1] = generator.integers(1, 17, (40, 50)) / 16
    pixels[..., 2] = generator.random((40, 50))
    pixels[..., 3:6] = generator.random((40, 50, 3))
    direction = generator.normal(size=(40, 50, 3))
    direction[..., 2] = np.abs(direction[..., 2])
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    length = generator.uniform(0.1, 1, (40, 50, 1))
    pixels[..., 6:] = direction * length
    pixels[5, 6, 0] = FAR
    depth = np.empty((40, 50), dtype=np.int32)
    color, normal = np.empty((40, 50, 3), dtype=np.uint8), np.empty((40, 50, 2), dtype=np.uint8)
    lengths, coverage, flags = (np.empty((40, 50), dtype=np.uint8) for _ in range(3))
    quantise(pixels, 8, 16, 8, depth, color, normal, lengths, coverage, flags)
    there = np.ones((40, 50), dtype=bool)
    there[5, 6] = False
    assert coverage[5, 6] == 0
    np.testing.assert_allclose(depth[there] / 8, pixels[..., 0][there], atol=1 / 16 + 1e-4)
    np.testing.assert_array_equal(coverage[there], (pixels[..., 1][there] * 16).round())
    np.testing.assert_allclose(np.maximum(lengths[there] / 8, 0.125), length[there][:, 0], atol=1 / 16 + 1e-6)
    np.testing.assert_array_equal(flags[there] == 2, pixels[..., 2][there] > 0.5)
    cosine = (normals.decode(normal[there]) * direction[there]).sum(-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 3
    np.testing.assert_array_equal(normal[there], normals.encode(pixels[..., 6:][there] / length[there]))
