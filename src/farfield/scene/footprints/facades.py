"""Façades: a few tiling textures of windows, and colours drawn from a building's seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE, linear_from_srgb, srgb_from_linear
from farfield.scene.footprints.seeds import fractions
from farfield.scene.model import Material, Texture
from farfield.scene.procedural.noise import tiling_noise

BAY, FLOOR = 3.0, 3.6
"""Metres: width of a bay, height of a floor."""
BAYS, FLOORS = 8, 8
"""What one texture holds before it repeats."""
CELL = 64
"""Pixels a bay and a floor: 4.7 and 5.6 cm each."""
PIER = 0.04
"""Bays of bare wall at the left edge of every bay, whatever the façade."""


@dataclass(frozen=True, slots=True)
class Facade:
    """Looks of one kind of wall. Window edges are fractions of a bay (left, right) and a floor (sill, head)."""

    name: str
    wall: tuple[int, int, int]
    glass: tuple[int, int, int]
    frame: tuple[int, int, int]
    left: float
    right: float
    sill: float
    head: float
    band: tuple[int, int, int] | None = None
    """Colour of a band at the floor slab, or None."""
    lit: float = 0.1
    """Share of windows with pale blinds or light behind them."""
    grain: float = 0.03
    """Deviation of the wall's lightness."""


FACADES = (
    Facade("concrete", (186, 182, 174), (58, 70, 82), (212, 210, 206), 0.20, 0.84, 0.28, 0.80, (168, 164, 156)),
    Facade("ribbon", (200, 198, 194), (52, 66, 80), (92, 96, 100), 0.04, 1.00, 0.32, 0.76, None, 0.16, 0.02),
    Facade("glass", (112, 128, 142), (74, 98, 118), (168, 178, 186), 0.05, 1, 0.08, 0.94, (138, 146, 152), 0.08, 0.01),
    Facade("brick", (142, 94, 76), (48, 54, 62), (220, 214, 204), 0.28, 0.74, 0.26, 0.78, (158, 112, 92), 0.12, 0.07),
    Facade("plaster", (214, 204, 184), (60, 66, 72), (236, 232, 224), 0.22, 0.78, 0.24, 0.74, None, 0.14, 0.035),
    Facade("balcony", (206, 200, 190), (56, 62, 70), (180,) * 3, 0.06, 0.96, 0.3, 0.86, (232, 230, 224), 0.14, 0.02),
    Facade("metal", (104, 108, 112), (40, 48, 58), (136, 140, 144), 0.06, 0.98, 0.22, 0.88, (86, 90, 94), 0.06, 0.015),
)  # fmt: skip
VARIANTS = len(FACADES)

SHORTEST_WINDOW_WALL = 1.5
"""Metres; shorter walls have no windows."""

_WEIGHTS = np.array(
    [[0.15, 0.02, 0.0, 0.18, 0.45, 0.20, 0.0], [0.30, 0.18, 0.05, 0.17, 0.12, 0.15, 0.03],
     [0.12, 0.28, 0.36, 0.0, 0.0, 0.06, 0.18]]
)  # fmt: skip
"""(3, variants): share of each façade among low, middling and high buildings."""
_LIMITS = (11.0, 42.0)
"""Metres that part low, middling and high."""


def variant_of(seed: NDArray[np.uint32], height: NDArray[np.floating]) -> NDArray[np.int64]:
    """(n,) façade of each building, by its seed and height."""
    shares = np.cumsum(_WEIGHTS, axis=1)[np.digitize(height, _LIMITS)]
    passed: NDArray[np.int64] = np.sum(fractions(seed, 0)[:, None] >= shares, axis=1)
    return np.minimum(passed, VARIANTS - 1)


def wall_tints(seed: NDArray[np.uint32], variant: NDArray[np.int64], textured: bool) -> NDArray[np.uint8]:
    """(n, 4) uint8 sRGB, multiplied with the texture, or the wall's own colour when there is none."""
    lightness = 0.80 + 0.20 * fractions(seed, 1)
    warmth = (fractions(seed, 2) - 0.5) * 0.10
    tint = lightness[:, None] * np.stack([1 + warmth.clip(None, 0), 1 - np.abs(warmth) / 2, 1 - warmth.clip(0)], -1)
    base = np.full((len(seed), 3), 255.0) if textured else np.array([f.wall for f in FACADES], np.float64)[variant]
    return _opaque(base * tint)


def given_tints(color: NDArray[np.uint8], variant: NDArray[np.int64], textured: bool) -> NDArray[np.uint8]:
    """(n, 4) uint8 sRGB with which the walls have the wanted colours (n, 3 or 4), on the mean over a pale façade.

    A colour lighter than the façade, which has windows, becomes as light as that, and keeps its hue.
    """
    linear = linear_from_srgb(color[:, :3] / 255.0)
    if textured:
        linear /= np.array([_pale_mean(k) for k in range(VARIANTS)])[variant][:, None]
        linear /= np.maximum(linear.max(axis=1, initial=1.0), 1.0)[:, None]
    return _opaque(srgb_from_linear(linear) * 255)


