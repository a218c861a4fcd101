"""The plain twin of kernels.facade: every rectangle is an outer product over the whole canvas, in double precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import srgb_from_linear
from farfield.kernels import facade as kernels
from farfield.kernels.facade import BALCONY, BAND, BASE, BLIND, CORNICE, DOOR, FRAME, GLASS, LIGHT, SIGN, SIGNS, WALL

_MASK = (1 << 64) - 1
COLUMN, PANE, BLINDS, DRAWN, LIT, DOORS, SIGNBOARD, AWNING, GATE, STREAK, GRAIN = range(11)


def drawn(seed: int, stream: int, row: int, column: int) -> float:
    """A number in 0..1 of a place."""
    mixed = (seed + 0x9E3779B97F4A7C15 * ((stream + 1) * 4294967296 + row * 65536 + column)) & _MASK
    mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _MASK
    return (mixed >> 40) / (1 << 24)


class PlainFacade:
    """Paints one façade."""

    def __init__(self, facade: kernels.Facade, side: int) -> None:
        self.f, self.side = facade, side
        self.seed = int(facade.seed)
        self.canvas = np.tile(facade.colors[WALL].astype(np.float64), (side, side, 1))

    def fill(
        self, column: float, floor: float, across: tuple[float, float], up: tuple[float, float], row: int,
        light: tuple[float, float] = (1.0, 1.0),
    ) -> None:  # fmt: skip
        """A rectangle in bays from a column's edge and floors from a floor, lit from its lower to its upper edge."""
        wide, tall = self.side / self.f.bays, self.side / self.f.floors
        x0, x1 = ((column + at) * wide for at in across)
        y1, y0 = (self.side - (floor + at) * tall for at in up)
        texels = np.arange(self.side)
        along, down = (
            np.maximum(np.minimum(high, texels + 1) - np.maximum(low, texels), 0) for low, high in ((x0, x1), (y0, y1))
        )
        cover = np.outer(down, along)[..., None]
        part = np.clip((y1 - texels - 0.5) / max(y1 - y0, 1e-6), 0, 1)
        lit = (light[0] + (light[1] - light[0]) * part)[:, None, None]
        self.canvas = self.canvas * (1 - cover) + self.f.colors[row].astype(np.float64) * cover * lit

    def window(self, column: int, floor: int, across: tuple[float, float], up: tuple[float, float]) -> None:
        f, (left, right), (sill, head) = self.f, across, up
        inner = (left + f.frame_x, right - f.frame_x), (sill + f.frame_y, head - f.frame_y)
        self.fill(column, floor, across, up, FRAME)
        if drawn(self.seed, LIT, floor, column) < f.lit:
            self.fill(column, floor, *inner, LIGHT, (1.0, 0.7))
        else:
            bright = 0.55 + 0.9 * drawn(self.seed, PANE, floor, column)
            self.fill(column, floor, *inner, GLASS, (0.75 * bright, 1.4 * bright))
        if drawn(self.seed, BLINDS, floor, column) < f.blinds:
            down = (0.2 + 0.8 * drawn(self.seed, DRAWN, floor, column)) * (head - sill - 2 * f.frame_y)
            self.fill(column, floor, inner[0], (inner[1][1] - down, inner[1][1]), BLIND, (1.0, 0.8))
        for k in range(1, int(f.panes)):
            middle = left + (right - left) * k / int(f.panes)
            self.fill(column, floor, (middle - f.frame_x / 2, middle + f.frame_x / 2), up, FRAME)
        if f.transom > 0:
            at = sill + f.transom * (head - sill)
            self.fill(column, floor, across, (at - f.frame_y / 2, at + f.frame_y / 2), FRAME)
        self.fill(column, floor, across, (head - 0.04, head), FRAME, (0.35, 0.25))
        self.fill(column, floor, (left - f.frame_x, right + f.frame_x), (sill - 0.035, sill), BAND, (0.7, 1.05))

    def bay(self, column: int, floor: int) -> None:
        f, kind = self.f, drawn(self.seed, COLUMN, 0, column)
        whole = f.left, 1 - f.left
        if kind < f.narrow:
            self.window(column, floor, (0.36, 0.64), (max(f.sill, 0.42), f.head))
        elif kind < f.narrow + f.balcony:
            self.window(column, floor, whole, (0.08, f.head))
            wide = max(f.left - 0.06, 0.02)
            self.fill(column, floor, (wide, 1 - wide), (0.34, 0.37), FRAME, (0.8, 0.8))
            self.fill(column, floor, (wide, 1 - wide), (0.03, 0.34), BALCONY, (0.82, 1.0))
            self.fill(column, floor, (wide, 1 - wide), (-0.04, 0.03), BAND, (0.4, 0.7))
        else:
            self.window(column, floor, whole, (f.sill, f.head))

    def door(self, column: int) -> None:
        fx, head = self.f.frame_x, 0.68
        self.fill(column, 0, (0.26, 0.74), (0, head), FRAME, (0.8, 0.8))
        self.fill(column, 0, (0.26 + fx, 0.74 - fx), (0, head - fx), DOOR, (0.8, 1.0))
        self.fill(column, 0, (0.5 - fx / 2, 0.5 + fx / 2), (0, head), FRAME, (0.6, 0.6))
        self.fill(column, 0, (0.16, 0.84), (head, head + 0.06), CORNICE, (0.6, 1.1))

    def shop(self, column: int) -> None:
        fx, shop = self.f.frame_x, column // 2
        self.fill(column, 0, (0.07, 0.93), (0.05, 0.62), FRAME)
        inner = (0.07 + fx, 0.93 - fx), (0.09, 0.6)
        if drawn(self.seed, LIT, 0, shop) < 0.45:
            self.fill(column, 0, *inner, LIGHT, (0.55, 0.9))
        else:
            self.fill(column, 0, *inner, GLASS, (1.3, 0.7))
        if column % 2 == 1:
            self.fill(column, 0, (0.3, 0.36), (0.03, 0.6), FRAME)
        sign = SIGN + int(drawn(self.seed, SIGNBOARD, 0, shop) * SIGNS)
        self.fill(column, 0, (0.03, 0.97), (0.68, 0.88), sign, (0.8, 1.0))
        if drawn(self.seed, AWNING, 0, shop) < 0.35:
            self.fill(column, 0, (0.03, 0.97), (0.54, 0.68), sign, (0.45, 0.75))

    def gate(self, column: int) -> None:
        if drawn(self.seed, GATE, 0, column) < 0.4:
            self.window(column, 0, (self.f.left, 1 - self.f.left), (0.58, 0.82))
            return
        self.fill(column, 0, (0.12, 0.88), (0, 0.74), FRAME)
        for k in range(6):
            self.fill(column, 0, (0.14, 0.86), (0.12 * k, 0.12 * k + 0.12), DOOR, (1.0, 0.75))

    def street(self) -> None:
        f = self.f
        self.fill(0, 0, (0, f.bays), (0, 0.95), BASE, (0.85, 1.0))
        door = int(drawn(self.seed, DOORS, 0, 0) * f.bays)
        for column in range(f.bays):
            if f.street == kernels.SHOPS:
                self.shop(column)
            elif f.street == kernels.GARAGE:
                self.gate(column)
            elif column % 8 == door % 8:
                self.door(column)
            elif f.street == kernels.LOBBY:
                self.window(column, 0, (0.06, 0.94), (0.05, 0.84))
            else:
                self.window(column, 0, (f.left, 1 - f.left), (max(f.sill, 0.3), min(f.head, 0.8)))

    def painted(self) -> NDArray[np.float64]:
        """(side, side, 3) sRGB, 0 to 255, not rounded."""
        f = self.f
        if f.band > 0:
            for floor in range(1, f.floors):
                self.fill(0, floor, (0, f.bays), (0, f.band), BAND, (0.9, 1.0))
        if f.pilaster > 0:
            for column in range(0, f.bays + 1, int(f.every)):
                self.fill(column, 0, (-f.pilaster / 2, f.pilaster / 2), (0, f.floors), BAND, (0.95, 1.0))
        for floor in range(1, f.floors):
            for column in range(f.bays):
                self.bay(column, floor)
        self.street()
        self.fill(0, f.floors - 1, (0, f.bays), (1 - 1.4 * f.cornice, 1 - f.cornice), WALL, (0.75, 0.45))
        self.fill(0, f.floors - 1, (0, f.bays), (1 - f.cornice, 1), CORNICE, (0.85, 1.0))
        return self.finished()

    def finished(self) -> NDArray[np.float64]:
        f, side = self.f, self.side
        at = np.arange(side) * (f.bays * 5 / side)
        edges = [drawn(self.seed, STREAK, 0, k) for k in range(f.bays * 5 + 1)]
        streaks = np.interp(at, np.arange(len(edges)), edges)
        up = 1 - (np.arange(side) + 0.5) / side
        foot = 1 - np.minimum(up * f.floors / 2, 1)
        grime = f.dirt * (np.outer(0.25 + 0.75 * up, streaks) + (0.5 * foot**2)[:, None])
        noise = np.array([[drawn(self.seed, GRAIN, y, x) for x in range(side)] for y in range(side)])
        light = (1 - grime) * (1 + f.grain * (2 * noise - 1))
        return srgb_from_linear(np.clip(self.canvas * light[..., None], 0, 1)) * 255
