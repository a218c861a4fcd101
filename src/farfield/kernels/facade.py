"""The façade of one building, painted as rectangles that cover texels by area, in linear light.

Nothing but additions, products and integer hashes: the bytes are the same on every machine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR
from farfield.kernels.compiling import device, kernel, routine
from farfield.kernels.surface import F32_1, F32_2, F32_3, U8_3

WALL, BASE, GLASS, FRAME, BAND, BALCONY, CORNICE, BLIND, LIGHT, DOOR, SIGN = range(11)
"""Rows of Facade.colors; signs take the rows from SIGN on."""
SIGNS = 4
HOME, SHOPS, LOBBY, GARAGE = range(4)
"""What the ground floor is."""

_COLUMN, _PANE, _BLIND, _DRAWN, _LIT, _DOOR, _SIGN, _AWNING, _GATE, _STREAK, _GRAIN = range(11)
"""Streams of numbers."""
_ZERO, _ONE, _HALF, _TWO = np.float32(0), np.float32(1), np.float32(0.5), np.float32(2)


class Facade(NamedTuple):
    """What is painted. Lengths across are in bays, lengths up in floors."""

    seed: np.uint64
    floors: int
    bays: int
    street: int
    """HOME, SHOPS, LOBBY or GARAGE."""
    left: np.float32
    """Of a window, from the left edge of its bay; as much remains at the right."""
    sill: np.float32
    head: np.float32
    frame_x: np.float32
    frame_y: np.float32
    panes: np.float32
    """Panes side by side, a whole number."""
    transom: np.float32
    """Height of a bar across, as a share of the window; 0: none."""
    band: np.float32
    """Height of a band at every slab."""
    pilaster: np.float32
    """Width of a strip at the edges of bays."""
    every: np.float32
    """Bays from strip to strip, a whole number."""
    cornice: np.float32
    """Height of the roof's edge."""
    narrow: np.float32
    """Share of columns with narrow windows."""
    balcony: np.float32
    """Share of columns with balconies."""
    blinds: np.float32
    """Share of windows with blinds."""
    lit: np.float32
    """Share of windows with light behind them."""
    grain: np.float32
    """Largest change of a texel's lightness."""
    dirt: np.float32
    """Share of light that is lost where a façade is dirtiest."""
    colors: NDArray[np.float32]
    """(SIGN + SIGNS, 3) linear light."""


FACADE = types.NamedTuple((types.uint64, *(types.int64,) * 3, *(types.float32,) * 17, F32_2), Facade)
"""Numba type of Facade."""


@device
def _drawn(seed, stream, row, column):  # type: ignore[no-untyped-def]
    """A number in 0..1 of a place."""
    mixed = seed + np.uint64(0x9E3779B97F4A7C15) * np.uint64((stream + 1) * 4294967296 + row * 65536 + column)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.float32(np.int64(mixed >> np.uint64(40))) * np.float32(1 / 16777216)


@routine
def _fill(canvas, box, colors, row, low, high):  # type: ignore[no-untyped-def]
    """Paints a rectangle, its edges by how much of a texel they cover.

    box: (x0, y0, x1, y1) texels, y downwards. low, high: times the light at its lower and upper edge.
    """
    x0, y0, x1, y1 = box
    size = canvas.shape[0]
    left, top = max(np.int64(x0), 0), max(np.int64(y0), 0)
    right, bottom = min(np.int64(x1) + 1, size), min(np.int64(y1) + 1, size)
    red, green, blue = colors[row, 0], colors[row, 1], colors[row, 2]
    share = _ONE / max(y1 - y0, np.float32(1e-6))
    for y in range(top, bottom):
        at = np.float32(y)
        down = min(y1, at + _ONE) - max(y0, at)
        if down <= _ZERO:
            continue
        part = min(max((y1 - at - _HALF) * share, _ZERO), _ONE)
        light = low + (high - low) * part
        for x in range(left, right):
            along = np.float32(x)
            cover = min(x1, along + _ONE) - max(x0, along)
            if cover <= _ZERO:
                continue
            cover *= down
            rest = _ONE - cover
            cover *= light
            canvas[y, x, 0] = canvas[y, x, 0] * rest + red * cover
            canvas[y, x, 1] = canvas[y, x, 1] * rest + green * cover
            canvas[y, x, 2] = canvas[y, x, 2] * rest + blue * cover


