"""What the planes of a tile are coded as: symbols, and the context that tells their probabilities (spec/orthoview.md).

A residual is as large as those beside it. Every plane has a kernel that lists its symbols and one that reads them back;
both take the context from the same function of what a reader has by then.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from farfield.kernels.compiling import device, kernel
from farfield.kernels.rans import BITS, pull, pull_bits

MASK_CONTEXTS, DEPTH_CONTEXTS, DEPTH_SYMBOLS = 128, 96, 40
NORMAL_CONTEXTS, NORMAL_SYMBOLS = 64, 64
COVERAGE_CONTEXTS, LENGTH_CONTEXTS = 48, 40
BIT_CONTEXTS = 144
OBJECT_CONTEXTS, OBJECT_SYMBOLS = 32, 5
NUMBER_SYMBOLS = 33


def _steps(limits: tuple[int, ...], size: int) -> NDArray[np.uint8]:
    return np.searchsorted(np.array(limits), np.arange(size), side="right").astype(np.uint8)


_DEPTH_STEPS = _steps((1, 2, 4, 6, 9, 12, 16, 22, 30, 42, 60, 90, 150, 300, 800), 2048)
_NORMAL_STEPS = _steps((1, 3, 6, 9, 13, 18, 24, 32, 42, 56, 75, 100, 140, 200, 280), 1024)
_TURN_STEPS = _steps((1, 3, 6, 12), 128)
_LENGTH_STEPS = _steps((8, 12, 14), 16)
MARGIN = 2
"""Empty rows above a mask, and columns on both sides: tests for borders in every pixel take twice the time."""
_SMALL = 16
"""Residuals of depth below this are a symbol each."""

_MASK = types.Array(types.boolean, 2, "C", readonly=True)
_PLACES = types.Array(types.int32, 2, "C", readonly=True)
_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_WORDS = types.Array(types.uint16, 1, "C", readonly=True)
_OF = types.Array(types.int32, 1, "C", readonly=True)
_SLOTS = types.Array(types.uint32, 2, "C", readonly=True)
_IDS = types.Array(types.uint32, 1, "C", readonly=True)
_CURSOR = types.int64[::1]
_CONTEXTS = types.uint16[::1]
_SYMBOLS = types.uint8[::1]


@device
def _around(mask, y, x):  # type: ignore[no-untyped-def]
    """Context of bit (y, x) of a mask with MARGIN empty rows above and columns beside it: seven bits before it."""
    context = types.int64(mask[y + 2, x + 1]) | (types.int64(mask[y + 1, x + 2]) << 1)
    context |= (types.int64(mask[y + 1, x + 1]) << 2) | (types.int64(mask[y + 1, x + 3]) << 3)
    context |= (types.int64(mask[y + 2, x]) << 4) | (types.int64(mask[y, x + 2]) << 5)
    return context | (types.int64(mask[y + 1, x + 4]) << 6)


@device
def _depth_size(residual):  # type: ignore[no-untyped-def]
    """How large a zigzag residual is, at most 255."""
    return min((types.int64(residual) + 1) >> 1, types.int64(255))


@device
def _code_size(residual):  # type: ignore[no-untyped-def]
    """How large a residual modulo 64 is, 0..32."""
    r = types.int64(residual)
    return r if r < 32 else 64 - r


@device
def _depth_context(places, k, residuals):  # type: ignore[no-untyped-def]
    weight = types.int64(0)
    size = types.int64(0)
    for side in range(4):
        other = places[k, side]
        if other >= 0:
            share = 2 if side < 2 else 1
            weight += share
            size += share * _depth_size(residuals[other])
    if weight < 6:
        size = size * 6 // weight if weight > 0 else types.int64(1)
    north = places[k, 1]
    sign = types.int64(1)
    if north >= 0 and residuals[north] != 0:
        sign = types.int64(2) - 2 * (types.int64(residuals[north]) & 1)
    both = types.int64(places[k, 0] >= 0 and north >= 0)
    return MASK_CONTEXTS + (both * 16 + types.int64(_DEPTH_STEPS[size])) * 3 + sign


@device
def _turn(places, k, first, second):  # type: ignore[no-untyped-def]
    """How large the residuals of normals beside pixel k are, in sixths."""
    weight = types.int64(0)
    size = types.int64(0)
    for side in range(4):
        other = places[k, side]
        if other >= 0:
            share = 2 if side < 2 else 1
            weight += share
            size += share * (_code_size(first[other]) + _code_size(second[other]))
    if weight < 6:
        size = size * 6 // weight if weight > 0 else types.int64(12)
    return size


@device
def _first_context(turn, depth_residual):  # type: ignore[no-untyped-def]
    return types.int64(_NORMAL_STEPS[turn + 2 * min(_depth_size(depth_residual), types.int64(32))])


@device
def _second_context(turn, first):  # type: ignore[no-untyped-def]
    r = types.int64(first)
    sign = types.int64(1)
    if r != 0:
        sign = types.int64(2) if r < 32 else types.int64(0)
    return 16 + sign * 16 + types.int64(_NORMAL_STEPS[turn + 4 * _code_size(first)])


@device
def _filled(places, k, side, codes):  # type: ignore[no-untyped-def]
    """How full a neighbour is: 0 nothing there, 1 full, 2 more than half, 3 less."""
    other = places[k, side]
    if other < 0:
        return types.int64(0)
    coverage = types.int64(codes[other]) >> 3
    if coverage == 15:
        return types.int64(1)
    return types.int64(2) if coverage >= 8 else types.int64(3)


@device
def _coverage_context(places, k, codes, beside):  # type: ignore[no-untyped-def]
    open_sides = min(types.int64(4) - types.int64(beside[k]), types.int64(2))
    return open_sides * 16 + _filled(places, k, 0, codes) * 4 + _filled(places, k, 1, codes)


@device
def _length_context(places, k, codes, coverage, first, second):  # type: ignore[no-untyped-def]
    west = places[k, 0]
    north = places[k, 1]
    lengths = types.int64(codes[west] & 7) if west >= 0 else types.int64(7)
    lengths += types.int64(codes[north] & 7) if north >= 0 else types.int64(7)
    turn = types.int64(_TURN_STEPS[_code_size(first[k]) + _code_size(second[k])])
    full = types.int64(coverage == 15)
    return COVERAGE_CONTEXTS + (turn * 2 + full) * 4 + types.int64(_LENGTH_STEPS[lengths])


@device
def _bit_context(places, k, bits, around):  # type: ignore[no-untyped-def]
    context = types.int64(around[k]) * 16
    for side in range(4):
        other = places[k, side]
        if other >= 0:
            context |= types.int64(bits[other]) << side
    return context


@kernel(types.int64(_MASK, _PLACES, _WORDS, _CONTEXTS, _SYMBOLS))
def depth_symbols(mask, places, residuals, contexts, symbols):  # type: ignore[no-untyped-def]
    """Lists the bits of the mask and then the residuals of depth; returns how many symbols that are.

    mask: (2 + h, 2 + w + 2) bool with its margin. places: (valid, 4), list_neighbours. residuals: (valid,) uint16,
    zigzag. contexts, symbols: (h w + 3 valid,) written.
    """
    n = 0
    for y in range(mask.shape[0] - MARGIN):
        for x in range(mask.shape[1] - 2 * MARGIN):
            contexts[n] = _around(mask, y, x)
            symbols[n] = mask[y + MARGIN, x + MARGIN]
            n += 1
    for k in range(len(residuals)):
        z = types.int64(residuals[k])
        contexts[n] = _depth_context(places, k, residuals)
        if z < _SMALL:
            symbols[n] = z
            n += 1
            continue
        exponent = 4
        while z >> (exponent + 1):
            exponent += 1
        bits = exponent - 1
        symbols[n] = _SMALL + 2 * (exponent - 4) + ((z >> bits) & 1)
        n += 1
        if bits > 7:
            contexts[n] = BITS + bits - 7
            symbols[n] = (z >> 7) & ((1 << (bits - 7)) - 1)
            n += 1
            bits = 7
        contexts[n] = BITS + bits
        symbols[n] = z & ((1 << bits) - 1)
        n += 1
    return n


@kernel(types.int64(_BYTES, _OF, _SLOTS, _CURSOR, types.boolean[:, ::1]))
def read_mask(stream, table, slots, cursor, mask):  # type: ignore[no-untyped-def]
    """Reads the mask; returns how many pixels are valid.

    stream and tables: of coding.Reader. cursor: (2,) int64 state and place in the stream, moved on. mask:
    (2 + h, 2 + w + 2) bool with its margin, all False, written.
    """
    state = cursor[0]
    at = cursor[1]
    valid = 0
    for y in range(mask.shape[0] - MARGIN):
        for x in range(mask.shape[1] - 2 * MARGIN):
            bit, state, at = pull(state, at, stream, slots, table[_around(mask, y, x)])
            mask[y + MARGIN, x + MARGIN] = bit != 0
            valid += bit
    cursor[0] = state
    cursor[1] = at
    return valid


@kernel(types.void(_BYTES, _OF, _SLOTS, _CURSOR, _PLACES, types.uint16[::1]))
def read_depth(stream, table, slots, cursor, places, residuals):  # type: ignore[no-untyped-def]
    """Reads the residuals of depth that follow the mask. residuals: (valid,) uint16, written."""
    state = cursor[0]
    at = cursor[1]
    for k in range(len(residuals)):
        row = table[_depth_context(places, k, residuals)]
        z, state, at = pull(state, at, stream, slots, row)
        if z >= _SMALL:
            bits = ((z - _SMALL) >> 1) + 3
            z = 2 | (z & 1)
            if bits > 7:
                more, state, at = pull_bits(state, at, stream, bits - 7)
                z = (z << (bits - 7)) | more
                bits = types.int64(7)
            more, state, at = pull_bits(state, at, stream, bits)
            z = (z << bits) | more
        residuals[k] = z
    cursor[0] = state
    cursor[1] = at


@kernel(types.void(_PLACES, _WORDS, _BYTES, _BYTES, _CONTEXTS, _SYMBOLS))
def normal_symbols(places, depth_residuals, first, second, contexts, symbols):  # type: ignore[no-untyped-def]
    """Lists the residuals of both coordinates, pixel by pixel.

    first, second: (valid,) uint8 residuals 0..63. contexts, symbols: (2 valid,) written.
    """
    for k in range(len(first)):
        turn = _turn(places, k, first, second)
        contexts[2 * k] = _first_context(turn, depth_residuals[k])
        symbols[2 * k] = first[k]
        contexts[2 * k + 1] = _second_context(turn, first[k])
        symbols[2 * k + 1] = second[k]


@kernel(types.void(_BYTES, _OF, _SLOTS, _CURSOR, _PLACES, _WORDS, _SYMBOLS, _SYMBOLS))
def read_normals(stream, table, slots, cursor, places, depth_residuals, first, second):  # type: ignore[no-untyped-def]
    """Reads what normal_symbols lists. first, second: (valid,) uint8, written."""
    state = cursor[0]
    at = cursor[1]
    for k in range(len(first)):
        turn = _turn(places, k, first, second)
        row = table[_first_context(turn, depth_residuals[k])]
        residual, state, at = pull(state, at, stream, slots, row)
        first[k] = residual
        row = table[_second_context(turn, residual)]
        residual, state, at = pull(state, at, stream, slots, row)
        second[k] = residual
    cursor[0] = state
    cursor[1] = at


@kernel(types.void(_PLACES, _BYTES, _BYTES, _BYTES, _BYTES, _CONTEXTS, _SYMBOLS))
def coverage_symbols(places, beside, first, second, codes, contexts, symbols):  # type: ignore[no-untyped-def]
    """Lists coverage and length of the normal, pixel by pixel.

    beside: of count_near. first, second: residuals of normals. codes: (valid,) uint8, coverage - 1 times 8 and length
    - 1. contexts, symbols: (2 valid,) written.
    """
    for k in range(len(codes)):
        coverage = types.int64(codes[k]) >> 3
        contexts[2 * k] = _coverage_context(places, k, codes, beside)
        symbols[2 * k] = coverage
        contexts[2 * k + 1] = _length_context(places, k, codes, coverage, first, second)
        symbols[2 * k + 1] = codes[k] & 7


@kernel(types.void(_BYTES, _OF, _SLOTS, _CURSOR, _PLACES, _BYTES, _BYTES, _BYTES, _SYMBOLS))
def read_coverage(stream, table, slots, cursor, places, beside, first, second, codes):  # type: ignore[no-untyped-def]
    """Reads what coverage_symbols lists. codes: (valid,) uint8, written."""
    state = cursor[0]
    at = cursor[1]
    for k in range(len(codes)):
        row = table[_coverage_context(places, k, codes, beside)]
        coverage, state, at = pull(state, at, stream, slots, row)
        row = table[_length_context(places, k, codes, coverage, first, second)]
        length, state, at = pull(state, at, stream, slots, row)
        codes[k] = coverage * 8 + length
    cursor[0] = state
    cursor[1] = at


@kernel(types.void(_PLACES, _BYTES, _BYTES, _CONTEXTS))
def bit_contexts(places, around, bits, contexts):  # type: ignore[no-untyped-def]
    """Contexts of a plane of bits. around: of count_near. bits: (valid,) uint8 0 or 1. contexts: (valid,) written."""
    for k in range(len(bits)):
        contexts[k] = _bit_context(places, k, bits, around)


@kernel(types.void(_BYTES, _OF, _SLOTS, _CURSOR, _PLACES, _BYTES, _SYMBOLS))
def read_bits(stream, table, slots, cursor, places, around, bits):  # type: ignore[no-untyped-def]
    """Reads a plane of bits. bits: (valid,) uint8, written."""
    state = cursor[0]
    at = cursor[1]
    for k in range(len(bits)):
        bit, state, at = pull(state, at, stream, slots, table[_bit_context(places, k, bits, around)])
        bits[k] = bit
    cursor[0] = state
    cursor[1] = at


@device
def _same(ids, k, other):  # type: ignore[no-untyped-def]
    return k >= 0 and other >= 0 and ids[k] == ids[other]


@device
def _object_context(places, k, ids):  # type: ignore[no-untyped-def]
    """Which neighbours there are, and which show the same object."""
    west = places[k, 0]
    north = places[k, 1]
    context = types.int64(west >= 0) | (types.int64(north >= 0) << 1) | (types.int64(_same(ids, west, north)) << 2)
    context |= types.int64(_same(ids, north, places[k, 2])) << 3
    return context | (types.int64(_same(ids, north, places[k, 3])) << 4)


@kernel(types.int64(_PLACES, _IDS, _CONTEXTS, _SYMBOLS))
def object_symbols(places, ids, contexts, symbols):  # type: ignore[no-untyped-def]
    """Lists object ids: whose of the four neighbours it is, else how far from the last that was none's.

    ids: (valid,) uint32. contexts, symbols: (7 valid,) written. Returns how many symbols there are.
    """
    n = 0
    last = types.int64(0)
    for k in range(len(ids)):
        contexts[n] = _object_context(places, k, ids)
        side = 0
        while side < 4 and not (places[k, side] >= 0 and ids[places[k, side]] == ids[k]):
            side += 1
        symbols[n] = side
        n += 1
        if side < 4:
            continue
        step = types.int64(ids[k]) - last
        last = types.int64(ids[k])
        step = ((step + (1 << 31)) & 0xFFFFFFFF) - (1 << 31)
        z = 2 * step if step >= 0 else -2 * step - 1
        length = 0
        while z >> length:
            length += 1
        contexts[n] = OBJECT_CONTEXTS
        symbols[n] = length
        n += 1
        bits = length - 1
        while bits > 0:
            part = min(bits, 7)
            bits -= part
            contexts[n] = BITS + part
            symbols[n] = (z >> bits) & ((1 << part) - 1)
            n += 1
    return n


@kernel(types.int64(_BYTES, _OF, _SLOTS, _CURSOR, _PLACES, types.uint32[::1]))
def read_objects(stream, table, slots, cursor, places, ids):  # type: ignore[no-untyped-def]
    """Reads what object_symbols lists; returns how often a neighbour is named that is not there.

    ids: (valid,) uint32, written.
    """
    missing = 0
    state = cursor[0]
    at = cursor[1]
    last = types.int64(0)
    for k in range(len(ids)):
        row = table[_object_context(places, k, ids)]
        side, state, at = pull(state, at, stream, slots, row)
        if side < 4:
            other = places[k, side]
            missing += other < 0
            ids[k] = ids[other] if other >= 0 else types.uint32(0)
            continue
        length, state, at = pull(state, at, stream, slots, table[OBJECT_CONTEXTS])
        z = types.int64(length > 0)
        bits = length - 1
        while bits > 0:
            part = min(bits, types.int64(7))
            bits -= part
            more, state, at = pull_bits(state, at, stream, part)
            z = (z << part) | more
        last = (last + ((z >> 1) if z & 1 == 0 else -((z >> 1) + 1))) & 0xFFFFFFFF
        ids[k] = last
    cursor[0] = state
    cursor[1] = at
    return missing
