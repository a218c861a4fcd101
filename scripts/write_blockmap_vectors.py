"""Write the BlockMaps that readers in both languages are tested with.

    python scripts/write_blockmap_vectors.py [FOLDER]

Each `NAME.json` holds an encoded BlockMap and its object ids (base64), the extent of its cell, and what a reader finds
in them: low, step, columns of a side, the heights that distances are told for and the highest point as numbers; the
rest deflated, base64: `tops` (n, n, 4) code and three distances, `slopes` (n, n, 2) signed or empty, `floors` (n, n)
codes or empty, `sides` (4, n, n, 4) first column, first row and rows in the image of walls and the normal in 64ths of a
turn, `objects` (n, n) u32. Colour is lossy: a reader's may differ from `color`, the mean of all, by `color_tolerance`.
`corrupt` are values that must be refused, all but the first two with a right checksum.
"""

from __future__ import annotations

import base64
import json
import struct
import sys
import zlib
from dataclasses import replace
from itertools import pairwise
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
        "hanging-by-area": _town(small, 7, by_area=True, sloped=True, hanging=True),
        "hanging-by-column": _town(small, 8, by_area=False, sloped=False, hanging=True),
    }


def _made(
    size: BlockMapSize, codes: NDArray[np.uint8], chance: np.random.Generator, by_area: bool, sloped: bool, least: int,
    hanging: bool = False,
) -> BlockMap:  # fmt: skip
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
    if hanging:
        floors = chance.integers(0, codes.astype(int) + 1) * (chance.random((n, n)) < 0.5)
        blockmap = replace(blockmap, floors=floors.astype(np.uint8))
    fitted = fitted_to(blockmap, EXTENT[0] / n)
    return fitted.with_turns(chance.integers(0, 64, len(fitted.unfolded.sides), dtype=np.uint8))


