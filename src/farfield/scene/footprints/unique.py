"""Façades of which no two are the same: each is painted whole, by rule, from the seed of its building.

    styles = Styles.of(seed, height)
    layout = Layout.of(wall_length, wall_owner, styles)
    material = styles.material(0, layout.bays[0])

A façade holds all floors of its building, and all bays round it up to HELD; after those it repeats. What is painted
follows from the seed, the height and the number of bays alone, on every machine (kernels.facade).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels import facade as kernels
from farfield.scene.footprints.facades import SHORTEST_WINDOW_WALL
from farfield.scene.footprints.seeds import fractions
from farfield.scene.footprints.use import use_of
from farfield.scene.model import Material, Texture

FACADE_SIDE = 256
"""Texels along both sides of a façade. Blockmaps of Paris (BlockMaps 5) had 512."""
HELD = 16
"""Bays that a façade holds at most: 16 texels each."""
_MOST_FLOORS = 96
PIER = 0.06
"""Bays of bare wall at the left edge of every bay, whatever the façade: all that short walls show."""

KINDS = ("house", "apartments", "office", "tower", "industrial", "retail")
_LIMITS = (11.0, 42.0)
"""Metres that part low, middling and high."""
_SHARES = np.array(
    [
        [[0.60, 0.16, 0.06, 0.00, 0.04, 0.14], [0.02, 0.48, 0.34, 0.04, 0.00, 0.12], [0.00, 0.34, 0.16, 0.50, 0, 0]],
        [[0.75, 0.25, 0.00, 0.00, 0.00, 0.00], [0.00, 1.00, 0.00, 0.00, 0.00, 0.00], [0.00, 1.00, 0.00, 0.00, 0, 0]],
        [[0.00, 0.00, 1.00, 0.00, 0.00, 0.00], [0.00, 0.00, 0.85, 0.15, 0.00, 0.00], [0.00, 0.00, 0.30, 0.70, 0, 0]],
        [[0.00, 0.00, 0.00, 0.00, 1.00, 0.00], [0.00, 0.00, 0.00, 0.00, 1.00, 0.00], [0.00, 0.00, 0.00, 0.00, 1, 0]],
        [[0.00, 0.00, 0.00, 0.00, 0.00, 1.00], [0.00, 0.00, 0.00, 0.00, 0.00, 1.00], [0.00, 0.00, 0.00, 0.00, 0, 1]],
    ]
)
"""(uses, 3, kinds): share of each kind among low, middling and high buildings of a use; use 0: unknown."""

_Six = tuple[tuple[float, float], ...]
_RANGES: dict[str, _Six] = {
    # For each of KINDS the least and the most; drawn evenly between them.
    "bay": ((2.5, 3.4), (2.5, 3.6), (2.7, 3.8), (2.2, 3.2), (4.0, 6.0), (3.0, 4.2)),  # metres
    "floor": ((2.7, 3.1), (2.8, 3.2), (3.4, 3.9), (3.6, 4.1), (4.4, 6.0), (3.6, 4.3)),  # metres
    "left": ((0.18, 0.33), (0.12, 0.26), (0.10, 0.28), (0.08, 0.10), (0.10, 0.22), (0.10, 0.26)),
    "sill": ((0.28, 0.40), (0.26, 0.38), (0.20, 0.36), (0.03, 0.24), (0.48, 0.62), (0.18, 0.40)),
    "head": ((0.74, 0.84), (0.76, 0.86), (0.76, 0.88), (0.86, 0.97), (0.78, 0.88), (0.72, 0.90)),
    "frame": ((0.05, 0.10), (0.04, 0.08), (0.04, 0.09), (0.04, 0.09), (0.04, 0.07), (0.05, 0.10)),  # metres
    "panes": ((1.0, 2.99), (1.0, 2.99), (1.0, 3.99), (1.0, 2.99), (2.0, 5.99), (1.0, 3.99)),
    "transom": ((-0.6, 0.75), (-0.9, 0.75), (-0.9, 0.80), (-0.6, 0.85), (-0.4, 0.60), (-0.6, 0.80)),  # below 0: none
    "band": ((-0.15, 0.08), (-0.05, 0.14), (-0.08, 0.15), (-0.06, 0.10), (-0.10, 0.06), (-0.05, 0.15)),
    "pilaster": ((-0.4, 0.10), (-0.3, 0.14), (-0.16, 0.22), (-0.12, 0.16), (-0.04, 0.12), (-0.2, 0.18)),
    "every": ((1.0, 3.99), (1.0, 4.99), (1.0, 3.99), (1.0, 2.99), (1.0, 3.99), (1.0, 3.99)),
    "cornice": ((0.05, 0.12), (0.08, 0.22), (0.08, 0.24), (0.06, 0.20), (0.05, 0.10), (0.08, 0.26)),
    "narrow": ((0.05, 0.40), (0.05, 0.30), (-0.2, 0.15), (-0.5, 0.00), (-0.1, 0.30), (-0.2, 0.20)),
    "balcony": ((-0.4, 0.30), (0.10, 0.75), (-0.9, 0.15), (-0.9, 0.00), (-1.0, 0.00), (-0.9, 0.20)),
    "blinds": ((0.15, 0.50), (0.20, 0.55), (0.10, 0.45), (0.02, 0.25), (0.00, 0.15), (0.05, 0.30)),
    "lit": ((0.02, 0.12), (0.02, 0.12), (0.02, 0.15), (0.01, 0.08), (0.00, 0.08), (0.05, 0.20)),
    "grain": ((0.02, 0.08), (0.02, 0.08), (0.01, 0.06), (0.01, 0.03), (0.02, 0.08), (0.02, 0.06)),
    "dirt": ((0.00, 0.35), (0.05, 0.40), (0.00, 0.35), (0.00, 0.15), (0.10, 0.50), (0.00, 0.30)),
}
_STREETS = np.array(
    [[0.92, 0.04, 0.00, 0.04], [0.45, 0.35, 0.20, 0.00], [0.10, 0.30, 0.60, 0.00], [0.00, 0.15, 0.85, 0.00],
     [0.05, 0.00, 0.00, 0.95], [0.00, 0.95, 0.05, 0.00]]
)  # fmt: skip
"""(kinds, streets): share of each ground floor (kernels.facade.HOME, ...)."""

_Color = tuple[int, int, int]
_WALLS: tuple[tuple[_Color, ...], ...] = (
    ((222, 214, 196), (206, 190, 166), (196, 198, 196), (168, 132, 104), (232, 230, 224), (150, 142, 134),
     (188, 172, 140), (122, 104, 90), (212, 200, 206)),
    ((204, 196, 180), (176, 120, 94), (216, 212, 204), (150, 96, 76), (188, 186, 182), (226, 220, 206), (160, 150, 138),
     (196, 168, 138), (132, 128, 126)),
    ((192, 190, 186), (170, 166, 158), (142, 94, 76), (208, 204, 196), (128, 130, 134), (186, 168, 146),
     (106, 110, 116), (220, 220, 218)),
    ((112, 128, 142), (82, 92, 104), (148, 156, 160), (190, 194, 196), (96, 90, 86), (124, 112, 98)),
    ((156, 162, 164), (178, 176, 168), (120, 134, 146), (148, 140, 126), (110, 124, 112), (200, 198, 190)),
    ((214, 208, 198), (178, 172, 164), (226, 222, 214), (150, 110, 88), (98, 98, 102), (196, 158, 118)),
)  # fmt: skip
"""For each kind, sRGB."""
_GLASS: tuple[_Color, ...] = ((52, 62, 72), (60, 76, 92), (74, 96, 112), (48, 58, 56), (66, 70, 82), (82, 92, 96))
_FRAMES: tuple[_Color, ...] = (
    (226, 224, 218),
    (92, 96, 100),
    (60, 56, 54),
    (168, 172, 174),
    (120, 84, 60),
    (44, 52, 60),
)
_DOORS: tuple[_Color, ...] = ((110, 72, 48), (62, 70, 78), (142, 146, 148), (88, 40, 36), (48, 74, 66), (172, 166, 152))
_BLINDS: tuple[_Color, ...] = ((206, 202, 192), (188, 178, 160), (176, 182, 186))
_LIGHTS: tuple[_Color, ...] = ((236, 206, 148), (226, 220, 200), (240, 190, 120))
_SIGNS: tuple[_Color, ...] = (
    (196, 52, 44), (44, 92, 160), (238, 196, 60), (48, 128, 84), (236, 236, 230), (36, 38, 44), (222, 118, 40),
    (128, 60, 120), (70, 152, 176), (206, 96, 120),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Styles:
    """How n buildings look."""

    seed: NDArray[np.uint32]
    kind: NDArray[np.int64]
    """(n,) into KINDS."""
    bay: NDArray[np.float64]
    """(n,) metres that a bay is wide, about."""
    floors: NDArray[np.int64]
    """(n,)"""
    street: NDArray[np.int64]
    """(n,)"""
    numbers: NDArray[np.float32]
    """(n, 17) as kernels.facade.Facade has them, from `left` on."""
    colors: NDArray[np.float32]
    """(n, c, 3) linear light."""

    @classmethod
    def of(cls, seed: NDArray[np.uint32], height: NDArray[np.floating]) -> Styles:
        """height: (n,) metres. The lowest bits of a seed tell the use (use.with_use)."""
        # Positions are single precision from the corner of a mesh, which moves with the neighbours.
        height = np.round(height.astype(np.float64), 3)
        kind = _chosen(_SHARES[use_of(seed), np.digitize(height, _LIMITS)], fractions(seed, 8))
        drawn = {name: _between(seed, 16 + k, kind, ranges) for k, (name, ranges) in enumerate(_RANGES.items())}
        bay, floor = drawn["bay"], drawn["floor"]
        floors = np.clip(np.round(height / floor), 1, _MOST_FLOORS).astype(np.int64)
        tall = height / floors
        for name in ("transom", "band", "pilaster", "narrow", "balcony"):
            drawn[name] = np.maximum(drawn[name], 0)
        transom = drawn["transom"]
        drawn["transom"] = np.where(transom > 0.25, transom, 0)
        drawn["panes"], drawn["every"] = np.floor(drawn["panes"]), np.floor(drawn["every"])
        drawn["frame_x"], drawn["frame_y"] = drawn["frame"] / bay, drawn["frame"] / tall
        numbers = np.stack([drawn[name] for name in kernels.Facade._fields[4:-1]], axis=1)
        street = _chosen(_STREETS[kind], fractions(seed, 9))
        return cls(seed, kind, bay, floors, street, numbers.astype(np.float32), _colors(seed, kind))

    def pixels(self, row: int, bays: int, side: int = 0) -> NDArray[np.uint8]:
        """(side, side, 4) uint8 sRGB, row 0 at the roof; side 0: FACADE_SIDE. bays: that it holds."""
        side = side or FACADE_SIDE
        facts = np.uint64(self.seed[row]), int(self.floors[row]), bays, int(self.street[row])
        facade = kernels.Facade._make((*facts, *self.numbers[row], self.colors[row]))
        canvas, streaks = np.empty((side, side, 3), np.float32), np.empty(side, np.float32)
        pixels = np.empty((side, side, 4), np.uint8)
        kernels.paint_facade(facade, canvas, streaks, pixels)
        return pixels

    def material(self, row: int, bays: int) -> Material:
        """Of one building; 1 ms."""
        return Material(KINDS[self.kind[row]], texture=Texture(self.pixels(row, bays)), double_sided=False)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where the walls of buildings lie in their façades. Walls longer than a façade are cut into pieces."""

    wall: NDArray[np.int64]
    """(p,) wall that each piece is of, ascending."""
    share: NDArray[np.float64]
    """(p, 2) of the wall's length where a piece begins and ends."""
    u: NDArray[np.float64]
    """(p, 2) where it begins and ends in the façade, 0 to 1."""
    bays: NDArray[np.int64]
    """(n,) that each building's façade holds."""

    @classmethod
    def of(cls, length: NDArray[np.float64], owner: NDArray[np.int64], styles: Styles) -> Layout:
        """length: (w,) metres of walls. owner: (w,) building of each, ascending."""
        has_windows = length >= SHORTEST_WINDOW_WALL
        count = np.where(has_windows, np.maximum(np.round(length / styles.bay[owner]), 1), 0).astype(np.int64)
        total = np.bincount(owner, count, minlength=len(styles.seed)).astype(np.int64)
        held = np.clip(total, 1, HELD)
        pieces = np.maximum(-(-count // held[owner]), 1)
        wall = np.repeat(np.arange(len(length)), pieces)
        number = np.arange(len(wall)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        ends = np.stack([number, number + 1]) * count[wall] // pieces[wall]
        own, room = ends[1] - ends[0], held[owner[wall]]
        before = np.cumsum(own) - own
        first = np.searchsorted(owner[wall], np.arange(len(styles.seed)))
        start = (before - before[np.minimum(first, len(before) - 1)][owner[wall]]) % room
        start = np.minimum(start, room - own)
        start = np.where(own == 0, np.minimum(start, room - 1), start)
        u = np.stack([start, np.where(own == 0, start + PIER, start + own)], 1) / room[:, None]
        share = ends.T / np.maximum(count[wall], 1)[:, None]
        share[own == 0] = 0, 1
        return cls(wall, share, u, held)


def _chosen(shares: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) which of the shares (n, k) a number in 0..1 falls into."""
    edges = np.cumsum(shares, axis=1)
    edges[:, -1] = np.inf
    return np.asarray((at[:, None] >= edges).sum(axis=1), np.int64)


def _between(seed: NDArray[np.uint32], stream: int, kind: NDArray[np.int64], ranges: _Six) -> NDArray[np.float64]:
    low, high = np.array(ranges)[kind].T
    return np.asarray(low + (high - low) * fractions(seed, stream))


def _colors(seed: NDArray[np.uint32], kind: NDArray[np.int64]) -> NDArray[np.float32]:
    """(n, c, 3) linear light."""
    most = max(map(len, _WALLS))
    walls = np.array([list(own) + [own[-1]] * (most - len(own)) for own in _WALLS])
    which = (fractions(seed, 64) * np.array([len(own) for own in _WALLS])[kind]).astype(np.int64)
    wall = _varied(walls[kind, which], seed, 65, 0.30, 0.08)
    # The ground floor is of the wall, paler or darker, or of another stone.
    stone = _varied(_of(((96, 94, 92), (150, 144, 136), (186, 180, 170), (120, 92, 76)), seed, 70), seed, 71, 0.2, 0.04)
    base = np.where((fractions(seed, 75) < 0.45)[:, None], stone, wall * _ranged(seed, 76, 0.72, 1.05))
    glass = _varied(_of(_GLASS, seed, 80), seed, 81, 0.35, 0.06)
    frame = _varied(_of(_FRAMES, seed, 85), seed, 86, 0.15, 0.03)
    band = np.where(
        (fractions(seed, 90) < 0.4)[:, None], 255 - (255 - wall) * 0.6, wall * _ranged(seed, 91, 0.70, 1.12)
    )
    rail = _of(((206, 204, 198), (96, 110, 120), (70, 72, 76), (170, 190, 196)), seed, 95)
    balcony = np.where((fractions(seed, 96) < 0.5)[:, None], wall * _ranged(seed, 97, 0.85, 1.15), rail)
    cornice = np.where((fractions(seed, 100) < 0.5)[:, None], wall * _ranged(seed, 101, 0.6, 0.9), band)
    blind = _varied(_of(_BLINDS, seed, 105), seed, 106, 0.15, 0.04)
    light = _of(_LIGHTS, seed, 110)
    door = _varied(_of(_DOORS, seed, 111), seed, 112, 0.3, 0.05)
    signs = [_varied(_of(_SIGNS, seed, 116 + 5 * k), seed, 117 + 5 * k, 0.2, 0.05) for k in range(kernels.SIGNS)]
    every = np.stack([wall, base, glass, frame, band, balcony, cornice, blind, light, door, *signs], axis=1)
    return LINEAR_OF_BYTE[np.clip(np.round(every), 0, 255).astype(np.uint8)]


def _of(palette: tuple[_Color, ...], seed: NDArray[np.uint32], stream: int) -> NDArray[np.float64]:
    return np.array(palette, np.float64)[(fractions(seed, stream) * len(palette)).astype(np.int64)]


def _ranged(seed: NDArray[np.uint32], stream: int, low: float, high: float) -> NDArray[np.float64]:
    return np.asarray(low + (high - low) * fractions(seed, stream))[:, None]


def _varied(
    color: NDArray[np.float64], seed: NDArray[np.uint32], stream: int, lightness: float, hue: float
) -> NDArray[np.float64]:
    """(n, 3) sRGB made lighter or darker, and each primary a little for itself."""
    factor = _ranged(seed, stream, 1 - lightness, 1 + lightness / 3)
    own = [_ranged(seed, stream + 1 + k, 1 - hue / 2, 1 + hue / 2) for k in range(3)]
    return np.asarray(color * factor * np.concatenate(own, axis=1))
