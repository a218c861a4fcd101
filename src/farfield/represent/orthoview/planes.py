"""Planes of a tile: which models their symbols have (spec/orthoview.md, Planes and Codec 3).

Values are per valid pixel, in valid order: `places` (valid, 4) int32 where the neighbours stand, `residuals` (valid,)
uint16 of depth, `turns` (2, valid) uint8 of both coordinates of the normals.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.kernels import contexts, valid
from farfield.represent.orthoview.coding import Model, Reader, coded
from farfield.represent.orthoview.container import CODED, Plane, TileHeader, inflated

DEPTH, COLOR, NORMAL, COVERAGE, FLAGS, UNLIT = 1, 2, 3, 4, 5, 6
"""Kinds of planes."""

_DEPTH = (Model(contexts.MASK_CONTEXTS, 2), Model(contexts.DEPTH_CONTEXTS, contexts.DEPTH_SYMBOLS))
_NORMAL = (Model(contexts.NORMAL_CONTEXTS, contexts.NORMAL_SYMBOLS),)
_COVERAGE = (Model(contexts.COVERAGE_CONTEXTS, 16), Model(contexts.LENGTH_CONTEXTS, 8))
_BITS = (Model(contexts.BIT_CONTEXTS, 2),)
_OBJECTS = (Model(contexts.OBJECT_CONTEXTS, contexts.OBJECT_SYMBOLS), Model(1, contexts.NUMBER_SYMBOLS))

Places = NDArray[np.int32]
Bytes = NDArray[np.uint8]


def places_of(mask: NDArray[np.bool_], count: int) -> Places:
    """Where the neighbours of the `count` valid pixels of a mask stand."""
    places = np.empty((count, 4), np.int32)
    valid.list_neighbours(mask, places)
    return places


def near_of(depth: NDArray[np.uint16], places: Places) -> tuple[Bytes, Bytes]:
    """(valid,) of the four and of the eight neighbours those that are near, valid.count_near; depth: (valid,)."""
    beside, around = np.zeros((2, len(depth)), np.uint8)
    valid.count_near(depth, places, beside, around)
    return beside, around


def depth_plane(mask: NDArray[np.bool_], places: Places, residuals: NDArray[np.uint16]) -> bytes:
    """Mask and depth."""
    room = mask.size + 3 * len(residuals)
    framed = np.pad(mask, ((contexts.MARGIN, 0), (contexts.MARGIN, contexts.MARGIN)))
    context, symbol = np.empty(room, np.uint16), np.empty(room, np.uint8)
    count = contexts.depth_symbols(framed, places, residuals, context, symbol)
    return coded(_DEPTH, context[:count], symbol[:count])


def normal_plane(places: Places, residuals: NDArray[np.uint16], turns: Bytes) -> bytes:
    """Both coordinates of the normals."""
    context, symbol = np.empty(turns.size, np.uint16), np.empty(turns.size, np.uint8)
    contexts.normal_symbols(places, residuals, turns[0], turns[1], context, symbol)
    return coded(_NORMAL, context, symbol)


def coverage_plane(places: Places, beside: Bytes, turns: Bytes, codes: Bytes) -> bytes:
    """Coverage and length of normals; codes: (valid,) as the format has them, beside: of near_of."""
    context, symbol = np.empty(2 * len(codes), np.uint16), np.empty(2 * len(codes), np.uint8)
    contexts.coverage_symbols(places, beside, turns[0], turns[1], codes, context, symbol)
    return coded(_COVERAGE, context, symbol)


def bits_plane(places: Places, around: Bytes, bits: Bytes) -> bytes:
    """A bit a pixel; bits: (valid,) 0 or 1, around: of near_of."""
    context = np.empty(len(bits), np.uint16)
    contexts.bit_contexts(places, around, bits, context)
    return coded(_BITS, context, bits)


def object_plane(places: Places, ids: NDArray[np.uint32]) -> bytes:
    """Object ids; ids: (valid,)."""
    context, symbol = np.empty(7 * len(ids), np.uint16), np.empty(7 * len(ids), np.uint8)
    count = contexts.object_symbols(places, ids, context, symbol)
    return coded(_OBJECTS, context[:count], symbol[:count])


def read_objects(plane: bytes, places: Places, where: str) -> NDArray[np.uint32]:
    """(valid,) object ids. Raises CorruptTileError for anything but what object_plane writes."""
    reader = Reader(_OBJECTS, plane, "objects", where)
    ids = np.empty(len(places), np.uint32)
    missing = contexts.read_objects(*reader.arguments, places, ids)
    reader.finish()
    if missing:
        raise CorruptTileError("objects plane names neighbours that are not there", where)
    return ids


class PlaneReader:
    """The planes of one tile: depth first, then normals, then what is known of depth, then the others.

    Planes may be coded, or deflated or raw as in tiles before 2026-11-25. Every method raises CorruptTileError for
    anything but what a writer makes.
    """

    def __init__(self, header: TileHeader, planes: Mapping[int, Plane], where: str) -> None:
        self._header, self._planes, self._where = header, planes, where
        self._shape = header.height, header.width

    def depth(self) -> tuple[NDArray[np.bool_], NDArray[np.uint16]]:
        """(h, w) mask, and residuals."""
        coded_plane = self._coded(DEPTH)
        if coded_plane is None:
            mask, self._residuals = self._plain_depth()
        else:
            reader = Reader(_DEPTH, coded_plane, "depth", self._where)
            rows, columns = self._shape
            framed = np.zeros((rows + contexts.MARGIN, columns + 2 * contexts.MARGIN), np.bool_)
            self._check(contexts.read_mask(*reader.arguments, framed))
            mask = np.ascontiguousarray(framed[contexts.MARGIN :, contexts.MARGIN : -contexts.MARGIN])
        self._places = places_of(mask, self._header.valid)
        if coded_plane is not None:
            self._residuals = np.empty(self._header.valid, np.uint16)
            contexts.read_depth(*reader.arguments, self._places, self._residuals)
            reader.finish()
        return mask, self._residuals

    def _plain_depth(self) -> tuple[NDArray[np.bool_], NDArray[np.uint16]]:
        pixels, count = self._header.width * self._header.height, self._header.valid
        mask_bytes = (pixels + 7) // 8
        content = self._plain(DEPTH, "depth", mask_bytes + 2 * count)
        bits = np.unpackbits(content[:mask_bytes])
        mask = np.bitwise_xor.accumulate(bits[:pixels].reshape(self._shape), axis=0).astype(np.bool_)
        self._check(-1 if bits[pixels:].any() else int(np.count_nonzero(mask)))
        high, low = content[mask_bytes:].reshape(2, -1)
        return mask, high.astype(np.uint16) << np.uint16(8) | low

    def _check(self, count: int) -> None:
        if count != self._header.valid:
            message = f"the mask does not mark the {self._header.valid} valid pixels of the header"
            raise CorruptTileError(message, self._where)

    def normals(self) -> Bytes:
        """The turns."""
        plane = self._coded(NORMAL)
        if plane is None:
            self._turns = self._plain(NORMAL, "normal", 2 * self._header.valid).reshape(2, -1)
            if self._turns.max() > 63:
                raise CorruptTileError("a residual of the normals is beyond 63", self._where)
            return self._turns
        reader = Reader(_NORMAL, plane, "normal", self._where)
        self._turns = np.empty((2, self._header.valid), np.uint8)
        contexts.read_normals(*reader.arguments, self._places, self._residuals, self._turns[0], self._turns[1])
        reader.finish()
        return self._turns

    def know_depth(self, depth: NDArray[np.uint16]) -> None:
        """What the planes below need; depth: (valid,)."""
        self._beside, self._around = near_of(depth, self._places)

    def coverage(self) -> Bytes:
        """(valid,) codes 0..127."""
        plane = self._coded(COVERAGE)
        if plane is None:
            codes = self._plain(COVERAGE, "coverage", self._header.valid)
            if codes.max() > 127:
                raise CorruptTileError("a coverage byte is beyond 127", self._where)
            return codes
        reader = Reader(_COVERAGE, plane, "coverage", self._where)
        codes = np.empty(self._header.valid, np.uint8)
        contexts.read_coverage(*reader.arguments, self._places, self._beside, self._turns[0], self._turns[1], codes)
        reader.finish()
        return codes

    def bits(self, kind: int, name: str) -> Bytes:
        """(valid,) 0 or 1."""
        plane, count = self._coded(kind), self._header.valid
        if plane is None:
            bits = np.unpackbits(self._plain(kind, name, (count + 7) // 8))
            if bits[count:].any():
                raise CorruptTileError(f"the {name} plane marks more than the valid pixels", self._where)
            return bits[:count]
        reader = Reader(_BITS, plane, name, self._where)
        bits = np.empty(count, np.uint8)
        contexts.read_bits(*reader.arguments, self._places, self._around, bits)
        reader.finish()
        return bits

    def _coded(self, kind: int) -> bytes | None:
        plane = self._planes.get(kind)
        return plane.stored if plane is not None and plane.codec == CODED else None

    def _plain(self, kind: int, name: str, size: int) -> Bytes:
        return np.frombuffer(inflated(self._planes, kind, name, size, self._where), np.uint8)
