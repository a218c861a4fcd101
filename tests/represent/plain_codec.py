"""Plain twins of the kernels that tiles are made with: slow, straight from spec/orthoview.md."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Neighbours = tuple[tuple[int, int], ...]
WEST, NORTH, NORTH_WEST, NORTH_EAST = (0, -1), (-1, 0), (-1, -1), (-1, 1)


def _at(depth: NDArray[np.uint16], y: int, x: int) -> int:
    inside = 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]
    return int(depth[y, x]) if inside else 0


def _median_edge(a: int, b: int, d: int) -> int:
    if d >= max(a, b):
        return min(a, b)
    return max(a, b) if d <= min(a, b) else a + b - d


def depth_prediction(depth: NDArray[np.uint16], y: int, x: int, previous: int) -> int:
    """What the depth at (y, x) is predicted to be."""
    a, b, d = (_at(depth, y + dy, x + dx) for dy, dx in (WEST, NORTH, NORTH_WEST))
    if a and b and d:
        return a + b - d if max(a, b, d) - min(a, b, d) <= 32 else _median_edge(a, b, d)
    if a and b:
        return (a + b) >> 1
    return a or b or previous


def depth_residuals(depth: NDArray[np.uint16]) -> list[int]:
    """Zigzag residuals in valid order."""
    residuals, previous = [], 0
    for y, x in np.argwhere(depth):
        value = int(depth[y, x])
        r = value - depth_prediction(depth, y, x, previous)
        r = (r + 2**15) % 2**16 - 2**15
        residuals.append((2 * r if r >= 0 else -2 * r - 1) % 2**16)
        previous = value
    return residuals


def normal_prediction(depth: NDArray[np.uint16], codes: NDArray[np.uint8], y: int, x: int, previous: int) -> int:
    """What one coordinate of the normal at (y, x) is predicted to be; codes (h, w)."""
    around = {n: _at(depth, y + n[0], x + n[1]) for n in (WEST, NORTH, NORTH_WEST, NORTH_EAST)}
    away = {n: abs(there - int(depth[y, x])) for n, there in around.items() if there}
    if not away:
        return previous
    counts = {n: int(codes[y + n[0], x + n[1]]) for n, steps in away.items() if steps <= 2 * min(away.values()) + 8}
    if WEST in counts and NORTH in counts:
        if NORTH_WEST in counts:
            return _median_edge(counts[WEST], counts[NORTH], counts[NORTH_WEST])
        return (counts[WEST] + counts[NORTH]) >> 1
    return next(counts[n] for n in (WEST, NORTH, NORTH_WEST, NORTH_EAST) if n in counts)


def normal_residuals(depth: NDArray[np.uint16], codes: NDArray[np.uint8]) -> list[int]:
    """Residuals of one coordinate modulo 64, in valid order; codes (h, w)."""
    residuals, previous = [], 32
    for y, x in np.argwhere(depth):
        residuals.append((int(codes[y, x]) - normal_prediction(depth, codes, y, x, previous)) % 64)
        previous = int(codes[y, x])
    return residuals


def filled(image: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Push-pull, recursively: halve, fill the half, take invalid pixels from it."""
    rows, columns = valid.shape
    if valid.all() or valid.size == 1:
        return np.where(valid[..., None], image, 0).astype(np.uint8)
    half = np.zeros(((rows + 1) // 2, (columns + 1) // 2, 3), np.uint8)
    half_valid = np.zeros(half.shape[:2], bool)
    for j, i in np.ndindex(*half_valid.shape):
        block = (slice(2 * j, 2 * j + 2), slice(2 * i, 2 * i + 2))
        below = image[block][valid[block]].astype(int)
        if len(below):
            half_valid[j, i] = True
            half[j, i] = (2 * below.sum(0) + len(below)) // (2 * len(below))
    half = filled(half, half_valid).astype(int)
    result = image.copy()
    for y, x in np.argwhere(~valid):
        fy = min(max(y // 2 + (1 if y % 2 else -1), 0), half.shape[0] - 1)
        fx = min(max(x // 2 + (1 if x % 2 else -1), 0), half.shape[1] - 1)
        near, far = half[y // 2], half[fy]
        result[y, x] = (9 * near[x // 2] + 3 * near[fx] + 3 * far[x // 2] + far[fx] + 8) // 16
    return result


@dataclass(frozen=True)
class Surface:
    """What the contexts of a pixel's symbols are told from; all images are (h, w)."""

    mask: NDArray[np.bool_]
    depth: NDArray[np.uint16]
    residual: NDArray[np.int64]
    """Zigzag, of depth."""
    turns: NDArray[np.int64]
    """(2, h, w) residuals modulo 64 of the normals."""
    coverage: NDArray[np.int64]
    """1..16."""
    length: NDArray[np.int64]
    """1..8."""

    def valid(self, y: int, x: int) -> bool:
        """Whether there is a surface; not outside."""
        inside = 0 <= y < self.mask.shape[0] and 0 <= x < self.mask.shape[1]
        return inside and bool(self.mask[y, x])

    def mean(self, y: int, x: int, size: Callable[[int, int], int], missing: int) -> int:
        """Of a number over the neighbours, in sixths."""
        found = [(w, size(y + dy, x + dx)) for w, (dy, dx) in _WEIGHTS if self.valid(y + dy, x + dx)]
        return 6 * sum(w * s for w, s in found) // sum(w for w, _ in found) if found else missing


_WEIGHTS = ((2, WEST), (2, NORTH), (1, NORTH_WEST), (1, NORTH_EAST))
_DEPTH_STEPS = (1, 2, 4, 6, 9, 12, 16, 22, 30, 42, 60, 90, 150, 300, 800)
_NORMAL_STEPS = (1, 3, 6, 9, 13, 18, 24, 32, 42, 56, 75, 100, 140, 200, 280)


def _step(value: int, thresholds: tuple[int, ...]) -> int:
    return sum(t <= value for t in thresholds)


def _turn(r: int) -> int:
    return min(r, 64 - r)


Symbols = list[tuple[int, int]]
"""Context and symbol; contexts of plain bits are 65528 and how many."""


def depth_symbols(s: Surface) -> Symbols:
    """Mask and depth."""
    symbols = []
    before = ((0, -1), (-1, 0), (-1, -1), (-1, 1), (0, -2), (-2, 0), (-1, 2))
    for y, x in np.ndindex(*s.mask.shape):
        context = sum(s.valid(y + dy, x + dx) << bit for bit, (dy, dx) in enumerate(before))
        symbols.append((context, int(s.mask[y, x])))
    for y, x in np.argwhere(s.mask).tolist():
        m = s.mean(y, x, lambda j, i: min(255, (int(s.residual[j, i]) + 1) >> 1), 1)
        north = int(s.residual[y - 1, x]) if s.valid(y - 1, x) else 0
        sign = 1 if north == 0 else (0 if north % 2 else 2)
        both = s.valid(y, x - 1) and s.valid(y - 1, x)
        context = 128 + (16 * both + _step(m, _DEPTH_STEPS)) * 3 + sign
        z = int(s.residual[y, x])
        if z < 16:
            symbols.append((context, z))
            continue
        e = z.bit_length() - 1
        symbols.append((context, 16 + 2 * (e - 4) + (z >> (e - 1) & 1)))
        if e - 1 > 7:
            symbols.append((65528 + e - 8, z >> 7 & 2 ** (e - 8) - 1))
        low = min(7, e - 1)
        symbols.append((65528 + low, z & 2**low - 1))
    return symbols


def normal_symbols(s: Surface) -> Symbols:
    """Both coordinates."""
    symbols = []
    for y, x in np.argwhere(s.mask).tolist():
        first, second = (int(r) for r in s.turns[:, y, x])
        t = s.mean(y, x, lambda j, i: sum(_turn(int(r)) for r in s.turns[:, j, i]), 12)
        symbols.append((_step(t + 2 * min(32, (int(s.residual[y, x]) + 1) >> 1), _NORMAL_STEPS), first))
        sign = 0 if first > 31 else (2 if first else 1)
        symbols.append((16 + 16 * sign + _step(t + 4 * _turn(first), _NORMAL_STEPS), second))
    return symbols


def _near(s: Surface, y: int, x: int, places: list[tuple[int, int]], close: Callable[[int], bool]) -> int:
    here = int(s.depth[y, x])
    return sum(s.valid(y + j, x + i) and close(int(s.depth[y + j, x + i]) - here) for j, i in places)


def coverage_symbols(s: Surface) -> Symbols:
    """Coverage and length."""

    def filled(j: int, i: int) -> int:
        if not s.valid(j, i):
            return 0
        return 1 if s.coverage[j, i] == 16 else (2 if s.coverage[j, i] > 8 else 3)

    def length(j: int, i: int) -> int:
        return int(s.length[j, i]) - 1 if s.valid(j, i) else 7

    symbols = []
    for y, x in np.argwhere(s.mask).tolist():
        b = _near(s, y, x, [(0, -1), (-1, 0), (0, 1), (1, 0)], lambda step: step <= 32)
        coverage = int(s.coverage[y, x])
        symbols.append((16 * min(2, 4 - b) + 4 * filled(y, x - 1) + filled(y - 1, x), coverage - 1))
        turn = _step(sum(_turn(int(r)) for r in s.turns[:, y, x]), (1, 3, 6, 12))
        lengths = _step(length(y, x - 1) + length(y - 1, x), (8, 12, 14))
        symbols.append((48 + (2 * turn + (coverage == 16)) * 4 + lengths, int(s.length[y, x]) - 1))
    return symbols


def bit_symbols(s: Surface, bits: NDArray[np.bool_]) -> Symbols:
    """Flags or unlit."""
    symbols = []
    around = [(j, i) for j in (-1, 0, 1) for i in (-1, 0, 1) if j or i]
    for y, x in np.argwhere(s.mask).tolist():
        a = _near(s, y, x, around, lambda step: abs(step) < 32)
        before = (bool(s.valid(y + j, x + i) and bits[y + j, x + i]) for j, i in (WEST, NORTH, NORTH_WEST, NORTH_EAST))
        symbols.append((16 * a + sum(bit << k for k, bit in enumerate(before)), int(bits[y, x])))
    return symbols


def object_symbols(mask: NDArray[np.bool_], ids: NDArray[np.uint32]) -> Symbols:
    """Object ids, (h, w)."""

    def id_of(j: int, i: int) -> int | None:
        inside = 0 <= j < mask.shape[0] and 0 <= i < mask.shape[1]
        return int(ids[j, i]) if inside and mask[j, i] else None

    symbols, last = [], 0
    for y, x in np.argwhere(mask).tolist():
        west, north, *corners = found = [id_of(y + j, x + i) for j, i in (WEST, NORTH, NORTH_WEST, NORTH_EAST)]
        pairs = [west is not None, north is not None, *(north is not None and north == o for o in (west, *corners))]
        own = int(ids[y, x])
        side = found.index(own) if own in found else 4
        symbols.append((sum(bit << k for k, bit in enumerate(pairs)), side))
        if side == 4:
            step = (own - last + 2**31) % 2**32 - 2**31
            last, z = own, 2 * step if step >= 0 else -2 * step - 1
            bits = z.bit_length()
            symbols.append((32, bits))
            while bits > 1:
                part = min(7, bits - 1)
                bits -= part
                symbols.append((65528 + part, z >> (bits - 1) & 2**part - 1))
    return symbols


def symbols_of_tables(codes: list[int]) -> list[int]:
    """The symbol at each of the 1024 places of a table."""
    weights = [(16, 19, 23, 27)[(c - 1) % 4] * 2 ** ((c - 1) // 4) if c else 0 for c in codes]
    if not any(weights):
        return [0] * 1024
    widths = [max(1, 1024 * w // sum(weights)) if w else 0 for w in weights]
    widths[codes.index(max(codes))] += 1024 - sum(widths)
    return [symbol for symbol, width in enumerate(widths) for _ in range(width)]


def decoded(plane: bytes, models: list[tuple[int, int]], contexts: list[int]) -> list[int]:
    """The symbols of a coded plane, given the context of each; models: contexts and alphabet."""
    packed = int.from_bytes(plane[:2], "little")
    told = zlib.decompress(plane[4 : 4 + packed], -15)
    assert len(told) == int.from_bytes(plane[2:4], "little")
    count = sum(n for n, _ in models)
    bits = [told[k // 8] >> (7 - k % 8) & 1 for k in range(count)]
    alphabets = [alphabet for n, alphabet in models for _ in range(n)]
    tables, at = [], (count + 7) // 8
    for new, alphabet in zip(bits, alphabets, strict=True):
        if new:
            own = symbols_of_tables(list(told[at : at + alphabet]))
            at += alphabet
        tables.append(own)
    assert at == len(told)
    stream = plane[4 + packed :]
    state, words = int.from_bytes(stream[:4], "little"), list(struct.iter_unpack("<H", stream[4:]))
    symbols = []
    for context in contexts:
        slot = state % 1024
        if context >= 65528:
            rest = 10 - (context - 65528)
            symbols.append(slot >> rest)
            state = state // 1024 * 2**rest + slot % 2**rest
        else:
            symbol = tables[context][slot]
            symbols.append(symbol)
            places = tables[context].count(symbol)
            state = places * (state // 1024) + slot - tables[context].index(symbol)
        if state < 65536:
            state = state * 65536 + words.pop(0)[0]
    assert state == 65536
    assert not words
    return symbols
