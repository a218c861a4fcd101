"""Entropy coding of symbols whose probabilities depend on a context: range asymmetric numeral systems.

Duda 2013 (arXiv:1311.2540); the 32-bit state and the way of emitting 16-bit words are Giesen's (arXiv:1402.3392).
Probabilities are told in a table for each group of neighbouring contexts (spec/orthoview.md, Codec 3).
"""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numpy.typing import NDArray

from farfield.kernels.compiling import device, kernel

PRECISION = 10
"""Probabilities are in 1/1024: tables of 4 kB a reader keeps in its cache; 1/4096 makes tiles 0.2 % smaller."""
ONE = 1 << PRECISION
LOWEST = 1 << 16
"""The state is at least this; also where it begins."""
LARGEST_CODE = 49
"""Frequency codes: 0 = never, k = a weight of about 16 * 2 ** ((k - 1) / 4)."""
BITS = 65528
"""Contexts from here on have 2 ** (context - BITS) equally likely symbols: plain bits, up to 7 of them."""
_SYMBOL_COST, _TABLE_COST = 5 << 16, 4 << 16
"""Bits of a table, in 1/65536: for each symbol in it and besides."""


def _weights() -> NDArray[np.int64]:
    steps = (16, 19, 23, 27)  # Powers of 2 ** (1/4) in sixteenths.
    return np.array([0, *(steps[k & 3] << (k >> 2) for k in range(LARGEST_CODE))], np.int64)


WEIGHTS = _weights()
"""(50,) int64 weight of each frequency code."""
_LOG2 = np.array([0, *(round(math.log2(m) * 65536) for m in range(1, 4096))], np.int64)
"""(4096,) logarithms in 1/65536, whole numbers so that every machine groups contexts alike."""

_COUNTS = types.int64[:, ::1]
_CODES = types.Array(types.uint8, 2, "C", readonly=True)
_CONTEXTS = types.Array(types.uint16, 1, "C", readonly=True)
_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_TABLES = types.Array(types.uint16, 2, "C", readonly=True)
_OF = types.Array(types.int32, 1, "C", readonly=True)
_LOGS = types.Array(types.int64, 1, "C", readonly=True)


@device
def _surprise(count, logs):  # type: ignore[no-untyped-def]
    """count * log2(count) in 1/65536 bits."""
    m = count
    shift = 0
    while m >= 4096:
        m >>= 1
        shift += 1
    return count * (logs[m] + (shift << 16))


@device
def _cost(counts, row, other, logs):  # type: ignore[no-untyped-def]
    """Bits in 1/65536 of all symbols of two rows with one table, and of the table; other: -1 for one row alone."""
    total = types.int64(0)
    bits = types.int64(0)
    for s in range(counts.shape[1]):
        count = counts[row, s] + (counts[other, s] if other >= 0 else 0)
        if count > 0:
            total += count
            bits += _SYMBOL_COST - _surprise(count, logs)
    return bits + _surprise(total, logs) + _TABLE_COST if total > 0 else types.int64(0)


@kernel(types.void(_CONTEXTS, _BYTES, types.int64, types.int64, _COUNTS))
def count_symbols(contexts, symbols, first, last, counts):  # type: ignore[no-untyped-def]
    """Adds up how often each symbol comes in the contexts first to last - 1.

    contexts: (n,) uint16. symbols: (n,) uint8. counts: (last - first, alphabet) int64, added to.
    """
    for k in range(len(contexts)):
        context = types.int64(contexts[k])
        if first <= context < last:
            counts[context - first, symbols[k]] += 1


@kernel(types.int64(_COUNTS, _LOGS, types.int64[:, ::1], types.int32[::1]))
def _share(counts, logs, bits, table):  # type: ignore[no-untyped-def]
    """Joins neighbouring rows as long as one table less saves bits, best first; returns how many are left.

    counts: (contexts, alphabet), changed: the first rows hold the sums. bits: (2, contexts), scratch. table:
    (contexts,), written: the row of each.
    """
    own = bits[0]
    joined = bits[1]
    n = 0
    for row in range(counts.shape[0]):
        total = types.int64(0)
        for s in range(counts.shape[1]):
            total += counts[row, s]
        if total > 0:
            for s in range(counts.shape[1]):
                counts[n, s] = counts[row, s]
            own[n] = _cost(counts, n, -1, logs)
            n += 1
        table[row] = max(n - 1, 0)  # Contexts that never come go with the one before, the first with what follows.
    n = max(n, 1)
    for k in range(n - 1):
        joined[k] = _cost(counts, k, k + 1, logs)
    while n > 1:
        at = 0
        for k in range(1, n - 1):
            if own[k] + own[k + 1] - joined[k] > own[at] + own[at + 1] - joined[at]:
                at = k
        if own[at] + own[at + 1] <= joined[at]:
            break
        for s in range(counts.shape[1]):
            counts[at, s] += counts[at + 1, s]
        own[at] = joined[at]
        n -= 1
        for k in range(at + 1, n):
            own[k] = own[k + 1]
            joined[k - 1] = joined[k]
            for s in range(counts.shape[1]):
                counts[k, s] = counts[k + 1, s]
        for k in range(max(at - 1, 0), min(at + 1, n - 1)):
            joined[k] = _cost(counts, k, k + 1, logs)
        for row in range(len(table)):
            if table[row] > at:
                table[row] -= 1
    return n