def roof_colors(seed: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """(n, 4) uint8 sRGB: gravel, concrete and a few painted or planted roofs."""
    palette = np.array([[152, 150, 146], [134, 134, 134], [168, 164, 156], [120, 124, 128], [144, 132, 120],
                        [112, 124, 108], [150, 118, 104]], np.float64)  # fmt: skip
    share = np.cumsum([0.28, 0.2, 0.22, 0.14, 0.08, 0.05])
    kind = np.digitize(fractions(seed, 3), share)
    return _opaque(palette[kind] * (0.86 + 0.26 * fractions(seed, 4))[:, None])


def plain_material() -> Material:
    """Roofs and untextured walls: vertex colours alone."""
    return _plain()


@lru_cache(maxsize=1)
def _plain() -> Material:
    return Material("plain", double_sided=False)


@lru_cache(maxsize=VARIANTS)
def facade_material(variant: int) -> Material:
    """The material of a façade; made once a process, 20 ms each."""
    return Material(FACADES[variant].name, texture=Texture(facade_pixels(variant)), double_sided=False)


@lru_cache(maxsize=VARIANTS)
def pale_facade_material(variant: int) -> Material:
    """The façade in grey, its wall nearly white, for tints of any colour."""
    return Material(f"pale {FACADES[variant].name}", texture=Texture(pale_facade_pixels(variant)), double_sided=False)


def pale_facade_pixels(variant: int) -> NDArray[np.uint8]:
    """(512, 512, 4) uint8: lightness of the façade, its wall at _PALE; what is lighter than white is white."""
    pixels = facade_pixels(variant)
    wall = _lightness(linear_from_srgb(np.array(FACADES[variant].wall) / 255.0))
    light = np.minimum(_lightness(LINEAR_OF_BYTE[pixels[..., :3]].astype(np.float64)) / wall * _PALE, 1.0)
    pixels[..., :3] = np.floor(srgb_from_linear(light) * 255 + 0.5)[..., None]
    return pixels


_PALE = 0.92
"""Linear light of a pale wall: below white, so that its grain is not cut off."""


@lru_cache(maxsize=VARIANTS)
def _pale_mean(variant: int) -> float:
    """Linear light: the mean over a pale façade."""
    material = pale_facade_material(variant)
    assert material.texture is not None
    return float(LINEAR_OF_BYTE[material.texture.pixels[..., 0]].mean(dtype=np.float64))


def _lightness(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminance (Rec. 709) of (..., 3)."""
    return np.asarray(0.2126 * linear[..., 0] + 0.7152 * linear[..., 1] + 0.0722 * linear[..., 2])


def facade_pixels(variant: int) -> NDArray[np.uint8]:
    """(512, 512, 4) uint8: 8 bays by 8 floors, row 0 at the top; the same on every machine."""
    look = FACADES[variant]
    size = CELL * BAYS
    x = (np.arange(CELL) + 0.5) / CELL
    up = 1 - x
    grain = 1 + look.grain * tiling_noise(size, 0.8, 4, seed=variant)
    image = np.tile(np.array(look.wall, np.float64), (FLOORS, BAYS, CELL, CELL, 1))
    if look.band is not None:
        image[:, :, up < 0.10] = look.band
    if look.name == "balcony":
        image[:, :, (up > 0.10) & (up < 0.30)] = np.array(look.band) * 0.94
    flat = image.transpose(0, 2, 1, 3, 4).reshape(size, size, 3) * grain[..., None]
    image = flat.reshape(FLOORS, CELL, BAYS, CELL, 3).transpose(0, 2, 1, 3, 4)
    _draw_windows(image, look, x, up, np.random.default_rng(variant))
    pixels = np.full((size, size, 4), 255, np.uint8)
    pixels[..., :3] = np.clip(np.floor(image.transpose(0, 2, 1, 3, 4).reshape(size, size, 3) + 0.5), 0, 255)
    return pixels


def _draw_windows(
    image: NDArray[np.float64], look: Facade, x: NDArray[np.float64], up: NDArray[np.float64], rng: np.random.Generator
) -> None:
    """Frames, then panes with a mullion; each pane has a brightness of its own, some have blinds or light."""
    frame = 0.035
    opening = np.outer((up > look.sill) & (up < look.head), (x > look.left) & (x < look.right))
    image[:, :, opening] = look.frame
    rows = (up > look.sill + frame) & (up < look.head - frame)
    middle = (look.left + look.right) / 2
    for low, high in ((look.left + frame, middle - frame / 2), (middle + frame / 2, look.right - frame)):
        pane = np.outer(rows, (x > low) & (x < high))
        image[:, :, pane] = _panes(look, pane, up, rng)
    image[:, :, np.outer((up > look.sill - 0.03) & (up <= look.sill), (x > look.left) & (x < look.right))] *= 0.8


def _panes(
    look: Facade, pane: NDArray[np.bool_], up: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """(floors, bays, pixels of a pane, 3): glass that mirrors a brighter sky towards its top."""
    height = np.broadcast_to(up[:, None], pane.shape)[pane]
    sky = 0.8 + 0.45 * (height - look.sill) / (look.head - look.sill)
    brightness = rng.uniform(0.65, 1.3, (FLOORS, BAYS, 1, 1))
    glass = np.array(look.glass, np.float64) * brightness * sky[:, None]
    drawn = rng.uniform(0.2, 1.0, (FLOORS, BAYS, 1))
    blind = (rng.random((FLOORS, BAYS, 1)) < look.lit) & (height > look.head - drawn * (look.head - look.sill))
    color = np.where(rng.random((FLOORS, BAYS, 1, 1)) < 0.3, np.array([214, 190, 138.0]), np.array([172, 172, 166.0]))
    return np.where(blind[..., None], color, glass)


def _opaque(rgb: NDArray[np.float64]) -> NDArray[np.uint8]:
    out = np.full((len(rgb), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.floor(rgb + 0.5), 0, 255)
    return out
