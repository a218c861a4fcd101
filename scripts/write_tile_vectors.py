"""Write the tiles that readers in both languages are tested with.

    python scripts/write_tile_vectors.py [FOLDER]

Each `NAME.ffov` comes with a `NAME.json`: header, some pixels, and CRC-32 sums of the decoded planes, row by row over
all pixels with 0 where nothing is: depth as little-endian u16, normal as pairs of bytes, coverage, length and flags
(1 = connected, 2 = unlit) as bytes; object ids, where there is a `NAME.ffid`, as little-endian u32. Colour is lossy: a
reader's may differ from the pixels listed by `color_tolerance`. Files in `corrupt/` must be refused. `deflated/`
holds the same as farfield wrote them until 2026-11-25, which readers must go on to read; this script leaves it alone.
"""

from __future__ import annotations

import json
import struct
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.layers import city, foliage, statue  # noqa: E402

from farfield.represent.orthoview import container  # noqa: E402
from farfield.represent.orthoview.connectivity import mark_connected  # noqa: E402
from farfield.represent.orthoview.container import CODED, Plane  # noqa: E402
from farfield.represent.orthoview.layer import OrthoLayer  # noqa: E402
from farfield.represent.orthoview.object_tile import encode_object_tile  # noqa: E402
from farfield.represent.orthoview.quality import quality  # noqa: E402
from farfield.represent.orthoview.tile import MAGIC, NORMAL, decode_tile, encode_tile  # noqa: E402

FOLDER = REPOSITORY / "tests/vectors/tiles"


def subjects() -> dict[str, tuple[OrthoLayer, int, str]]:
    """Layers with their index and quality, by name."""
    leaves = foliage(40, leaves=250)
    found = {
        "foliage-first": (leaves[0], 0, "normal"),
        "foliage-second": (leaves[1], 1, "normal"),
        "foliage-compact": (leaves[0], 0, "compact"),
        "statue": (statue(48)[0], 0, "high"),
        "city": (city(64, houses=30)[0], 0, "normal"),
        "noise": (_noise(11, 13), 0, "normal"),
        "row": (_noise(1, 70), 0, "normal"),
        "column": (_noise(70, 1), 0, "normal"),
        "pixel": (_noise(1, 1), 1, "normal"),
    }
    for layer, _, _ in found.values():
        mark_connected(layer)
    found["flat"] = (_flat(9, 20), 0, "normal")
    return found


def _noise(height: int, width: int) -> OrthoLayer:
    """Everything at random, wide depths and an unlit part, with object ids and negative places."""
    r = np.random.default_rng(height * 100 + width)
    shape = height, width
    valid = r.random(shape) < 0.7
    valid[0, 0] = True
    return OrthoLayer(
        x=-5,
        y=-70000,
        depth_base=-123456,
        depth=np.where(valid, r.integers(1, 65536, shape), 0).astype(np.uint16),
        color=r.integers(0, 256, (*shape, 3), dtype=np.uint8),
        normal=r.integers(0, 64, (*shape, 2), dtype=np.uint8),
        length=r.integers(1, 9, shape, dtype=np.uint8),
        coverage=r.integers(1, 17, shape, dtype=np.uint8) * valid,
        connected=r.integers(0, 2, shape, dtype=np.uint8) * np.uint8(2) * valid,
        objects=r.integers(0, 2**32, shape, dtype=np.uint32) * valid,
    )


def _flat(height: int, width: int) -> OrthoLayer:
    """Full, flat and neither connected nor unlit: no plane but the first three."""
    noise = _noise(height, width)
    return replace(
        noise,
        depth=np.full((height, width), 700, np.uint16),
        length=np.full((height, width), 8, np.uint8),
        coverage=np.full((height, width), 16, np.uint8),
        connected=np.zeros((height, width), np.uint8),
        objects=None,
    )


def expectation(data: bytes, ids: NDArray[np.uint32] | None) -> dict[str, object]:
    """What a reader must find in a tile."""
    tile = decode_tile(data)
    layer, valid = tile.layer, tile.layer.valid
    planes = {
        "depth": layer.depth.astype("<u2"),
        "normal": layer.normal * valid[..., None],
        "coverage": layer.coverage,
        "length": layer.length * valid,
        "flags": layer.connected,
    }
    if ids is not None:
        planes["objects"] = ids.astype("<u4")
    return {
        "direction": tile.direction,
        "index": tile.index,
        "level": tile.level,
        "x": layer.x,
        "y": layer.y,
        "width": layer.shape[1],
        "height": layer.shape[0],
        "depth_base": layer.depth_base,
        "valid": int(np.count_nonzero(valid)),
        "crc32": {name: zlib.crc32(np.ascontiguousarray(plane).tobytes()) for name, plane in planes.items()},
        "color_tolerance": 3,
        "pixels": _pixels(layer),
    }


