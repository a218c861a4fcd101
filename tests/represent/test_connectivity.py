"""Connectivity against its plain twin, and on surfaces whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from farfield.geometry import normals
from farfield.kernels import connect
from farfield.represent.orthoview.connectivity import Connection, mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from represent import plain_connect
from represent.random_layers import random_layer


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(1, 7), st.sampled_from([0, 10, 40]),
    st.sampled_from([Connection(), Connection(2.0, 0.9, -0.3, 3)]),
)  # fmt: skip
def test_twin(seed: int, height: int, width: int, spread: int, connection: Connection) -> None:
    layer = random_layer(seed, height, width, 0.8, spread)
    expected, closest = plain_connect.connected(layer, connection)
    assume(closest > 1e-5)
    flags = layer.connected.copy()
    mark_connected(layer, connection)
    np.testing.assert_array_equal(layer.connected & 1, expected)
    np.testing.assert_array_equal(layer.connected & 2, flags & 2)


def _sphere(radius: float, size: int = 64) -> OrthoLayer:
    y, x = np.mgrid[0:size, 0:size] + 0.5 - size / 2
    height = np.sqrt(np.maximum(radius * radius - x * x - y * y, 0))
    inside = height > 0.35 * radius
    normal = np.stack([x, y, height], -1) / radius
    blank = random_layer(0, size, size, 1.0)
    depth = np.where(inside, (radius - height) * 8 + 1, 0).astype(np.uint16)
    return replace(blank, depth=depth, normal=normals.encode(normal), connected=np.zeros(depth.shape, np.uint8))


def test_a_sphere_is_connected_inside() -> None:
    layer = _sphere(28)
    mark_connected(layer)
    inner = layer.valid.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(inner, step, axis)
    assert layer.connected[inner].all()
    assert not layer.connected[~layer.valid].any()


def test_loose_leaves_are_not_connected() -> None:
    layer = random_layer(1, 64, 64, 1.0, 4000)
    mark_connected(layer)
    assert (layer.connected & 1).mean() < 0.01


def test_closures_are_closed() -> None:
    for bits in range(64):
        closed = connect.CLOSURES[bits]
        assert closed & bits == bits
        assert connect.CLOSURES[closed] == closed


def test_read_only_flags_are_refused() -> None:
    layer = random_layer(1, 4, 4)
    layer.connected.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        mark_connected(layer)
