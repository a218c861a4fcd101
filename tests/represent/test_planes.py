"""Coded planes against a plain twin, straight from spec/orthoview.md."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.kernels import contexts, rans
from farfield.represent.orthoview import container
from farfield.represent.orthoview.coding import Model, Reader, coded
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import OBJECTS, encode_object_tile
from farfield.represent.orthoview.planes import COVERAGE, DEPTH, FLAGS, NORMAL, UNLIT
from farfield.represent.orthoview.quality import quality
from farfield.represent.orthoview.tile import MAGIC, encode_tile
from represent import plain_codec
from represent.random_layers import layers


def image(mask: NDArray[np.bool_], listed: list[int]) -> NDArray[np.int64]:
    """Numbers of valid pixels at their places."""
    found = np.zeros(mask.shape, np.int64)
    found[mask] = listed
    return found


@settings(max_examples=60)
@given(layers(12))
def test_a_tile_holds_the_symbols_of_the_specification(layer: OrthoLayer) -> None:
    _, planes = container.unpack(encode_tile(layer, 0, 0, 0, quality("high")), MAGIC, "")
    mask = layer.valid
    surface = plain_codec.Surface(
        mask,
        layer.depth,
        image(mask, plain_codec.depth_residuals(layer.depth)),
        np.stack([image(mask, plain_codec.normal_residuals(layer.depth, layer.normal[..., c])) for c in (0, 1)]),
        layer.coverage.astype(np.int64),
        layer.length.astype(np.int64),
    )
    expected = {
        DEPTH: (plain_codec.depth_symbols(surface), [(128, 2), (96, 40)]),
        NORMAL: (plain_codec.normal_symbols(surface), [(64, 64)]),
    }
    if COVERAGE in planes:
        expected[COVERAGE] = plain_codec.coverage_symbols(surface), [(48, 16), (40, 8)]
    for kind, bit in ((FLAGS, 1), (UNLIT, 2)):
        bits = (layer.connected & bit > 0) & mask
        assert (kind in planes) == bits.any()
        if kind in planes:
            expected[kind] = plain_codec.bit_symbols(surface, bits), [(144, 2)]
    for kind, (symbols, models) in expected.items():
        found = plain_codec.decoded(planes[kind].stored, models, [context for context, _ in symbols])
        assert found == [symbol for _, symbol in symbols]


@given(layers(12), st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 300, 2**32]))
def test_object_ids_are_those_of_the_specification(layer: OrthoLayer, seed: int, kinds: int) -> None:
    ids = np.random.default_rng(seed).integers(0, kinds, layer.shape, dtype=np.uint32)
    data = encode_object_tile(replace(layer, objects=ids), 0, 0, 0)
    plane = container.unpack(data, b"FFID", "")[1][OBJECTS].stored
    symbols = plain_codec.object_symbols(layer.valid, ids)
    found = plain_codec.decoded(plane, [(32, 5), (1, 33)], [context for context, _ in symbols])
    assert found == [symbol for _, symbol in symbols]


MODELS = (Model(5, 3), Model(3, 64))


def stream(seed: int, count: int) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Contexts of MODELS and of plain bits, and symbols, some contexts never, some always the same."""
    r = np.random.default_rng(seed)
    context = r.choice(np.array([0, 2, 3, 4, 6, 7, rans.BITS + 1, rans.BITS + 7]), count)
    largest = np.select([context < 4, context == 4, context < 8, context == rans.BITS + 1], [3, 1, 64, 2], 128)
    symbols = (r.random(count) ** 3 * largest).astype(np.uint8)
    return context.astype(np.uint16), symbols


@given(st.integers(0, 2**32 - 1), st.integers(0, 400))
def test_any_symbols_come_back(seed: int, count: int) -> None:
    context, symbols = stream(seed, count)
    plane = coded(MODELS, context, symbols)
    assert plain_codec.decoded(plane, [*MODELS], context.tolist()) == symbols.tolist()