def _pixels(layer: OrthoLayer) -> list[dict[str, object]]:
    """Up to eight valid pixels, spread evenly in valid order."""
    places = np.argwhere(layer.valid)
    return [
        {
            "row": int(j),
            "column": int(i),
            "depth": int(layer.depth[j, i]),
            "color": layer.color[j, i].tolist(),
            "normal": layer.normal[j, i].tolist(),
            "length": int(layer.length[j, i]),
            "coverage": int(layer.coverage[j, i]),
            "flags": int(layer.connected[j, i]),
        }
        for j, i in places[:: max(1, len(places) // 8)][:8]
    ]


def corrupt(tile: bytes) -> dict[str, bytes]:
    """Damaged tiles by name; all but the first two with a right checksum."""

    def sealed(data: bytes) -> bytes:
        empty = data[:36] + bytes(4) + data[40:]
        return empty[:36] + struct.pack("<I", zlib.crc32(empty)) + empty[40:]

    def with_field(form: str, at: int, value: int) -> bytes:
        changed = bytearray(tile)
        struct.pack_into(form, changed, at, value)
        return sealed(bytes(changed))

    def with_normals(plane: bytes) -> bytes:
        header, planes = container.unpack(tile, MAGIC, "")
        return container.pack(MAGIC, header, list((planes | {NORMAL: Plane(NORMAL, CODED, plane)}).values()))

    _, planes = container.unpack(tile, MAGIC, "")
    normals = planes[NORMAL].stored
    packed = 4 + int.from_bytes(normals[:2], "little")
    told = zlib.decompress(normals[4:packed], -15)

    def with_tables(told: bytes) -> bytes:
        deflated = zlib.compress(told, wbits=-15)
        return with_normals(struct.pack("<HH", len(deflated), len(told)) + deflated + normals[packed:])

    middle = len(tile) // 2
    return {
        "truncated": tile[:middle],
        "altered": tile[:middle] + bytes([tile[middle] ^ 1]) + tile[middle + 1 :],
        "version": with_field("<H", 4, 2),
        "size": with_field("<H", 20, 5000),
        "valid": with_field("<I", 28, 3),
        "plane-length": with_field("<I", 44, 2**32 - 1),
        "plane-codec": with_field("<B", 41, 9),
        "tail": sealed(tile + b"more"),
        "coded-empty": with_normals(b""),
        "coded-without-stream": with_normals(normals[:packed]),
        "coded-short": with_normals(normals[:-2]),
        "coded-odd": with_normals(normals + b"\0"),
        "coded-long": with_normals(normals + bytes(2)),
        "coded-state": with_normals(normals[:packed] + b"\1" + normals[packed + 1 :]),
        "coded-size": with_normals(normals[:2] + b"\1" + normals[3:]),
        "coded-tables": with_normals(normals[:4] + bytes(packed - 4) + normals[packed:]),
        "coded-tables-short": with_tables(told[:-1]),
        "coded-tables-long": with_tables(told + b"\0"),
        "coded-tables-none": with_tables(b""),
        "coded-tables-without-first": with_tables(bytes([told[0] & 127]) + told[1:]),
        "coded-tables-code": with_tables(told[:-1] + b"\xff"),
    }


def write(folder: Path) -> None:
    """All files, replacing those there."""
    (folder / "corrupt").mkdir(parents=True, exist_ok=True)
    for direction, (name, (layer, index, preset)) in enumerate(subjects().items()):
        data = encode_tile(layer, direction, index, direction - 3, quality(preset))
        (folder / f"{name}.ffov").write_bytes(data)
        if layer.objects is not None:
            (folder / f"{name}.ffid").write_bytes(encode_object_tile(layer, direction, index, direction - 3))
        text = json.dumps(expectation(data, layer.objects), indent=1)
        (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        if name == "noise":
            for fault, damaged in corrupt(data).items():
                (folder / "corrupt" / f"{fault}.ffov").write_bytes(damaged)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
