"""Mip levels keep what they average."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.represent.materials import LEVELS, MaterialTable, TexturePool, mip_levels
from farfield.scene.model import Material, Texture


@pytest.mark.parametrize("shape", [(64, 64), (37, 21), (1, 9), (5, 1), (1, 1), (128, 3)])
def test_levels_halve_and_keep_the_mean_of_linear_light(shape: tuple[int, int]) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (*shape, 4), dtype=np.uint8)
    levels = mip_levels(pixels, masked=False)
    sizes = [level.shape[:2] for level in levels]
    assert sizes[0] == shape
    assert sizes[-1] == (1, 1)
    assert all(b == (max(1, a[0] // 2), max(1, a[1] // 2)) for a, b in pairwise(sizes))
    np.testing.assert_array_equal(levels[0], pixels)
    mean = LINEAR_OF_BYTE[pixels[..., :3]].mean((0, 1))
    np.testing.assert_allclose(LINEAR_OF_BYTE[levels[-1][0, 0, :3]], mean, atol=0.006)


def test_the_background_of_a_mask_does_not_bleed() -> None:
    pixels = np.zeros((33, 47, 4), dtype=np.uint8)
    pixels[..., 0] = 255
    leaf = np.random.default_rng(2).random((33, 47)) < 0.15
    pixels[leaf] = [0, 200, 0, 255]
    for level in mip_levels(pixels, masked=True):
        assert np.abs(level[..., :3].astype(int) - [0, 200, 0]).max() <= 1
    cover = [float(level[..., 3].mean()) / 255 for level in mip_levels(pixels, masked=True)]
    np.testing.assert_allclose(cover, leaf.mean(), atol=0.01)


def test_textures_are_pooled_once_for_each_use() -> None:
    texture = Texture(np.full((16, 8, 4), 200, dtype=np.uint8))
    pool = TexturePool()
    materials = [
        Material(texture=texture),
        Material(texture=texture, alpha_cutoff=0.5),
        Material(texture=texture, unlit=True),
    ]
    table = MaterialTable.build(materials, pool)
    assert table.arrays.texture.tolist() == [0, 1, 0]
    assert table.arrays.cutoff.tolist() == [-1.0, 0.5, -1.0]
    assert table.arrays.size.tolist() == [[8, 16, 5]] * 2
    assert table.arrays.level.shape == (2, LEVELS)
    assert len(table.arrays.pixels) == 2 * (128 + 32 + 8 + 2 + 1)
    again = MaterialTable.build([*materials, Material(texture=texture)], pool)
    assert len(again.arrays.pixels) == len(table.arrays.pixels)
    assert len(MaterialTable.build([])) == 0
