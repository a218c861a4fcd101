"""Writes the archive, and the directories, that the tests of Python and TypeScript share: tests/vectors/archive.

python scripts/write_archive_vectors.py
"""

from __future__ import annotations

import json
import struct
import sys
import zlib
from pathlib import Path

from farfield.store.archive.layout import (
    MAX_DIRECTORY_BYTES,
    VALUES_FROM,
    Entry,
    Header,
    Span,
    encode_directory,
    encode_header,
)
from farfield.store.archive.order import rank
from farfield.store.archive.writer import writing_archive

FOLDER = Path(__file__).parents[1] / "tests/vectors/archive"

TOTAL = 100_000
"""Bytes of the archive that the single directories are said to belong to."""


def values() -> dict[str, bytes]:
    """Keys of every kind, values of every size, in no order; some 300 in all."""
    found = {
        "world.json": b'{"format": "farfield-world"}',
        "attributes/00000000000000aa": b"",
        "mesh/00000000000000bb": b"m",
    }
    for level, reach in ((0, 4), (1, 2), (12, 1)):
        for x in range(-reach, reach):
            for y in range(-reach, reach):
                digest = f"{level:02x}{x & 255:02x}{y & 255:02x}" + "0123456789"
                found[f"index/{level}/{x}/{y}/0-{digest}"] = bytes([level, x & 255, y & 255]) * 9
                for direction in (4, 22):
                    tile = f"{level}/{x}/{y}/-1/{direction}/0-{digest}"
                    found[f"orthoview/{tile}"] = tile.encode() * (direction // 4)
                    found[f"objects/{tile}"] = tile.encode()[::-1]
    found["orthoview/0/999999999/-999999999/0/1/0-00000000000000cc"] = b"far"
    found["orthoview/0/1000000000/0/0/1/0-00000000000000cc"] = b"too far for a cell"
    return found


def write(folder: Path) -> None:
    """Writes `cells.farfield`, `cells.json` (its keys in order, and the CRC-32 of each value) and `damaged.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    archive = folder / "cells.farfield"
    archive.unlink(missing_ok=True)
    content = values()
    with writing_archive(archive, directory_keys=40) as writer:
        for key in sorted(content, key=rank):
            writer.put(key, content[key])
    expected = {key: zlib.crc32(content[key]) for key in sorted(content, key=rank)}
    (folder / "cells.json").write_text(json.dumps(expected, indent=1) + "\n", encoding="utf-8")
    cases = [{"what": what, "block": block.hex()} for what, block in damaged_directories().items()]
    heads = [{"what": what, "bytes": head.hex()} for what, head in damaged_headers().items()]
    text = json.dumps({"total": TOTAL, "directories": cases, "headers": heads}, indent=1) + "\n"
    (folder / "damaged.json").write_text(text, encoding="utf-8")


def damaged_directories() -> dict[str, bytes]:
    """What is wrong with a directory → its bytes."""
    one, two = Entry("mesh/aa", Span(VALUES_FROM, 5, 1)), Entry("mesh/bb", Span(VALUES_FROM + 5, 7, 2))
    good = encode_directory([one, two])
    columns = zlib.decompress(good[8:], -15)
    outside = one._replace(span=Span(TOTAL - 4, 5, 1))
    before = one._replace(span=Span(3, 5, 1))
    return {
        "nothing": b"",
        "half a header": good[:7],
        "cut short": good[:-3],
        "longer than it says": packed(columns + b"\0", 2, len(columns)),
        "shorter than it says": packed(columns, 2, len(columns) + 1),
        "larger than any may be": packed(columns, 2, MAX_DIRECTORY_BYTES + 1),
        "more entries than fit": packed(columns, 1000),
        "one entry more": packed(columns + bytes(8), 3),
        "one entry less": packed(columns, 1),
        "keys in the wrong order": encode_directory([two, one]),
        "the same key twice": encode_directory([one, one]),
        "beyond the end": encode_directory([outside]),
        "before the header's end": encode_directory([before]),
        "an endless number": packed(b"\xff" * 16, 1),
        "a key cut from nothing": packed(b"\x05" + columns[1:], 2),
        "no deflate": struct.pack("<II", 8, 1) + b"\xff" * 8,
    }


def damaged_headers() -> dict[str, bytes]:
    """What is wrong with a header → its bytes."""
    good = encode_header(Header(Span(44, 30, 7), TOTAL, 2))
    return {
        "cut short": good[:40],
        "altered": good[:30] + b"\1" + good[31:],
        "a root beyond the end": encode_header(Header(Span(TOTAL - 5, 30, 7), TOTAL, 2)),
        "a root within the header": encode_header(Header(Span(10, 30, 7), TOTAL, 2)),
    }


def packed(columns: bytes, count: int, length: int | None = None) -> bytes:
    """A directory of any columns, said to unpack to `length` bytes."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    body = packer.compress(columns) + packer.flush()
    return struct.pack("<II", len(columns) if length is None else length, count) + body


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