@given(st.lists(st.integers(0, rans.LARGEST_CODE), min_size=1, max_size=64))
def test_places_of_any_table(codes: list[int]) -> None:
    table = np.array([codes], np.uint8)
    starts, widths = np.empty((2, 1, len(codes)), np.uint16)
    rans.spread(table, rans.WEIGHTS, starts, widths)
    slots = np.zeros((1, rans.ONE), np.uint32)
    rans.fill_slots(starts, widths, slots)
    assert (slots[0] & 63).tolist() == plain_codec.symbols_of_tables(codes)


def test_every_symbol_of_a_table_keeps_a_place() -> None:
    """The worst that rounding can do: few large shares and many that are rounded up."""
    for rare in range(64):
        for common in range(1, 65 - rare):
            table = np.array([[1] * rare + [rans.LARGEST_CODE] * common], np.uint8)
            starts, widths = np.empty((2, *table.shape), np.uint16)
            rans.spread(table, rans.WEIGHTS, starts, widths)
            assert widths.min() >= 1
            assert widths.sum() == rans.ONE


def test_tables_are_worth_their_bytes() -> None:
    """Contexts that behave alike share a table; others do not."""
    r = np.random.default_rng(4)
    context = r.integers(0, 4, 20_000).astype(np.uint16)
    alike = r.integers(0, 8, 20_000).astype(np.uint8)
    assert len(alone([Model(4, 8)], context, alike)) == 1
    other = np.where(context < 2, alike, np.uint8(3))
    assert len(alone([Model(4, 8)], context, other)) == 2


def alone(models: list[Model], context: NDArray[np.uint16], symbols: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The tables of one model."""
    counts = np.zeros(models[0], np.int64)
    rans.count_symbols(context, symbols, 0, models[0].contexts, counts)
    return rans.tables_of(counts)[1]


@settings(max_examples=300)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.data())
def test_altered_planes_are_refused_or_give_other_symbols(seed: int, count: int, data: st.DataObject) -> None:
    """Never symbols beyond the alphabet, reads out of bounds or another error; kernels do not check."""
    context = np.zeros(count, np.uint16)
    symbols = (np.random.default_rng(seed).random(count) ** 4 * 2).astype(np.uint8)
    plane = bytearray(coded([Model(contexts.BIT_CONTEXTS, 2)], context, symbols))
    for _ in range(data.draw(st.integers(1, 4))):
        plane[data.draw(st.integers(0, len(plane) - 1))] = data.draw(st.integers(0, 255))
    del plane[data.draw(st.integers(0, 2 * len(plane))) :]
    try:
        reader = Reader([Model(contexts.BIT_CONTEXTS, 2)], bytes(plane), "flags", "here")
        bits = np.empty(count, np.uint8)
        places = np.full((count, 4), -1, np.int32)
        contexts.read_bits(*reader.arguments, places, np.zeros(count, np.uint8), bits)
        assert bits.max() < 2
        reader.finish()
    except CorruptTileError:
        pass


def test_tables_and_stream_are_the_same_on_every_machine() -> None:
    """Other bytes are another version of the bake (BAKE_VERSION)."""
    counts = np.array([[0, 0, 0], [900, 90, 9], [700, 80, 10], [5, 5, 5], [0, 0, 0]], np.int64)
    table, codes = rans.tables_of(counts)
    assert table.tolist() == [0, 0, 0, 1, 1]
    assert codes.tolist() == [[48, 35, 23], [43, 43, 43]]
    starts, widths = np.empty((2, *codes.shape), np.uint16)
    rans.spread(codes, rans.WEIGHTS, starts, widths)
    assert widths.tolist() == [[915, 97, 12], [342, 341, 341]]
    contexts_ = np.array([1, 2, 3, rans.BITS + 5, 1, 3], np.uint16)
    out = np.empty(4 + 2 * len(contexts_), np.uint8)
    begin = rans.encode(contexts_, np.array([0, 1, 2, 19, 0, 1], np.uint8), table, starts, widths, out)
    assert out[begin:].tobytes().hex() == "5d27eb0e"
