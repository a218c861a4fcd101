"""Orthoview tiles: one depth layer of one view as bytes and back (spec/orthoview.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.kernels import fill, predict, valid
from farfield.represent.orthoview import container, planes, webp
from farfield.represent.orthoview.container import Plane, TileHeader
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.planes import COLOR, COVERAGE, DEPTH, FLAGS, NORMAL, UNLIT, PlaneReader
from farfield.represent.orthoview.quality import Quality

MAGIC = b"FFOV"
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
    mask = np.ascontiguousarray(layer.valid)
    count = int(np.count_nonzero(mask))
    if count == 0:
        raise ValueError("a layer without any valid pixel makes no tile")
    header = TileHeader(direction, index, level, layer.x, layer.y, width, height, layer.depth_base, count)
    residuals, turns = np.empty(count, np.uint16), np.empty((2, count), np.uint8)
    predict.depth_residuals(np.ascontiguousarray(layer.depth), residuals)
    predict.normal_residuals(np.ascontiguousarray(layer.depth), _normal_codes(layer, preset), turns[0], turns[1])
    places = planes.places_of(mask, count)
    beside, around = planes.near_of(layer.depth[mask], places)
    stored = {
        DEPTH: planes.depth_plane(mask, places, residuals),
        COLOR: _color(layer, mask, preset),
        NORMAL: planes.normal_plane(places, residuals, turns),
    }
    coverage = _coverage_codes(layer, mask)
    if (coverage != FULL_AND_FLAT).any():
        stored[COVERAGE] = planes.coverage_plane(places, beside, turns, coverage)
    flags = layer.connected[mask]
    for kind, bit in ((FLAGS, CONNECTED_BIT), (UNLIT, UNLIT_BIT)):
        bits = (flags & bit > 0).astype(np.uint8)
        if bits.any():
            stored[kind] = planes.bits_plane(places, around, bits)
    codecs = {COLOR: container.WEBP}
    listed = [Plane(kind, codecs.get(kind, container.CODED), plane) for kind, plane in stored.items()]
    return container.pack(MAGIC, header, listed)


def _coverage_codes(layer: OrthoLayer, mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    coverage, length = layer.coverage[mask] - np.uint8(1), layer.length[mask] - np.uint8(1)
    if coverage.max() > 15 or length.max() > 7:
        raise ValueError("a valid pixel has a coverage beyond 1..16 or a normal length beyond 1..8")
    return coverage * np.uint8(8) + length


def _color(layer: OrthoLayer, mask: NDArray[np.bool_], preset: Quality) -> bytes:
    filled = fill.fill_invalid(layer.color, mask)
    return webp.encode(filled, preset.webp_quality, preset.webp_method)


def _normal_codes(layer: OrthoLayer, preset: Quality) -> NDArray[np.uint8]:
    codes = np.ascontiguousarray(layer.normal)
    if codes.max() > 63:
        raise ValueError("a normal code is beyond 63")
    return (codes + (codes < 32)) & np.uint8(62) if preset.normal_bits < 6 else codes


def decode_tile(data: bytes, where: str = "", flags: bool = True) -> DecodedTile:
    """The layer of a tile, colour as the codec left it and 0 where nothing is; object ids are not in it.

    where: what messages call the tile, its key for example. flags: False leaves out what is connected, which parents
    tell anew, and a sixteenth of the time. Raises CorruptTileError for anything but a whole tile;
    allocates at most 64 bytes a pixel of the rectangle, which is at most 4096 x 4096, and 1 MB.
    """
    header, stored = container.unpack(data, MAGIC, where)
    # Colour first: a picture as large as the header claims cannot be had for a few bytes, the other planes can.
    color = _decode_color(header, stored, where)
    reader = PlaneReader(header, stored, where)
    mask, residuals = reader.depth()
    depth, listed = np.zeros(mask.shape, np.uint16), np.empty(header.valid, np.uint16)
    if predict.restore_depth(mask, residuals, depth, listed):
        raise CorruptTileError("a valid pixel has depth 0", where)
    turns = reader.normals()
    normal = np.zeros((*depth.shape, 2), np.uint8)
    predict.restore_normals(depth, turns[0], turns[1], normal)
    reader.know_depth(listed)
    codes = reader.coverage() if COVERAGE in stored else np.full(header.valid, FULL_AND_FLAT, np.uint8)
    bits = np.zeros(header.valid, np.uint8)
    if flags and FLAGS in stored:
        bits |= reader.bits(FLAGS, "flags") * np.uint8(CONNECTED_BIT)
    if UNLIT in stored:
        bits |= reader.bits(UNLIT, "unlit") * np.uint8(UNLIT_BIT)
    coverage, length, connected = np.empty((3, *mask.shape), np.uint8)
    valid.place(mask, codes, bits, coverage, length, connected, color)
    layer = OrthoLayer(header.x, header.y, header.depth_base, depth, color, normal, length, coverage, connected)
    return DecodedTile(layer, header.direction, header.index, header.level)


def _decode_color(header: TileHeader, stored: Mapping[int, Plane], where: str) -> NDArray[np.uint8]:
    plane = stored.get(COLOR)
    if plane is None or plane.codec != container.WEBP:
        raise CorruptTileError("has no colour plane that can be read", where)
    return webp.decode(plane.stored, header.width, header.height, where)
