"""Flat ground with a tiling procedural texture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Material, Mesh, Texture
from farfield.scene.procedural.noise import tiling_noise

TEXTURE_SIZE = 1024


@dataclass(frozen=True, slots=True)
class GroundPattern:
    """How a kind of ground looks: one colour, made lighter and darker at two scales."""

    color: tuple[int, int, int]
    """sRGB."""
    coarse: float
    """Deviation of lightness in patches of metres, as a fraction."""
    fine: float
    """The same from pixel to pixel."""
    hue: float
    """Deviation of red against green, as a fraction: dry and lush spots."""
    slabs: int = 0
    """Slabs along the texture's side, each of a lightness of its own, with dark joints; 0: none."""


PATTERNS = {
    "plain": GroundPattern((128, 128, 124), 0.0, 0.0, 0.0),
    "grass": GroundPattern((84, 104, 52), 0.13, 0.12, 0.05),
    "asphalt": GroundPattern((98, 98, 100), 0.05, 0.06, 0.005),
    "paving": GroundPattern((148, 144, 136), 0.03, 0.03, 0.01, 16),
    "earth": GroundPattern((124, 104, 78), 0.10, 0.10, 0.03),
}


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """A rectangle at z = 0 round (0, 0), facing up."""

    width: float
    depth: float
    pattern: str = "plain"
    color: tuple[int, int, int] | None = None
    """sRGB; None: the pattern's own."""
    tile: float = 30.0
    """Metres after which the texture repeats."""

    @property
    def name(self) -> str:
        """For people."""
        return f"ground ({self.pattern})"

    def load(self) -> Mesh:
        """Two triangles."""
        x, y = self.width / 2, self.depth / 2
        positions = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], np.float64)
        texture = ground_texture(self.pattern, self.color)
        return Mesh(
            positions=positions,
            triangles=np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
            normals=np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
            materials=(Material(self.name, texture=texture),),
            triangle_material=np.zeros(2, np.uint16),
            uvs=(positions[:, :2] / self.tile * (1, -1)).astype(np.float32),
        )


@lru_cache(maxsize=8)
def ground_texture(pattern: str, color: tuple[int, int, int] | None = None) -> Texture:
    """The tiling texture of a pattern of `PATTERNS`, in its own colour or another; the same in every process."""
    look = PATTERNS[pattern]
    base = np.array(color or look.color, np.float64)
    if not look.coarse and not look.fine:
        return _opaque(np.tile(base, (4, 4, 1)))
    coarse = tiling_noise(TEXTURE_SIZE, 1.3, 4, seed=1)
    fine = tiling_noise(TEXTURE_SIZE, 0.4, 24, seed=2)
    hue = tiling_noise(TEXTURE_SIZE, 1.1, 4, seed=3)
    lightness = np.clip(1 + look.coarse * coarse + look.fine * fine, 0.4, 1.6)
    if look.slabs:
        lightness *= _slabs(look.slabs)
    tint = np.stack([1 + look.hue * hue, np.ones_like(hue), 1 - 0.5 * look.hue * hue], -1)
    return _opaque(base * lightness[..., None] * tint)


def _slabs(count: int) -> NDArray[np.float64]:
    """(size, size) lightness of square slabs; joints are 3 % of a slab wide."""
    side = TEXTURE_SIZE // count
    joint = np.arange(TEXTURE_SIZE) % side < 0.03 * side
    own = 1 + 0.05 * np.random.default_rng(4).standard_normal((count, count))
    return np.where(joint[:, None] | joint[None], 0.72, np.kron(own, np.ones((side, side))))


def _opaque(rgb: NDArray[np.float64]) -> Texture:
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = np.clip(np.floor(rgb + 0.5), 0, 255)
    return Texture(pixels)
