"""Each way in which a tile can be wrong is named. Damage at random is tests/fuzz's."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Callable

import numpy as np
import pytest

from farfield.errors import CorruptTileError
from farfield.represent.orthoview import container
from farfield.represent.orthoview.container import CODED, DEFLATE, RAW, WEBP, Plane, TileHeader
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
from fuzz.shells import deflated, sealed
from represent.random_layers import random_layer

LAYER = random_layer(7, 13, 11, objects=True)
TILE = encode_tile(LAYER, 4, 0, 1, quality("normal"))


def test_every_truncation() -> None:
    for length in range(len(TILE)):
        with pytest.raises(CorruptTileError):
            decode_tile(TILE[:length])
        with pytest.raises(CorruptTileError):
            decode_tile(sealed(TILE[:length]))


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


def with_tables(change: Callable[[bytes], bytes]) -> bytes:
    """TILE with other tables before its coded normals."""
    stored = container.unpack(TILE, MAGIC, "")[1][NORMAL].stored
    end = 4 + int.from_bytes(stored[:2], "little")
    told = change(zlib.decompress(stored[4:end], -15))
    packed = deflated(told)
    return with_plane(NORMAL, CODED, struct.pack("<HH", len(packed), len(told)) + packed + stored[end:])


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
        (rebuilt(lambda h, p: ({"valid": COUNT - 1}, p)), "does not mark"),
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
        (with_plane(NORMAL, DEFLATE, deflated(bytes(2 * COUNT)) + b"x"), "does not hold"),
        (with_plane(NORMAL, DEFLATE, deflated(bytes(2 * COUNT))[:-1]), "does not hold"),
        (with_plane(NORMAL, RAW, bytes([64]) * (2 * COUNT)), "beyond 63"),
        (with_plane(NORMAL, CODED, b"\1\0\1"), "too short"),
        (with_plane(NORMAL, CODED, b"\0\0\0\0abc"), "too short"),
        (with_plane(NORMAL, CODED, b"\2\0\1\0\xff\xffabcd"), "cannot be inflated"),
        (with_tables(lambda told: told[:-1]), "tables that no writer makes"),
        (with_tables(lambda told: told + b"\0"), "more tables than contexts"),
        (with_tables(lambda told: b""), "tables that no writer makes"),
        (with_tables(lambda told: bytes([told[0] & 127]) + told[1:]), "tables that no writer makes"),
        (with_tables(lambda told: told[:-1] + b"\xff"), "tables that no writer makes"),
        (with_tables(lambda told: told[:-1] + bytes([told[-1] ^ 1])), "does not hold what it should|beyond"),
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
    bomb = deflated(bytes(64 << 20))
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