@routine
def _place(side, facade, column, floor, left, right, low, high):  # type: ignore[no-untyped-def]
    """Texels of a rectangle that is told in bays from a column's edge and in floors from a floor."""
    wide = np.float32(side) / np.float32(facade.bays)
    tall = np.float32(side) / np.float32(facade.floors)
    x = np.float32(column)
    y = np.float32(floor)
    return (
        (x + left) * wide,
        np.float32(side) - (y + high) * tall,
        (x + right) * wide,
        np.float32(side) - (y + low) * tall,
    )


@routine
def _window(canvas, facade, column, floor, left, right, sill, head):  # type: ignore[no-untyped-def]
    """Frame, panes, what is behind them, and the shadow of the wall above."""
    side, own = canvas.shape[0], facade.colors
    fx, fy = facade.frame_x, facade.frame_y
    _fill(canvas, _place(side, facade, column, floor, left, right, sill, head), own, FRAME, _ONE, _ONE)
    inner = _place(side, facade, column, floor, left + fx, right - fx, sill + fy, head - fy)
    bright = np.float32(0.55) + np.float32(0.9) * _drawn(facade.seed, _PANE, floor, column)
    if _drawn(facade.seed, _LIT, floor, column) < facade.lit:
        _fill(canvas, inner, own, LIGHT, _ONE, np.float32(0.7))
    else:
        _fill(canvas, inner, own, GLASS, bright * np.float32(0.75), bright * np.float32(1.4))
    tall = head - sill - _TWO * fy
    if _drawn(facade.seed, _BLIND, floor, column) < facade.blinds:
        down = np.float32(0.2) + np.float32(0.8) * _drawn(facade.seed, _DRAWN, floor, column)
        top = head - fy
        _fill(canvas, _place(side, facade, column, floor, left + fx, right - fx, top - down * tall, top), own, BLIND,
              _ONE, np.float32(0.8))  # fmt: skip
    panes = np.int64(facade.panes)
    for k in range(1, panes):
        middle = left + (right - left) * np.float32(k) / np.float32(panes)
        half = fx * _HALF
        _fill(canvas, _place(side, facade, column, floor, middle - half, middle + half, sill, head), own, FRAME, _ONE,
              _ONE)  # fmt: skip
    if facade.transom > _ZERO:
        at = sill + facade.transom * (head - sill)
        half = fy * _HALF
        _fill(canvas, _place(side, facade, column, floor, left, right, at - half, at + half), own, FRAME, _ONE, _ONE)
    _fill(canvas, _place(side, facade, column, floor, left, right, head - np.float32(0.04), head), own, FRAME,
          np.float32(0.35), np.float32(0.25))  # fmt: skip
    _fill(canvas, _place(side, facade, column, floor, left - fx, right + fx, sill - np.float32(0.035), sill), own, BAND,
          np.float32(0.7), np.float32(1.05))  # fmt: skip


@routine
def _bay(canvas, facade, column, floor):  # type: ignore[no-untyped-def]
    """What a bay has on a floor above the street."""
    side, own = canvas.shape[0], facade.colors
    left, right, sill, head = facade.left, _ONE - facade.left, facade.sill, facade.head
    kind = _drawn(facade.seed, _COLUMN, 0, column)
    if kind < facade.narrow:
        _window(canvas, facade, column, floor, np.float32(0.36), np.float32(0.64), max(sill, np.float32(0.42)), head)
    elif kind < facade.narrow + facade.balcony:
        _window(canvas, facade, column, floor, left, right, np.float32(0.08), head)
        wide = max(left - np.float32(0.06), np.float32(0.02))
        _fill(canvas, _place(side, facade, column, floor, wide, _ONE - wide, np.float32(0.34), np.float32(0.37)), own,
              FRAME, np.float32(0.8), np.float32(0.8))  # fmt: skip
        _fill(canvas, _place(side, facade, column, floor, wide, _ONE - wide, np.float32(0.03), np.float32(0.34)), own,
              BALCONY, np.float32(0.82), _ONE)  # fmt: skip
        _fill(canvas, _place(side, facade, column, floor, wide, _ONE - wide, np.float32(-0.04), np.float32(0.03)), own,
              BAND, np.float32(0.4), np.float32(0.7))  # fmt: skip
    else:
        _window(canvas, facade, column, floor, left, right, sill, head)


