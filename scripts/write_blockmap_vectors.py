"""Write the BlockMaps that readers in both languages are tested with.

    python scripts/write_blockmap_vectors.py [FOLDER]

Each `NAME.json` holds an encoded BlockMap and its object ids (base64), the extent of its cell, and what a reader finds
in them: low, step, columns of a side, the heights that distances are told for and the highest point as numbers; the
rest deflated, base64: `tops` (n, n, 4) code and three distances, `slopes` (n, n, 2) signed or empty, `sides`
(4, n, n, 4) first column, first row and rows in the image of walls and the normal in 64ths of a turn, `objects` (n, n)
u32. Colour is lossy: a reader's may differ from `color`, the mean of all, by `color_tolerance`. `corrupt` are values
that must be refused, all but the first two with a right checksum.
"""

from __future__ import annotations

import base64
import json
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.represent.blockmap.build import fitted_to
from farfield.represent.blockmap.coding import decode_blockmap, decode_objects, encode_blockmap, encode_objects
from farfield.view.blockmaps import MARGIN, CastableMap

FOLDER = Path(__file__).resolve().parent.parent / "tests/vectors/blockmaps"
EXTENT = (64.0, 48.0)
"""Metres of the cell."""
QUALITY = 85


def subjects() -> dict[str, BlockMap]:
    """BlockMaps by name, made of random integers: the same everywhere."""
    small, middle = BlockMapSize(16, 64), BlockMapSize(32, 192)
    return {
        "small-by-area": _town(small, 1, by_area=True, sloped=True),
        "small-by-column": _town(small, 2, by_area=False, sloped=False),
        "middle-by-area": _town(middle, 3, by_area=True, sloped=True),
        "middle-by-column": _town(middle, 4, by_area=False, sloped=True),
        "noise": _noise(middle, 5),
        "one-texel": _one_texel(small),
    }


