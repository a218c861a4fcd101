"""BlockMaps as bytes (spec/blockmap.md): heights, slopes and normals deflated, colours as one lossy WebP image.

What follows from the heights, where walls are and how far rays may leap, is found out again by whoever reads it.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.inflate import inflate
from farfield.represent.blockmap.blockmap import SIZES, TURNS, BlockMap, BlockMapSize
from farfield.represent.blockmap.unfolding import DENSITIES
from farfield.represent.orthoview import webp

MAGIC, OBJECTS_MAGIC = b"FFBM", b"FFBO"
VERSION = 1
BY_AREA, SLOPED, FLOORED = 1, 2, 4
"""Flags."""
WEBP_METHOD = 4
"""Effort: with 6 images of 320 x 64 are 1 % smaller, in twice the time."""
_HEADER = struct.Struct("<4sHBBHBBHHffIIII")
_CRC_AT = _HEADER.size - 4
_OBJECTS = struct.Struct("<4sHBBII")
_HINT = "run farfield verify"


def encode_blockmap(blockmap: BlockMap, webp_quality: int) -> bytes:
    """The bytes of a BlockMap; its object ids apart (`encode_objects`). webp_quality: 0..100, of colours."""
    size = blockmap.size
    floors = b"" if blockmap.floors is None else blockmap.floors.tobytes()
    rim = np.packbits(blockmap.border, bitorder="little").tobytes()
    heights = _deflated(blockmap.codes.tobytes(), rim, floors)
    slopes = b"" if blockmap.slopes is None else _deflated(np.moveaxis(blockmap.slopes, 2, 0).tobytes())
    normals = _deflated(blockmap.turns.tobytes())
    colors = webp.encode(blockmap.colors, webp_quality, WEBP_METHOD)
    flags = BY_AREA * blockmap.by_area + SLOPED * bool(slopes) + FLOORED * bool(floors)
    head = _HEADER.pack(
        MAGIC, VERSION, size.side, flags, size.columns, blockmap.density, blockmap.least, blockmap.scale, 0,
        blockmap.low, blockmap.step, len(heights), len(slopes), len(normals), 0,
    )  # fmt: skip
    body = heights + slopes + normals + colors
    return head[:_CRC_AT] + struct.pack("<I", zlib.crc32(head + body)) + body


def _deflated(*parts: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(b"".join(parts)) + packer.flush()


def decode_blockmap(data: bytes, where: str) -> BlockMap:
    """Reads a BlockMap, without its object ids. Raises CorruptTileError for anything else.

    Allocates at most 64 bytes for each texel that the header declares, of which there are 64 x 320 at most.
    """
    if len(data) < _HEADER.size:
        raise CorruptTileError("BlockMap is cut short", where, _HINT)
    magic, version, side, flags, columns, density, least, scale, reserved, low, step, *lengths, checksum = (
        _HEADER.unpack_from(data)
    )
    if magic != MAGIC or version != VERSION or reserved:
        raise CorruptTileError("not a BlockMap of a known version", where, _HINT)
    if zlib.crc32(data[_CRC_AT + 4 :], zlib.crc32(bytes(4), zlib.crc32(data[:_CRC_AT]))) != checksum:
        raise CorruptTileError("BlockMap is damaged: its checksum is another", where, _HINT)
    size = BlockMapSize(side, columns)
    is_sane = size in SIZES and flags < 8 and density < len(DENSITIES) and least > 0 and scale > 0
    is_sane = is_sane and math.isfinite(low) and 0 < step < 1e9 and bool(flags & SLOPED) == (lengths[1] > 0)
    if not is_sane or sum(lengths) > len(data) - _HEADER.size:
        raise CorruptTileError("BlockMap tells what cannot be", where, _HINT)
    heights, slopes, turns, colors = _parts(data[_HEADER.size :], lengths)
    n = side
    try:
        floored = n * n if flags & FLOORED else 0
        plain = np.frombuffer(inflate(heights, n * n + n // 2 + floored), np.uint8)
        if not plain[: n * n].any():
            raise CorruptTileError("BlockMap of nothing", where, _HINT)
        bits = np.unpackbits(plain[n * n : n * n + n // 2], bitorder="little").reshape(4, n)
        codes, floors = plain[: n * n], plain[n * n + n // 2 :]
        if floored and (floors > codes).any():
            raise CorruptTileError("BlockMap has floors above its tops", where, _HINT)
        sloped = None
        if flags & SLOPED:
            sloped = np.frombuffer(inflate(slopes, 2 * n * n), np.int8).reshape(2, n, n).transpose(1, 2, 0).copy()
        found = BlockMap(
            size, low, step, codes.reshape(n, n).copy(), sloped, bits, least, density, scale,
            bool(flags & BY_AREA), webp.decode(colors, n + columns, n, where), np.empty(0, np.uint8),
            floors=floors.reshape(n, n).copy() if floored else None,
        )  # fmt: skip
        if found.unfolded.rows > n:
            raise CorruptTileError("BlockMap has more walls than its image", where, _HINT)
        normals = np.frombuffer(inflate(turns, len(found.unfolded.sides)), np.uint8)
        if (normals >= TURNS).any():
            raise CorruptTileError("BlockMap has walls turned too far", where, _HINT)
        return found.with_turns(normals.copy())
    except zlib.error as error:
        raise CorruptTileError(f"BlockMap is damaged: {error}", where, _HINT) from None


def _parts(body: bytes, lengths: list[int]) -> list[bytes]:
    parts = []
    for length in lengths:
        parts.append(body[:length])
        body = body[length:]
    return [*parts, body]


def encode_objects(objects: NDArray[np.uint32]) -> bytes:
    """The object ids of the texels of a BlockMap, (n, n): those that there are, and which of them each has."""
    ids, which = np.unique(objects, return_inverse=True)
    numbers = which.astype("<u2").reshape(-1, 1).view(np.uint8)
    content = _deflated(ids.astype("<u4").tobytes(), numbers[:, 0].tobytes(), numbers[:, 1].tobytes())
    head = _OBJECTS.pack(OBJECTS_MAGIC, VERSION, objects.shape[0], 0, len(ids), 0)
    return head[:-4] + struct.pack("<I", zlib.crc32(head + content)) + content


def with_objects(blockmap: BlockMap, data: bytes, where: str) -> BlockMap:
    """The same with its object ids. Raises CorruptTileError for anything else, and for those of another size."""
    objects = decode_objects(data, where)
    if objects.shape != blockmap.codes.shape:
        raise CorruptTileError("object ids of another BlockMap", where, _HINT)
    return replace(blockmap, objects=objects)


def decode_objects(data: bytes, where: str) -> NDArray[np.uint32]:
    """(n, n) object ids of the texels of a BlockMap. Raises CorruptTileError for anything else."""
    if len(data) < _OBJECTS.size:
        raise CorruptTileError("object ids are cut short", where, _HINT)
    magic, version, side, reserved, count, checksum = _OBJECTS.unpack_from(data)
    if magic != OBJECTS_MAGIC or version != VERSION or reserved or side not in {size.side for size in SIZES}:
        raise CorruptTileError("not the object ids of a BlockMap", where, _HINT)
    if zlib.crc32(data[16:], zlib.crc32(bytes(4), zlib.crc32(data[:12]))) != checksum or not 0 < count <= side * side:
        raise CorruptTileError("object ids are damaged", where, _HINT)
    try:
        content = np.frombuffer(inflate(data[16:], 4 * count + 2 * side * side), np.uint8)
    except zlib.error as error:
        raise CorruptTileError(f"object ids are damaged: {error}", where, _HINT) from None
    ids = content[: 4 * count].view("<u4")
    low, high = content[4 * count :].reshape(2, -1).astype(np.int64)
    which = low + 256 * high
    if which.max() >= count:
        raise CorruptTileError("object ids are damaged", where, _HINT)
    return np.asarray(ids[which].reshape(side, side), np.uint32)
