"""Orthoview tiles: one depth layer of one view as bytes and back (spec/orthoview.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.kernels import fill, predict
from farfield.represent.orthoview import container, webp
from farfield.represent.orthoview.container import Plane, TileHeader
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.quality import Quality

MAGIC = b"FFOV"
DEPTH, COLOR, NORMAL, COVERAGE, FLAGS, UNLIT = 1, 2, 3, 4, 5, 6
"""Kinds of planes."""
FULL_AND_FLAT = 127
"""Coverage byte of a full pixel with a normal of length 1; a tile of nothing else leaves the plane out."""
CONNECTED_BIT, UNLIT_BIT = 1, 2
"""Bits of OrthoLayer.connected."""


@dataclass(frozen=True, slots=True)
class DecodedTile:
    """A tile read back."""

    layer: OrthoLayer
    direction: int
    """Direction number."""
    index: int
    """Depth layer, 0 or 1."""
    level: int


def encode_tile(layer: OrthoLayer, direction: int, index: int, level: int, preset: Quality) -> bytes:
    """The tile of one layer; the same layer gives the same bytes (with the same zlib and libwebp).

    Raises ValueError when the layer has no valid pixel, is larger than 4096 x 4096 or a number is out of its range.
    """
    height, width = layer.shape
    valid = layer.valid
    count = int(np.count_nonzero(valid))
    if count == 0:
        raise ValueError("a layer without any valid pixel makes no tile")
    header = TileHeader(direction, index, level, layer.x, layer.y, width, height, layer.depth_base, count)
    planes = [
        _depth_plane(layer, valid, count),
        Plane(COLOR, container.WEBP, _color(layer, valid, preset)),
        _normal_plane(layer, count, preset),
    ]
    coverage = _coverage_codes(layer, valid)
    if (coverage != FULL_AND_FLAT).any():
        planes.append(container.deflated(COVERAGE, coverage.tobytes()))
    flags = layer.connected[valid]
    for kind, bit in ((FLAGS, CONNECTED_BIT), (UNLIT, UNLIT_BIT)):
        if (flags & bit).any():
            planes.append(container.deflated(kind, np.packbits(flags & bit > 0).tobytes()))
    return container.pack(MAGIC, header, planes)


def _depth_plane(layer: OrthoLayer, valid: NDArray[np.bool_], count: int) -> Plane:
    residuals = np.empty((2, count), np.uint8)
    predict.depth_residuals(np.ascontiguousarray(layer.depth), residuals[0], residuals[1])
    changes = valid.copy()
    changes[1:] ^= valid[:-1]
    return container.deflated(DEPTH, np.packbits(changes).tobytes() + residuals.tobytes())


def _coverage_codes(layer: OrthoLayer, valid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    coverage, length = layer.coverage[valid] - np.uint8(1), layer.length[valid] - np.uint8(1)
    if coverage.max() > 15 or length.max() > 7:
        raise ValueError("a valid pixel has a coverage beyond 1..16 or a normal length beyond 1..8")
    return coverage * np.uint8(8) + length


def _color(layer: OrthoLayer, valid: NDArray[np.bool_], preset: Quality) -> bytes:
    filled = fill.fill_invalid(layer.color, valid)
    return webp.encode(filled, preset.webp_quality, preset.webp_method)


def _normal_plane(layer: OrthoLayer, count: int, preset: Quality) -> Plane:
    codes = np.ascontiguousarray(layer.normal)
    if codes.max() > 63:
        raise ValueError("a normal code is beyond 63")
    if preset.normal_bits < 6:
        codes = (codes + (codes < 32)) & np.uint8(62)
    residuals = np.empty((2, count), np.uint8)
    predict.normal_residuals(np.ascontiguousarray(layer.depth), codes, residuals[0], residuals[1])
    return container.deflated(NORMAL, residuals.tobytes())


def decode_tile(data: bytes, where: str = "") -> DecodedTile:
    """The layer of a tile, colour as the codec left it and 0 where nothing is; object ids are not in it.

    where: what messages call the tile, its key for example. Raises CorruptTileError for anything but a whole tile;
    allocates at most 64 bytes a pixel of the rectangle, which is at most 4096 x 4096.
    """
    header, planes = container.unpack(data, MAGIC, where)
    # Colour first: a picture as large as the header claims cannot be had for a few bytes, the other planes can.
    color = _decode_color(header, planes, where)
    depth = _decode_depth(header, planes, where)
    valid = depth > 0
    normal = _decode_normals(header, planes, depth, where)
    coverage, length = _decode_coverage(header, planes, valid, where)
    connected = _decode_bits(header, planes, FLAGS, "flags", valid, where) * np.uint8(CONNECTED_BIT)
    connected |= _decode_bits(header, planes, UNLIT, "unlit", valid, where) * np.uint8(UNLIT_BIT)
    color[~valid] = 0
    layer = OrthoLayer(header.x, header.y, header.depth_base, depth, color, normal, length, coverage, connected)
    return DecodedTile(layer, header.direction, header.index, header.level)


def _decode_depth(header: TileHeader, planes: Mapping[int, Plane], where: str) -> NDArray[np.uint16]:
    pixels, valid = header.width * header.height, header.valid
    mask_bytes = (pixels + 7) // 8
    content = np.frombuffer(container.inflated(planes, DEPTH, "depth", mask_bytes + 2 * valid, where), dtype=np.uint8)
    bits = np.unpackbits(content[:mask_bytes])
    mask = np.bitwise_xor.accumulate(bits[:pixels].reshape(header.height, header.width), axis=0)
    if bits[pixels:].any() or int(np.count_nonzero(mask)) != valid:
        raise CorruptTileError(f"the mask does not mark the {valid} valid pixels of the header", where)
    depth = np.zeros(mask.shape, np.uint16)
    if predict.restore_depth(mask, content[mask_bytes : mask_bytes + valid], content[mask_bytes + valid :], depth):
        raise CorruptTileError("a valid pixel has depth 0", where)
    return depth


def _decode_normals(
    header: TileHeader, planes: Mapping[int, Plane], depth: NDArray[np.uint16], where: str
) -> NDArray[np.uint8]:
    content = container.inflated(planes, NORMAL, "normal", 2 * header.valid, where)
    residuals = np.frombuffer(content, np.uint8).reshape(2, -1)
    if residuals.max() > 63:
        raise CorruptTileError("a residual of the normals is beyond 63", where)
    normal = np.zeros((*depth.shape, 2), np.uint8)
    predict.restore_normals(depth, residuals[0], residuals[1], normal)
    return normal


def _decode_coverage(
    header: TileHeader, planes: Mapping[int, Plane], valid: NDArray[np.bool_], where: str
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    if COVERAGE not in planes:
        return valid * np.uint8(16), np.full(valid.shape, 8, np.uint8)
    codes = np.frombuffer(container.inflated(planes, COVERAGE, "coverage", header.valid, where), np.uint8)
    if codes.max() > FULL_AND_FLAT:
        raise CorruptTileError("a coverage byte is beyond 127", where)
    coverage, length = np.zeros(valid.shape, np.uint8), np.full(valid.shape, 8, np.uint8)
    coverage[valid] = (codes >> 3) + 1
    length[valid] = (codes & 7) + 1
    return coverage, length


def _decode_bits(
    header: TileHeader, planes: Mapping[int, Plane], kind: int, name: str, valid: NDArray[np.bool_], where: str
) -> NDArray[np.uint8]:
    spread = np.zeros(valid.shape, np.uint8)
    if kind in planes:
        content = container.inflated(planes, kind, name, (header.valid + 7) // 8, where)
        bits = np.unpackbits(np.frombuffer(content, np.uint8))
        if bits[header.valid :].any():
            raise CorruptTileError(f"the {name} plane marks more than the valid pixels", where)
        spread[valid] = bits[: header.valid]
    return spread


def _decode_color(header: TileHeader, planes: Mapping[int, Plane], where: str) -> NDArray[np.uint8]:
    plane = planes.get(COLOR)
    if plane is None or plane.codec != container.WEBP:
        raise CorruptTileError("has no colour plane that can be read", where)
    return webp.decode(plane.stored, header.width, header.height, where)
