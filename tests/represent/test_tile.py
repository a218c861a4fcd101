"""Tiles and object tiles: what is written comes back, and only that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.layers import foliage
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import CorruptTileError, OptionError
from farfield.represent.orthoview import container
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import decode_object_tile, encode_object_tile
from farfield.represent.orthoview.quality import QUALITIES, quality
from farfield.represent.orthoview.tile import COVERAGE, FLAGS, MAGIC, NORMAL, UNLIT, decode_tile, encode_tile
from represent.random_layers import layers, random_layer


def assert_same(decoded: OrthoLayer, layer: OrthoLayer, normals: bool = True) -> None:
    """All that is lossless, where it is valid."""
    valid = layer.valid
    assert (decoded.x, decoded.y, decoded.depth_base) == (layer.x, layer.y, layer.depth_base)
    np.testing.assert_array_equal(decoded.depth, layer.depth)
    np.testing.assert_array_equal(decoded.coverage, layer.coverage)
    for name in ("length", "connected", *(["normal"] if normals else [])):
        np.testing.assert_array_equal(getattr(decoded, name)[valid], getattr(layer, name)[valid], name)
    assert not decoded.connected[~valid].any()
    assert decoded.objects is None


LEVELS = st.integers(-(2**31), 2**31 - 1)


@given(layers(), st.integers(0, 255), st.integers(0, 1), LEVELS, st.sampled_from([*QUALITIES]))
def test_round_trip(layer: OrthoLayer, direction: int, index: int, level: int, name: str) -> None:
    data = encode_tile(layer, direction, index, level, quality(name))
    tile = decode_tile(data)
    assert (tile.direction, tile.index, tile.level) == (direction, index, level)
    assert_same(tile.layer, layer, normals=name != "compact")
    assert encode_tile(layer, direction, index, level, quality(name)) == data


def test_compact_normals_move_by_one_code() -> None:
    layer = random_layer(3, 40, 40)
    decoded = decode_tile(encode_tile(layer, 0, 0, 0, quality("compact"))).layer
    moved = decoded.normal.astype(int)[layer.valid] - layer.normal[layer.valid]
    assert abs(moved).max() == 1
    assert not (decoded.normal[layer.valid] & 1).any()


@pytest.mark.parametrize(("name", "decibels"), [("compact", 23), ("normal", 25), ("high", 27)])
def test_color_is_close(name: str, decibels: float) -> None:
    layer = foliage(128, leaves=800)[0]
    decoded = decode_tile(encode_tile(layer, 0, 0, 0, quality(name))).layer
    error = decoded.color[layer.valid].astype(float) - layer.color[layer.valid]
    assert 10 * np.log10(255**2 / np.square(error).mean()) > decibels
    assert not decoded.color[~layer.valid].any()


def test_planes_that_say_nothing_are_left_out() -> None:
    layer = random_layer(0, 9, 9)
    plain = replace(
        layer,
        coverage=layer.valid * np.uint8(16),
        length=np.full(layer.shape, 8, np.uint8),
        connected=np.zeros(layer.shape, np.uint8),
    )
    data = encode_tile(plain, 0, 0, 0, quality("normal"))
    _, planes = container.unpack(data, MAGIC, "")
    assert not {COVERAGE, FLAGS, UNLIT} & planes.keys()
    assert_same(decode_tile(data).layer, plain)


def test_arrays_need_not_be_contiguous() -> None:
    layer = random_layer(0, 9, 8)
    turned = replace(layer, depth=np.asfortranarray(layer.depth), normal=np.asfortranarray(layer.normal))
    assert encode_tile(turned, 0, 0, 0, quality("high")) == encode_tile(layer, 0, 0, 0, quality("high"))


def test_unknown_planes_are_skipped() -> None:
    layer = random_layer(5, 6, 6)
    header, planes = container.unpack(encode_tile(layer, 1, 0, 2, quality("normal")), MAGIC, "")
    data = container.pack(MAGIC, header, [container.Plane(99, 7, b"later"), *planes.values()])
    assert_same(decode_tile(data).layer, layer)


@pytest.mark.parametrize(
    "change",
    [
        lambda a: replace(a, depth=np.zeros_like(a.depth)),
        lambda a: replace(a, coverage=np.zeros_like(a.coverage)),
        lambda a: replace(a, length=np.full_like(a.length, 9)),
        lambda a: replace(a, normal=np.full_like(a.normal, 64)),
        lambda a: replace(a, x=2**31),
        lambda a: random_layer(0, 1, 4097),
    ],
)
def test_what_does_not_fit_is_refused(change) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=r"tile|coverage|normal"):
        encode_tile(change(random_layer(0, 4, 4)), 0, 0, 0, quality("normal"))


def test_unknown_quality() -> None:
    with pytest.raises(OptionError, match="compact, normal, high"):
        quality("best")


def test_errors_say_where() -> None:
    data = bytearray(encode_tile(random_layer(0, 4, 4), 0, 0, 0, quality("normal")))
    data[-1] ^= 1
    with pytest.raises(CorruptTileError, match=r"^orthoview/0/1/2/3/9/0-ab: checksum"):
        decode_tile(bytes(data), "orthoview/0/1/2/3/9/0-ab")


@given(layers())
def test_object_ids(layer: OrthoLayer) -> None:
    ids = np.random.default_rng(layer.x + 9).integers(0, 2**32, layer.shape, dtype=np.uint32)
    kept = replace(layer, objects=ids)
    tile = decode_tile(encode_tile(kept, 3, 1, 2, quality("normal"))).layer
    data = encode_object_tile(kept, 3, 1, 2)
    np.testing.assert_array_equal(decode_object_tile(data, tile), ids * layer.valid)


def test_object_ids_of_another_tile_are_refused() -> None:
    one, other = random_layer(1, 6, 6, objects=True), random_layer(2, 6, 6, objects=True)
    with pytest.raises(CorruptTileError, match="another tile"):
        decode_object_tile(encode_object_tile(one, 0, 0, 0), other)
    with pytest.raises(ValueError, match="no object ids"):
        encode_object_tile(replace(one, objects=None), 0, 0, 0)


def test_normals_cost_what_was_measured() -> None:
    """A change of prediction or strategy that costs bytes should be noticed."""
    layer = foliage(256, leaves=2000)[0]
    data = encode_tile(layer, 0, 0, 0, quality("normal"))
    _, planes = container.unpack(data, MAGIC, "")
    count = int(np.count_nonzero(layer.valid))
    assert len(planes[NORMAL].stored) / count < 0.5
    assert len(data) / count < 2.5
