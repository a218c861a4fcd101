"""Compositing against brute force, and what it must keep on the way up."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from benchmarks.layers import canopy
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.geometry import normals
from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.represent.orthoview import parent
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.parent import BAYER, composite
from represent import plain_composite
from represent.random_layers import layers, random_layer

LIGHTS = np.radians([35, 60, 80])
"""Lights off the axis of the view, radians."""


def _stack(seed: int, x: int, y: int, count: int, spread: int, objects: bool) -> list[OrthoLayer]:
    """Layers of one cell, the second behind the first."""
    made = [random_layer(seed + k, 5, 6, 0.7, spread, objects, x, y) for k in range(count)]
    return [replace(a, depth_base=-2000 + k * (spread + 400)) for k, a in enumerate(made)]


@settings(max_examples=80, deadline=None)
@given(st.data(), st.sampled_from([1, 2]), st.sampled_from([0, 60, 300]), st.booleans())
def test_twin(data: st.DataObject, count: int, spread: int, objects: bool) -> None:
    places = st.tuples(st.integers(0, 2**32), st.integers(-7, 2), st.integers(-7, 2), st.integers(1, 2))
    children = [_stack(*data.draw(places), spread, objects) for _ in range(data.draw(st.integers(1, 4)))]
    expected = plain_composite.composite(children, count)
    made = [plain_composite.planes(layer) for layer in composite(children, count)]
    found = {at: [layer[at] for layer in made if at in layer] for at in expected}
    for at, surfaces in expected.items():
        assert found[at] == surfaces, at
    assert sum(map(len, made)) == sum(map(len, expected.values()))


@given(layers())
def test_a_band_at_a_time_makes_no_difference(layer: OrthoLayer) -> None:
    whole = composite([[layer]], 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parent, "BAND_BYTES", 1)
        pieces = composite([[layer]], 2)
    assert len(whole) == len(pieces)
    for a, b in zip(whole, pieces, strict=True):
        for field in fields(OrthoLayer):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), field.name)


def test_dither_is_bayers() -> None:
    assert BAYER.tolist() == [[plain_composite.bayer(j, i) for i in range(8)] for j in range(8)]
    assert sorted(BAYER.ravel()) == list(range(64))


def test_nothing_gives_nothing() -> None:
    assert composite([], 2) == []
    assert composite([[], []], 2) == []


def test_every_byte_of_colour_stays_itself() -> None:
    """A flat colour must not drift on the way up."""
    np.testing.assert_array_equal(BYTE_OF_LINEAR[(LINEAR_OF_BYTE * np.float64(4095) + 0.5).astype(int)], np.arange(256))


def test_a_flat_wall_stays_whole() -> None:
    wall = random_layer(0, 32, 32, 1.0, 0)
    full = replace(
        wall, coverage=np.full((32, 32), 16, np.uint8), length=np.full((32, 32), 8, np.uint8),
        color=np.full((32, 32, 3), 77, np.uint8), normal=np.full((32, 32, 2), [40, 20], np.uint8),
    )  # fmt: skip
    for _ in range(4):
        (full,) = composite([[full]], 2)
        assert (full.coverage == 16).all()
        assert (full.length == 8).all()
        assert (full.color == 77).all()
        assert (full.normal == [40, 20]).all()


def test_a_wall_across_a_cell_plane_adds_up() -> None:
    """Half of each pixel from either cell makes whole pixels, not three quarters."""
    wall = replace(random_layer(0, 8, 8, 1.0, 0), coverage=np.full((8, 8), 8, np.uint8))
    (whole,) = composite([[wall], [wall]], 2)
    assert (whole.coverage == 16).all()


def test_two_layers_of_one_cell_are_independent() -> None:
    half = replace(random_layer(0, 8, 8, 1.0, 0), coverage=np.full((8, 8), 8, np.uint8))
    behind = replace(half, depth_base=half.depth_base + 40)
    (whole,) = composite([[half, behind]], 2)
    assert (whole.coverage == 12).all()


def test_depths_beyond_sixteen_bits_are_refused() -> None:
    layer = random_layer(0, 4, 4, 1.0, 0)
    far = replace(layer, x=layer.x + 8, depth_base=layer.depth_base + 300000)
    with pytest.raises(ValueError, match="65535"):
        composite([[layer], [far]], 2)


def _open(stack: list[OrthoLayer], size: int, weight: str = "") -> NDArray[np.float64]:
    """What layers add to a size x size view seen along its direction, blended; [] = coverage, else mean of a value."""
    through = np.ones((size, size))
    total = np.zeros((size, size, 3))
    for layer in stack:
        window = (slice(layer.y, layer.y + layer.shape[0]), slice(layer.x, layer.x + layer.shape[1]))
        seen = through[window] * layer.coverage / 16
        through[window] -= seen
        total[window] += seen[..., None] * _value(layer, weight)
    return total


def _value(layer: OrthoLayer, weight: str) -> NDArray[np.float64]:
    """(h, w, 3): 1, linear colour, the normal times its length, or the mean Lambert cosine for LIGHTS.

    Leaves turned towards the camera fill a hemisphere, length 1/2, whose mean cosine is (1 + cos t) / 4 for a light t
    off its axis: what 0.5 (m + sqrt(m^2 + (1 - l^2) sin^2 t / 3)) gives, with m = l cos t. A constant 1/4 in place of
    sin^2 t / 3 ends 10 % too bright at 35 degrees; this is 5 % off at most, at the first parents.
    """
    if not weight:
        return np.ones((*layer.shape, 3))
    if weight == "color":
        return LINEAR_OF_BYTE[layer.color].astype(float)
    length = layer.length[..., None] / 8
    if weight == "normal":
        return normals.decode(layer.normal) * length
    cosine = normals.decode(layer.normal) @ np.stack([np.sin(LIGHTS), 0 * LIGHTS, np.cos(LIGHTS)])
    mu = length * cosine
    return 0.5 * (mu + np.sqrt(mu * mu + (1 - length * length) * (1 - cosine * cosine) / 3))


def _pyramid(stack: list[OrthoLayer], size: int, levels: int) -> list[tuple[list[OrthoLayer], int]]:
    """The views of 4 levels up from four copies of one leaf view side by side."""
    side = [[replace(a, x=a.x + size * (k & 1), y=a.y + size * (k >> 1)) for a in stack] for k in range(4)]
    found, children, size = [], side, 2 * size
    for _ in range(levels):
        size //= 2
        made = composite(children, 2)
        found.append((made, size))
        children = [made]
    return found


@pytest.mark.parametrize(("cover", "slab"), [(0.05, 3), (0.3, 3), (0.3, 16), (0.3, 64), (0.6, 24)])
def test_a_canopy_stays_as_open_as_it_is(cover: float, slab: float) -> None:
    """Share covered, mean colour and mean normal of what is covered, over four levels; and its shading."""
    size = 160
    leaf = canopy(cover, slab, size)
    kinds = ("", "color", "normal")
    start = {w: _open(leaf, size, w).mean((0, 1)) for w in kinds}
    if cover == 0.3 and slab < 10:
        assert start[""][0] == pytest.approx(0.3, abs=0.015)
    for made, side in _pyramid(leaf, size, 4):
        now = {w: _open(made, side, w).mean((0, 1)) for w in (*kinds, "light")}
        assert now[""][0] == pytest.approx(start[""][0], abs=0.01 if slab < 4 else 0.03)
        for w in kinds[1:]:
            scale = abs(start[w] / start[""]).max()
            np.testing.assert_allclose(now[w] / now[""], start[w] / start[""], atol=0.03 * scale, err_msg=w)
        np.testing.assert_allclose(now["light"] / now[""], (1 + np.cos(LIGHTS)) / 4, rtol=0.06)


def test_ground_below_a_canopy_stays() -> None:
    size = 160
    leaf = canopy(0.4, 3, size, ground=200)
    assert _open(leaf, size).mean() > 0.99
    for made, side in _pyramid(leaf, size, 4):
        assert len(made) == 2
        assert _open(made, side).mean() > 0.98


def test_a_deep_canopy_does_not_swallow_what_is_below() -> None:
    """Keeping only the two nearest clusters left 23 of 74 % after one level."""
    size = 160
    leaf = canopy(0.3, 64, size, ground=200)
    start = _open(leaf, size).mean()
    for made, side in _pyramid(leaf, size, 4):
        assert _open(made, side).mean() > 0.9 * start
