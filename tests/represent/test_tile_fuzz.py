"""Whatever a file holds: either a layer that can be used, or CorruptTileError."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.errors import CorruptTileError
from farfield.represent.orthoview import container
from farfield.represent.orthoview.container import DEFLATE, RAW, WEBP, Plane, TileHeader
from farfield.represent.orthoview.object_tile import MAGIC as OBJECT_MAGIC
from farfield.represent.orthoview.object_tile import decode_object_tile, encode_object_tile
from farfield.represent.orthoview.quality import quality
from farfield.represent.orthoview.tile import (
    COLOR,
    COVERAGE,
    DEPTH,
    FLAGS,
    MAGIC,
    NORMAL,
    UNLIT,
    decode_tile,
    encode_tile,
)
from represent.random_layers import layers, random_layer

LAYER = random_layer(7, 13, 11, objects=True)
TILE = encode_tile(LAYER, 4, 0, 1, quality("normal"))
OBJECTS = encode_object_tile(LAYER, 4, 0, 1)


def sealed(data: bytes) -> bytes:
    """The same with a right checksum: what an attacker, not an accident, sends."""
    if len(data) < 40:
        return data
    empty = data[:36] + bytes(4) + data[40:]
    return empty[:36] + struct.pack("<I", zlib.crc32(empty)) + empty[40:]


def check(data: bytes) -> None:
    """Decodes to something whole, or raises the one error that says so."""
    try:
        layer = decode_tile(data).layer
    except CorruptTileError:
        return
    valid = layer.valid
    assert valid.any()
    assert layer.color.shape == (*valid.shape, 3)
    assert layer.normal.max() < 64
    assert ((layer.coverage > 0) == valid).all()
    assert layer.coverage.max() <= 16
    assert layer.length.min() >= 1
    assert layer.length.max() <= 8


def check_objects(data: bytes) -> None:
    """The same for object ids."""
    try:
        ids = decode_object_tile(data, LAYER)
    except CorruptTileError:
        return
    assert ids.shape == LAYER.shape


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """Bits flipped, bytes set, cut, doubled or inserted; one to four times."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, max(1, min(len(changed), rng.choice([48, 120, len(changed)])))))
        match int(rng.integers(0, 6)):
            case 0 | 1 if changed:
                changed[at] ^= 1 << int(rng.integers(8))
            case 2 if changed:
                changed[at] = int(rng.choice([0, 1, 127, 128, 255]))
            case 3:
                del changed[at : at + int(rng.integers(1, 40))]
            case 4:
                changed[at:at] = changed[at : at + int(rng.integers(1, 40))]
            case _:
                changed[at:at] = rng.bytes(int(rng.integers(1, 9)))
    return bytes(changed)