def _town(size: BlockMapSize, seed: int, by_area: bool, sloped: bool, hanging: bool = False) -> BlockMap:
    """Bodies on ground with holes. hanging: half of the texels have floors."""
    chance, n = np.random.default_rng(seed), size.side
    codes = chance.integers(1, 6, (n, n), dtype=np.uint8)
    for _ in range(n // 2):
        (i, j), (width, depth) = chance.integers(0, n, 2), chance.integers(2, 2 + n // 4, 2)
        codes[j : j + depth, i : i + width] = chance.integers(0, 256) * (chance.random() < 0.9)
    return _made(size, codes, chance, by_area, sloped, 2, hanging)


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
    floors = np.empty(0, np.uint8) if found.floors is None else found.floors
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
        "floors": _packed(floors),
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


class _Sound:
    """A BlockMap to be damaged: the checksum of what comes of it is right."""

    def __init__(self, blockmap: bytes) -> None:
        self.whole, self.flags = blockmap, blockmap[7]
        self._ends = np.cumsum([40, *struct.unpack_from("<III", blockmap, 24)]).tolist()
        self.heights, self.slopes, self.turns = (
            zlib.decompress(blockmap[begin:end], -15) if end > begin else b"" for begin, end in pairwise(self._ends)
        )
        self.color = blockmap[self._ends[3] :]

    def with_field(self, form: str, at: int, number: float) -> bytes:
        """With another number in its header."""
        changed = bytearray(self.whole)
        struct.pack_into(form, changed, at, number)
        return _sealed(bytes(changed))

    def with_stream(self, number: int, content: bytes) -> bytes:
        """With other heights, slopes or turns."""
        packer = zlib.compressobj(9, zlib.DEFLATED, -15)
        packed = packer.compress(content) + packer.flush()
        head = bytearray(self.whole[:40])
        struct.pack_into("<I", head, 24 + 4 * number, len(packed))
        return _sealed(
            bytes(head) + self.whole[40 : self._ends[number]] + packed + self.whole[self._ends[number + 1] :]
        )

    def with_color(self, content: bytes) -> bytes:
        """With another picture."""
        return _sealed(self.whole[: self._ends[3]] + content)


def _sealed(value: bytes) -> bytes:
    return value[:36] + struct.pack("<I", zlib.crc32(value[:36] + bytes(4) + value[40:])) + value[40:]


def corrupt(blockmap: bytes) -> dict[str, bytes]:
    """Damaged ones by name, of one by area with slopes and without floors."""
    sound, n, middle = _Sound(blockmap), blockmap[6], len(blockmap) // 2
    return {
        "truncated": blockmap[:middle],
        "altered": blockmap[:middle] + bytes([blockmap[middle] ^ 1]) + blockmap[middle + 1 :],
        "version": sound.with_field("<H", 4, 2),
        "reserved": sound.with_field("<H", 14, 1),
        "side": sound.with_field("<B", 6, 64),
        "columns": sound.with_field("<H", 8, 256),
        "flag": sound.with_field("<B", 7, sound.flags | 4),
        "flag-unknown": sound.with_field("<B", 7, sound.flags | 8),
        "slopes-without-flag": sound.with_field("<B", 7, 1),
        "flag-without-slopes": sound.with_field("<I", 28, 0),
        "density": sound.with_field("<B", 10, 8),
        "finer": sound.with_field("<B", 10, 0),
        "least": sound.with_field("<B", 11, 0),
        "scale": sound.with_field("<H", 12, 0),
        "higher": sound.with_field("<H", 12, 65535),
        "low": sound.with_field("<f", 16, float("inf")),
        "step-0": sound.with_field("<f", 20, 0.0),
        "step-nan": sound.with_field("<f", 20, float("nan")),
        "step-large": sound.with_field("<f", 20, 1e9),
        "length": sound.with_field("<I", 24, 2**32 - 1),
        "heights-short": sound.with_stream(0, sound.heights[:-1]),
        "heights-long": sound.with_stream(0, sound.heights + b"\0"),
        "nothing": sound.with_stream(0, bytes(len(sound.heights))),
        "more-walls": sound.with_stream(0, bytes([1, 255] * n + [255, 1] * n) * (n // 4) + sound.heights[n * n :]),
        "slopes-short": sound.with_stream(1, sound.slopes[:-1]),
        "slopes-long": sound.with_stream(1, sound.slopes + b"\0"),
        "turns-short": sound.with_stream(2, sound.turns[:-1]),
        "turns-long": sound.with_stream(2, sound.turns + b"\0"),
        "turn-64": sound.with_stream(2, b"\x40" + sound.turns[1:]),
        "color-none": sound.with_color(b""),
        "color-other": sound.with_color(b"RIFF" + sound.color[4:].replace(b"VP8 ", b"VP8L")),
    }


def corrupt_floors(blockmap: bytes) -> dict[str, bytes]:
    """Damaged ones by name, of one with floors."""
    sound, n = _Sound(blockmap), blockmap[6]
    rim = n * n + n // 2
    codes, floors = sound.heights[: n * n], sound.heights[rim:]
    return {
        "floors-short": sound.with_stream(0, sound.heights[:-1]),
        "floors-long": sound.with_stream(0, sound.heights + b"\0"),
        "floors-without-flag": sound.with_field("<B", 7, sound.flags & ~4),
        # A floor at the top leaves no wall beside what is there: there are turns for walls that are none.
        "floor-above-code": sound.with_stream(0, sound.heights[:rim] + bytes([codes[0] + 1]) + floors[1:]),
        "floors-other": sound.with_stream(0, sound.heights[:rim] + codes),
        "floors-of-nothing": sound.with_stream(0, bytes(n * n) + sound.heights[n * n : rim] + floors),
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
    damaged: dict[str, dict[str, bytes]] = {"blockmap": {}, "object_ids": {}}
    for name, made in subjects().items():
        assert made.objects is not None
        blockmap, objects = encode_blockmap(made, QUALITY), encode_objects(made.objects)
        value = {"blockmap": _text(blockmap), "object_ids": _text(objects), **expectation(blockmap, objects)}
        _write(folder / f"{name}.json", value)
        if name == "small-by-area":
            damaged["blockmap"] |= corrupt(blockmap)
            damaged["object_ids"] |= corrupt_objects(objects)
        if name == "hanging-by-area":
            damaged["blockmap"] |= corrupt_floors(blockmap)
    _write(folder / "corrupt.json", {k: {n: _text(v) for n, v in of.items()} for k, of in damaged.items()})


def _write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