@routine
def _door(canvas, facade, column, head):  # type: ignore[no-untyped-def]
    """A door with a canopy above it."""
    side, own = canvas.shape[0], facade.colors
    low, high = np.float32(0.26), np.float32(0.74)
    fx = facade.frame_x
    _fill(canvas, _place(side, facade, column, 0, low, high, _ZERO, head), own, FRAME, np.float32(0.8), np.float32(0.8))
    _fill(
        canvas, _place(side, facade, column, 0, low + fx, high - fx, _ZERO, head - fx), own, DOOR, np.float32(0.8), _ONE
    )
    _fill(canvas, _place(side, facade, column, 0, _HALF - fx * _HALF, _HALF + fx * _HALF, _ZERO, head), own, FRAME,
          np.float32(0.6), np.float32(0.6))  # fmt: skip
    _fill(canvas, _place(side, facade, column, 0, low - np.float32(0.1), high + np.float32(0.1), head,
                         head + np.float32(0.06)), own, CORNICE, np.float32(0.6), np.float32(1.1))  # fmt: skip


@routine
def _shop(canvas, facade, column):  # type: ignore[no-untyped-def]
    """A shop window with a sign; two bays are one shop."""
    side, own = canvas.shape[0], facade.colors
    shop = column // 2
    low, high = np.float32(0.07), np.float32(0.93)
    _fill(
        canvas, _place(side, facade, column, 0, low, high, np.float32(0.05), np.float32(0.62)), own, FRAME, _ONE, _ONE
    )
    inner = _place(side, facade, column, 0, low + facade.frame_x, high - facade.frame_x, np.float32(0.09),
                   np.float32(0.6))  # fmt: skip
    if _drawn(facade.seed, _LIT, 0, shop) < np.float32(0.45):
        _fill(canvas, inner, own, LIGHT, np.float32(0.55), np.float32(0.9))
    else:
        _fill(canvas, inner, own, GLASS, np.float32(1.3), np.float32(0.7))
    if column % 2 == 1:
        _fill(canvas, _place(side, facade, column, 0, np.float32(0.3), np.float32(0.36), np.float32(0.03),
                             np.float32(0.6)), own, FRAME, _ONE, _ONE)  # fmt: skip
    sign = SIGN + np.int64(_drawn(facade.seed, _SIGN, 0, shop) * np.float32(SIGNS))
    _fill(canvas, _place(side, facade, column, 0, np.float32(0.03), np.float32(0.97), np.float32(0.68),
                         np.float32(0.88)), own, sign, np.float32(0.8), _ONE)  # fmt: skip
    if _drawn(facade.seed, _AWNING, 0, shop) < np.float32(0.35):
        _fill(canvas, _place(side, facade, column, 0, np.float32(0.03), np.float32(0.97), np.float32(0.54),
                             np.float32(0.68)), own, sign, np.float32(0.45), np.float32(0.75))  # fmt: skip


@routine
def _gate(canvas, facade, column):  # type: ignore[no-untyped-def]
    """A roller door, or a strip of windows high up."""
    side, own = canvas.shape[0], facade.colors
    if _drawn(facade.seed, _GATE, 0, column) < np.float32(0.4):
        _window(canvas, facade, column, 0, facade.left, _ONE - facade.left, np.float32(0.58), np.float32(0.82))
        return
    low, high = np.float32(0.12), np.float32(0.88)
    _fill(canvas, _place(side, facade, column, 0, low, high, _ZERO, np.float32(0.74)), own, FRAME, _ONE, _ONE)
    for k in range(6):
        bottom = np.float32(0.12) * np.float32(k)
        _fill(canvas, _place(side, facade, column, 0, low + np.float32(0.02), high - np.float32(0.02), bottom,
                             bottom + np.float32(0.12)), own, DOOR, _ONE, np.float32(0.75))  # fmt: skip