def run(cases: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(cases):
        seal = sealed if rng.random() < 0.8 else bytes
        if rng.random() < 0.8:
            check(seal(altered(TILE, rng)))
        else:
            check_objects(seal(altered(OBJECTS, rng)))


def test_altered_tiles() -> None:
    run(1500, 1)


@pytest.mark.slow
def test_altered_tiles_at_length() -> None:
    run(120_000, 2)


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes(data: bytes) -> None:
    check(data)
    check(sealed(MAGIC + b"\x01\x00" + data))
    check_objects(sealed(OBJECT_MAGIC + b"\x01\x00" + data))


def test_every_truncation() -> None:
    for length in range(len(TILE)):
        with pytest.raises(CorruptTileError):
            decode_tile(TILE[:length])
        check(sealed(TILE[:length]))


def test_every_bit_is_guarded() -> None:
    for bit in range(8 * len(TILE)):
        changed = bytearray(TILE)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(CorruptTileError):
            decode_tile(bytes(changed))


def rebuilt(change: Callable[[TileHeader, dict[int, Plane]], tuple[dict[str, int], dict[int, Plane]]]) -> bytes:
    """TILE with other header fields or planes, and a right checksum; fields are not checked as `pack` would."""
    header, planes = container.unpack(TILE, MAGIC, "")
    fields, planes = change(header, dict(planes))
    data = bytearray(container.pack(MAGIC, header, list(planes.values())))
    places = {"version": ("<H", 4), "index": ("<B", 7), "width": ("<H", 20), "height": ("<H", 22), "valid": ("<I", 28)}
    places |= {"planes": ("<H", 32), "reserved": ("<H", 34), "length": ("<I", 44)}
    for name, value in fields.items():
        struct.pack_into(places[name][0], data, places[name][1], value)
    return sealed(bytes(data))


def with_plane(kind: int, codec: int, stored: bytes) -> bytes:
    return rebuilt(lambda h, p: ({}, {**p, kind: Plane(kind, codec, stored)}))


def without(kind: int) -> bytes:
    return rebuilt(lambda h, p: ({}, {k: v for k, v in p.items() if k != kind}))


def deflate(content: bytes) -> bytes:
    stream = zlib.compressobj(9, zlib.DEFLATED, -15)
    return stream.compress(content) + stream.flush()


COUNT = int(np.count_nonzero(LAYER.valid))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "shorter than a header"),
        (b"RIFF" + TILE[4:], "starts with"),
        (rebuilt(lambda h, p: ({"version": 2}, p)), "version 2"),
        (rebuilt(lambda h, p: ({"index": 2}, p)), "layer 2"),
        (rebuilt(lambda h, p: ({"reserved": 1}, p)), "reserved 1"),
        (rebuilt(lambda h, p: ({"width": 0}, p)), "absurd"),
        (rebuilt(lambda h, p: ({"width": 65535, "height": 65535}, p)), "absurd"),
        (rebuilt(lambda h, p: ({"valid": 0}, p)), "absurd"),
        (rebuilt(lambda h, p: ({"valid": 2**32 - 1}, p)), "absurd"),
        (rebuilt(lambda h, p: ({"valid": COUNT - 1}, p)), "does not hold"),
        (rebuilt(lambda h, p: ({"width": h.height, "height": h.width}, p)), "mask|colour"),
        (rebuilt(lambda h, p: ({"planes": 65}, p)), "65 planes"),
        (rebuilt(lambda h, p: ({"planes": 64}, p)), "do not fit|kind|ends beyond"),
        (rebuilt(lambda h, p: ({"planes": 3}, p)), "follow the last|ends beyond"),
        (rebuilt(lambda h, p: ({"length": 2**32 - 1}, p)), "ends beyond"),
        (without(DEPTH), "no depth plane"),
        (without(COLOR), "no colour plane"),
        (without(NORMAL), "no normal plane"),
        (with_plane(NORMAL, WEBP, b"x"), "codec 2"),
        (with_plane(NORMAL, DEFLATE, b"\xff\xff"), "cannot be inflated"),
        (with_plane(NORMAL, DEFLATE, deflate(bytes(2 * COUNT)) + b"x"), "does not hold"),
        (with_plane(NORMAL, DEFLATE, deflate(bytes(2 * COUNT))[:-1]), "does not hold"),
        (with_plane(NORMAL, RAW, bytes([64]) * (2 * COUNT)), "beyond 63"),
        (with_plane(COVERAGE, RAW, bytes([128]) * COUNT), "beyond 127"),
        (with_plane(FLAGS, RAW, b"\xff" * ((COUNT + 7) // 8)), "more than the valid"),
        (with_plane(UNLIT, RAW, b""), "does not hold"),
        (with_plane(COLOR, RAW, b""), "no colour plane"),
        (with_plane(COLOR, WEBP, b"RIFF"), "no simple lossy WebP"),
    ],
)
def test_each_fault_is_named(data: bytes, says: str) -> None:
    with pytest.raises(CorruptTileError, match=says):
        decode_tile(data)


def test_depth_zero_is_refused() -> None:
    bits = np.zeros(13 * 11, np.uint8)
    bits[-1] = 1
    content = np.packbits(bits).tobytes() + b"\0\0"
    data = rebuilt(
        lambda h, p: (
            {"valid": 1},
            {DEPTH: Plane(DEPTH, RAW, content), COLOR: p[COLOR], NORMAL: Plane(NORMAL, RAW, b"\0\0")},
        )
    )
    with pytest.raises(CorruptTileError, match="depth 0"):
        decode_tile(data)


def test_a_webp_of_another_size_is_refused() -> None:
    other = encode_tile(random_layer(7, 13, 12), 4, 0, 1, quality("normal"))
    stored = container.unpack(other, MAGIC, "")[1][COLOR].stored
    with pytest.raises(CorruptTileError, match="12 x 13 instead of 11 x 13"):
        decode_tile(with_plane(COLOR, WEBP, stored))


def test_bombs_are_not_inflated() -> None:
    """64 MB of zeros in 64 kB, and a picture that claims 16383 x 16383."""
    bomb = deflate(bytes(64 << 20))
    webp = bytearray(container.unpack(TILE, MAGIC, "")[1][COLOR].stored)
    struct.pack_into("<HH", webp, 26, 16383, 16383)
    tiles = [with_plane(kind, DEFLATE, bomb) for kind in (DEPTH, NORMAL, COVERAGE, FLAGS)]
    tiles.append(with_plane(COLOR, WEBP, bytes(webp)))
    for data in tiles:
        tracemalloc.start()
        with pytest.raises(CorruptTileError):
            decode_tile(data)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 2 << 20


@settings(max_examples=30, deadline=None)
@given(layers(), st.integers(0, 2**32 - 1))
def test_altered_layers_of_every_kind(layer, seed: int) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    data = encode_tile(layer, 0, 0, 0, quality("compact"))
    for _ in range(5):
        check(sealed(altered(data, rng)))
