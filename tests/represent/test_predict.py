"""Prediction and filling kernels against their plain twins."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from farfield.kernels import fill, predict
from farfield.represent.orthoview.layer import OrthoLayer
from represent import plain_codec
from represent.random_layers import layers


@given(layers())
def test_depth(layer: OrthoLayer) -> None:
    count = np.count_nonzero(layer.depth)
    residuals, listed = np.empty((2, count), np.uint16)
    assert predict.depth_residuals(layer.depth, residuals) == count
    assert residuals.tolist() == plain_codec.depth_residuals(layer.depth)
    restored = np.zeros_like(layer.depth)
    assert predict.restore_depth(layer.valid, residuals, restored, listed) == 0
    np.testing.assert_array_equal(restored, layer.depth)
    np.testing.assert_array_equal(listed, layer.depth[layer.valid])


@given(layers())
def test_normals(layer: OrthoLayer) -> None:
    count = np.count_nonzero(layer.depth)
    residuals = np.empty((2, count), np.uint8)
    assert predict.normal_residuals(layer.depth, layer.normal, residuals[0], residuals[1]) == count
    for c in (0, 1):
        assert residuals[c].tolist() == plain_codec.normal_residuals(layer.depth, layer.normal[..., c])
    restored = np.zeros_like(layer.normal)
    predict.restore_normals(layer.depth, residuals[0], residuals[1], restored)
    np.testing.assert_array_equal(restored, layer.normal * layer.valid[..., None])


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 6))
def test_any_residuals_can_be_undone(seed: int, height: int, width: int) -> None:
    """Altered residuals give wrong pictures, never values out of range or reads out of bounds."""
    r = np.random.default_rng(seed)
    mask = r.integers(0, 2, (height, width)).astype(bool)
    count = int(mask.sum())
    depth = np.zeros(mask.shape, np.uint16)
    noise = r.integers(0, 256, (2, count), dtype=np.uint8)
    residuals = r.integers(0, 65536, count, dtype=np.uint16)
    zeros = predict.restore_depth(mask, residuals, depth, np.empty(count, np.uint16))
    assert zeros == np.count_nonzero(mask) - np.count_nonzero(depth)
    normal = np.zeros((height, width, 2), np.uint8)
    valid = np.count_nonzero(depth)
    predict.restore_normals(depth, noise[0, :valid].copy(), noise[1, :valid].copy(), normal)
    assert normal.max(initial=0) < 64


@given(layers(20))
def test_filling(layer: OrthoLayer) -> None:
    filled = fill.fill_invalid(layer.color, layer.valid)
    np.testing.assert_array_equal(filled, plain_codec.filled(layer.color, layer.valid))
    np.testing.assert_array_equal(filled[layer.valid], layer.color[layer.valid])


def test_filling_nothing_and_everything() -> None:
    color = np.full((5, 7, 3), 9, np.uint8)
    assert not fill.fill_invalid(color, np.zeros((5, 7), bool)).any()
    np.testing.assert_array_equal(fill.fill_invalid(color, np.ones((5, 7), bool)), color)


def test_filling_continues_a_constant() -> None:
    color = np.zeros((33, 18, 3), np.uint8)
    color[20, 3] = 200
    valid = color.any(-1)
    assert (fill.fill_invalid(color, valid) == 200).all()