@kernel(types.void(_COUNTS, _LOGS, types.uint8[:, ::1]))
def _code(counts, weights, codes):  # type: ignore[no-untyped-def]
    """The frequency code nearest to each symbol's share.

    counts: (tables, alphabet). weights: WEIGHTS. codes: (tables, alphabet), all 0, written.
    """
    for row in range(counts.shape[0]):
        total = types.int64(0)
        for s in range(counts.shape[1]):
            total += counts[row, s]
        for s in range(counts.shape[1]):
            if counts[row, s] > 0:
                wanted = (counts[row, s] << 16) // total
                code = 1
                while code < LARGEST_CODE and weights[code] + weights[code + 1] <= 2 * wanted:
                    code += 1
                codes[row, s] = code


@kernel(types.void(_CODES, _LOGS, types.uint16[:, ::1], types.uint16[:, ::1]))
def spread(codes, weights, starts, widths):  # type: ignore[no-untyped-def]
    """Divides 1024 between the symbols of each table; what rounding leaves is the commonest one's, the first of equals.

    codes: (tables, alphabet of at most 64) uint8, 0..49. weights: WEIGHTS. starts, widths: (tables, alphabet) uint16,
    written. A table in which nothing comes gives everything to symbol 0.
    """
    for row in range(codes.shape[0]):
        total = types.int64(0)
        commonest = 0
        for s in range(codes.shape[1]):
            total += weights[codes[row, s]]
            if codes[row, s] > codes[row, commonest]:
                commonest = s
        left = types.int64(ONE)
        for s in range(codes.shape[1]):
            weight = weights[codes[row, s]]
            widths[row, s] = max(types.int64(1), weight * ONE // total) if weight > 0 else types.int64(0)
            left -= types.int64(widths[row, s])
        widths[row, commonest] += left
        start = types.int64(0)
        for s in range(codes.shape[1]):
            starts[row, s] = start
            start += types.int64(widths[row, s])


@kernel(types.void(_TABLES, _TABLES, types.uint32[:, ::1]))
def fill_slots(starts, widths, slots):  # type: ignore[no-untyped-def]
    """What a reader needs for each 1/1024, in one word: symbol 6 bits, width 13, how far into the symbol 13.

    slots: (tables, 1024) uint32, written.
    """
    for row in range(starts.shape[0]):
        for s in range(starts.shape[1]):
            width = types.uint32(widths[row, s])
            start = types.int64(starts[row, s])
            for k in range(min(types.int64(width), ONE - start)):
                slots[row, start + k] = s | (width << 6) | (types.uint32(k) << 19)


@kernel(types.int64(_CONTEXTS, _BYTES, _OF, _TABLES, _TABLES, types.uint8[::1]))
def encode(contexts, symbols, table, starts, widths, out):  # type: ignore[no-untyped-def]
    """Codes the symbols from the last to the first; returns where in `out` the stream begins, which goes to its end.

    contexts: (n,) uint16, some from BITS on. symbols: (n,) uint8. table: (contexts,) int32 row of starts and widths.
    out: (4 + 2 n,) uint8, written.
    """
    state = types.int64(LOWEST)
    at = types.int64(len(out))
    for k in range(len(contexts) - 1, -1, -1):
        context = types.int64(contexts[k])
        symbol = types.int64(symbols[k])
        if context >= BITS:
            width = types.int64(ONE) >> (context - BITS)
            start = symbol * width
        else:
            row = table[context]
            width = types.int64(widths[row, symbol])
            start = types.int64(starts[row, symbol])
        if state >= width << (32 - PRECISION):
            at -= 2
            out[at] = state & 255
            out[at + 1] = (state >> 8) & 255
            state >>= 16
        state = ((state // width) << PRECISION) + state % width + start
    at -= 4
    for k in range(4):
        out[at + k] = (state >> (8 * k)) & 255
    return at


@device
def _refilled(state, at, stream):  # type: ignore[no-untyped-def]
    """A state below the least takes the next word; beyond the end of the stream there are zeros.

    Without a branch, which would be guessed wrong every other time. stream: with two zeros behind its end.
    """
    low = types.int64(state < LOWEST)
    place = min(at, len(stream) - 2)
    word = types.int64(stream[place]) | (types.int64(stream[place + 1]) << 8)
    return (state << (16 * low)) | (word * low), at + 2 * low


@device
def pull(state, at, stream, slots, row):  # type: ignore[no-untyped-def]
    """The next symbol by a table; symbol, state and place after it."""
    slot = types.int64(slots[row, state & (ONE - 1)])
    state, at = _refilled(((slot >> 6) & 8191) * (state >> PRECISION) + (slot >> 19), at, stream)
    return slot & 63, state, at


@device
def pull_bits(state, at, stream, bits):  # type: ignore[no-untyped-def]
    """The next plain bits, at most 7; they, state and place after them."""
    rest = PRECISION - bits
    slot = state & (ONE - 1)
    state = ((state >> PRECISION) << rest) + (slot & ((types.int64(1) << rest) - 1))
    state, at = _refilled(state, at, stream)
    return slot >> rest, state, at


def tables_of(counts: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Tables for contexts in which symbols come so often: which one each takes, and (tables, alphabet) frequency codes.

    counts: (contexts, alphabet), changed.
    """
    table = np.empty(len(counts), np.int32)
    left = _share(counts, _LOG2, np.empty((2, len(counts)), np.int64), table)
    codes = np.zeros((left, counts.shape[1]), np.uint8)
    _code(counts[:left], WEIGHTS, codes)
    return table, codes