def _made(
    size: BlockMapSize, codes: NDArray[np.uint8], chance: np.random.Generator, by_area: bool, sloped: bool, least: int
) -> BlockMap:
    """With a rim, slopes and normals at random, and the finest texels on walls that there is room for."""
    n, m = size.side, size.columns
    slopes = chance.integers(-127, 128, (n, n, 2)) * (chance.random((n, n, 1)) < 0.3) * (codes[..., None] > 0)
    colors = chance.integers(0, 256, (n // 4, (n + m) // 4, 3), dtype=np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    blockmap = BlockMap(
        size, -2.25, 0.125, codes, slopes.astype(np.int8) if sloped else None,
        chance.integers(0, 2, (4, n), dtype=np.uint8), least, 0, 0, by_area,
        colors, np.empty(0, np.uint8),
        chance.choice(np.array([0, 7, 2**32 - 1, 300, 70_000], np.uint32), (n, n)),
    )  # fmt: skip
    fitted = fitted_to(blockmap, EXTENT[0] / n)
    return fitted.with_turns(chance.integers(0, 64, len(fitted.unfolded.sides), dtype=np.uint8))


def _town(size: BlockMapSize, seed: int, by_area: bool, sloped: bool) -> BlockMap:
    """Bodies on ground with holes."""
    chance, n = np.random.default_rng(seed), size.side
    codes = chance.integers(1, 6, (n, n), dtype=np.uint8)
    for _ in range(n // 2):
        (i, j), (width, depth) = chance.integers(0, n, 2), chance.integers(2, 2 + n // 4, 2)
        codes[j : j + depth, i : i + width] = chance.integers(0, 256) * (chance.random() < 0.9)
    return _made(size, codes, chance, by_area, sloped, 2)


def _noise(size: BlockMapSize, seed: int) -> BlockMap:
    """As many walls as there can be: columns are shared."""
    chance = np.random.default_rng(seed)
    codes = chance.integers(0, 256, (size.side, size.side), dtype=np.uint8)
    return _made(size, codes, chance, by_area=True, sloped=False, least=1)


def _one_texel(size: BlockMapSize) -> BlockMap:
    """Nothing but one texel on the rim."""
    codes = np.zeros((size.side, size.side), np.uint8)
    codes[0, 5] = 1
    return _made(size, codes, np.random.default_rng(6), by_area=True, sloped=False, least=1)


def expectation(blockmap: bytes, objects: bytes) -> dict[str, object]:
    """What a reader must find."""
    found = decode_blockmap(blockmap, "")
    castable, own, n = CastableMap.of(found, np.array([*EXTENT, 1.0])), found.unfolded, found.size.side
    tops = np.concatenate([found.codes[None], castable.distances]).transpose(1, 2, 0)
    turns = np.round(found.azimuths * (64 / (2 * np.pi))).astype(np.int64) % 64 * own.is_wall
    sides = np.concatenate([own.places, turns[..., None]], axis=-1).transpose(2, 0, 1, 3)
    slopes = np.empty(0, np.int8) if found.slopes is None else found.slopes
    return {
        "extent": list(EXTENT),
        "n": n,
        "m": found.size.columns,
        "low": found.low,
        "step": found.step,
        "across": own.across,
        "by_area": found.by_area,
        "walls": int(own.is_wall.sum()),
        "thresholds": castable.thresholds.tolist(),
        "highest": castable.span[1] - EXTENT[0] / n / MARGIN,
        "tops": _packed(tops),
        "slopes": _packed(slopes),
        "sides": _packed(sides.astype(np.uint8)),
        "objects": _packed(decode_objects(objects, "").astype("<u4")),
        "color": found.colors.mean(axis=(0, 1)).round(3).tolist(),
        "color_tolerance": 1,
    }


def _packed(array: NDArray[np.generic]) -> str:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return _text(packer.compress(np.ascontiguousarray(array).tobytes()) + packer.flush())


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def corrupt(blockmap: bytes) -> dict[str, bytes]:
    """Damaged ones by name, of one by area with slopes."""

    def sealed(value: bytes) -> bytes:
        return value[:36] + struct.pack("<I", zlib.crc32(value[:36] + bytes(4) + value[40:])) + value[40:]

    def with_field(form: str, at: int, number: float) -> bytes:
        changed = bytearray(blockmap)
        struct.pack_into(form, changed, at, number)
        return sealed(bytes(changed))

    lengths = struct.unpack_from("<III", blockmap, 24)
    ends = np.cumsum([40, *lengths])

    def with_stream(number: int, content: bytes, flags: int = blockmap[7]) -> bytes:
        packer = zlib.compressobj(9, zlib.DEFLATED, -15)
        packed = packer.compress(content) + packer.flush()
        head = bytearray(blockmap[:40])
        head[7] = flags
        struct.pack_into("<I", head, 24 + 4 * number, len(packed))
        return sealed(bytes(head) + blockmap[40 : ends[number]] + packed + blockmap[ends[number + 1] :])

    heights, slopes, turns = (zlib.decompress(blockmap[ends[k] : ends[k + 1]], -15) for k in range(3))
    n, middle = blockmap[6], len(blockmap) // 2
    floors = bytearray(n * n)
    floors[0] = heights[0] + 1
    return {
        "truncated": blockmap[:middle],
        "altered": blockmap[:middle] + bytes([blockmap[middle] ^ 1]) + blockmap[middle + 1 :],
        "version": with_field("<H", 4, 2),
        "reserved": with_field("<H", 14, 1),
        "side": with_field("<B", 6, 64),
        "columns": with_field("<H", 8, 256),
        "flag": with_field("<B", 7, blockmap[7] | 4),
        "slopes-without-flag": with_field("<B", 7, 1),
        "flag-without-slopes": with_field("<I", 28, 0),
        "density": with_field("<B", 10, 8),
        "finer": with_field("<B", 10, 0),
        "least": with_field("<B", 11, 0),
        "scale": with_field("<H", 12, 0),
        "higher": with_field("<H", 12, 65535),
        "low": with_field("<f", 16, float("inf")),
        "step-0": with_field("<f", 20, 0.0),
        "step-nan": with_field("<f", 20, float("nan")),
        "step-large": with_field("<f", 20, 1e9),
        "length": with_field("<I", 24, 2**32 - 1),
        "heights-short": with_stream(0, heights[:-1]),
        "heights-long": with_stream(0, heights + b"\0"),
        "floor-above-code": with_stream(0, heights + bytes(floors), blockmap[7] | 4),
        "nothing": with_stream(0, bytes(len(heights))),
        "more-walls": with_stream(0, bytes([1, 255] * n + [255, 1] * n) * (n // 4) + heights[n * n :]),
        "slopes-short": with_stream(1, slopes[:-1]),
        "slopes-long": with_stream(1, slopes + b"\0"),
        "turns-short": with_stream(2, turns[:-1]),
        "turns-long": with_stream(2, turns + b"\0"),
        "turn-64": with_stream(2, b"\x40" + turns[1:]),
        "color-none": sealed(blockmap[: ends[3]]),
        "color-other": sealed(blockmap[: ends[3]] + b"RIFF" + blockmap[ends[3] + 4 :].replace(b"VP8 ", b"VP8L")),
    }


def corrupt_objects(objects: bytes) -> dict[str, bytes]:
    """The same of object ids."""

    def sealed(value: bytes) -> bytes:
        return value[:12] + struct.pack("<I", zlib.crc32(value[:12] + bytes(4) + value[16:])) + value[16:]

    fewer = struct.pack("<I", struct.unpack_from("<I", objects, 8)[0] - 1)
    return {
        "truncated": objects[: len(objects) // 2],
        "altered": objects[:-1] + bytes([objects[-1] ^ 1]),
        "version": sealed(objects[:4] + b"\2\0" + objects[6:]),
        "side": sealed(objects[:6] + b"\40" + objects[7:]),
        "reserved": sealed(objects[:7] + b"\1" + objects[8:]),
        "count-0": sealed(objects[:8] + bytes(4) + objects[12:]),
        "count-less": sealed(objects[:8] + fewer + objects[12:]),
        "count-large": sealed(objects[:8] + b"\xff\xff\xff\xff" + objects[12:]),
        "stream": sealed(objects[:16] + b"\xff" + objects[17:]),
    }


def write(folder: Path) -> None:
    """All files, replacing those there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, made in subjects().items():
        assert made.objects is not None
        blockmap, objects = encode_blockmap(made, QUALITY), encode_objects(made.objects)
        value = {"blockmap": _text(blockmap), "object_ids": _text(objects), **expectation(blockmap, objects)}
        _write(folder / f"{name}.json", value)
        if name == "small-by-area":
            damaged = {"blockmap": corrupt(blockmap), "object_ids": corrupt_objects(objects)}
            _write(folder / "corrupt.json", {k: {n: _text(v) for n, v in of.items()} for k, of in damaged.items()})


def _write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