@routine
def _street(canvas, facade):  # type: ignore[no-untyped-def]
    """The ground floor."""
    side, own = canvas.shape[0], facade.colors
    _fill(canvas, _place(side, facade, 0, 0, _ZERO, np.float32(facade.bays), _ZERO, np.float32(0.95)), own, BASE,
          np.float32(0.85), _ONE)  # fmt: skip
    door = np.int64(_drawn(facade.seed, _DOOR, 0, 0) * np.float32(facade.bays))
    for column in range(facade.bays):
        if facade.street == SHOPS:
            _shop(canvas, facade, column)
        elif facade.street == GARAGE:
            _gate(canvas, facade, column)
        elif column % 8 == door % 8:
            _door(canvas, facade, column, np.float32(0.68))
        elif facade.street == LOBBY:
            _window(canvas, facade, column, 0, np.float32(0.06), np.float32(0.94), np.float32(0.05), np.float32(0.84))
        else:
            _window(canvas, facade, column, 0, facade.left, _ONE - facade.left, max(facade.sill, np.float32(0.3)),
                    min(facade.head, np.float32(0.8)))  # fmt: skip


@routine
def _finish(facade, canvas, streaks, pixels):  # type: ignore[no-untyped-def]
    """Dirt that runs down from the roof and stands above the street, grain, and sRGB."""
    side = canvas.shape[0]
    spread = np.float32(facade.bays * 5) / np.float32(side)
    for x in range(side):
        at = np.float32(x) * spread
        left = np.int64(at)
        part = at - np.float32(left)
        first = _drawn(facade.seed, _STREAK, 0, left)
        streaks[x] = first + part * (_drawn(facade.seed, _STREAK, 0, left + 1) - first)
    step = _ONE / np.float32(side)
    for y in range(side):
        up = _ONE - (np.float32(y) + _HALF) * step
        foot = _ONE - min(up * np.float32(facade.floors) * _HALF, _ONE)
        for x in range(side):
            grime = facade.dirt * (streaks[x] * (np.float32(0.25) + np.float32(0.75) * up) + _HALF * foot * foot)
            light = (_ONE - grime) * (_ONE + facade.grain * (_TWO * _drawn(facade.seed, _GRAIN, y, x) - _ONE))
            for k in range(3):
                linear = min(max(canvas[y, x, k] * light, _ZERO), _ONE)
                pixels[y, x, k] = BYTE_OF_LINEAR[np.int64(linear * np.float32(4095) + _HALF)]
            pixels[y, x, 3] = 255


@kernel(types.void(FACADE, F32_3, F32_1, U8_3))
def paint_facade(facade, canvas, streaks, pixels):  # type: ignore[no-untyped-def]
    """Paints all floors and bays of a façade, the ground floor at the bottom, row 0 at the roof.

    canvas: (side, side, 3) float32 and streaks: (side,) float32, scratch. pixels: (side, side, 4) uint8 sRGB, written.
    256 x 256 take 0.8 ms, 512 x 512 3 ms.
    """
    side, own = canvas.shape[0], facade.colors
    canvas[:, :, 0], canvas[:, :, 1], canvas[:, :, 2] = own[WALL, 0], own[WALL, 1], own[WALL, 2]
    whole = np.float32(facade.bays)
    if facade.band > _ZERO:
        for floor in range(1, facade.floors):
            _fill(canvas, _place(side, facade, 0, floor, _ZERO, whole, _ZERO, facade.band), own, BAND, np.float32(0.9),
                  _ONE)  # fmt: skip
    if facade.pilaster > _ZERO:
        half = facade.pilaster * _HALF
        for column in range(0, facade.bays + 1, np.int64(facade.every)):
            _fill(canvas, _place(side, facade, column, 0, -half, half, _ZERO, np.float32(facade.floors)), own, BAND,
                  np.float32(0.95), _ONE)  # fmt: skip
    for floor in range(1, facade.floors):
        for column in range(facade.bays):
            _bay(canvas, facade, column, floor)
    _street(canvas, facade)
    edge = facade.cornice
    top = facade.floors - 1
    _fill(canvas, _place(side, facade, 0, top, _ZERO, whole, _ONE - edge * np.float32(1.4), _ONE - edge), own, WALL,
          np.float32(0.75), np.float32(0.45))  # fmt: skip
    _fill(canvas, _place(side, facade, 0, top, _ZERO, whole, _ONE - edge, _ONE), own, CORNICE, np.float32(0.85), _ONE)
    _finish(facade, canvas, streaks, pixels)
