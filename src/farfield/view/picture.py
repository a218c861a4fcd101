"""A finished picture with its layers, and its files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.errors import OptionError
from farfield.geometry.color import srgb_from_linear

LAYERS = ("colour", "depth", "normal", "id")
"""Names of the layers that can be written."""


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a picture was made of."""

    seconds: float = 0.0
    cells: int = 0
    """Cells drawn from orthoviews, within the frustum."""
    orthoviews: int = 0
    """Views drawn; the two layers of a view count once."""
    splats: int = 0
    triangles: int = 0
    tile_bytes: int = 0
    """Encoded size of all tiles drawn."""
    warnings: int = 0
    """Cells with tiles that are missing or damaged; their parents stand in."""


@dataclass(frozen=True, slots=True)
class Picture:
    """What a renderer makes: straight colour over nothing, and layers beside it."""

    color: NDArray[np.float32]
    """(h, w, 3) float32 linear light, mean over the covered samples of the pixel; 0 where alpha is."""
    alpha: NDArray[np.float32]
    """(h, w) float32: covered share of the pixel's samples."""
    depth: NDArray[np.float32]
    """(h, w) float32 metres along the view axis of the nearest sample; inf = nothing."""
    normal: NDArray[np.float32] | None = None
    """(h, w, 3) float32 world normal, mean of the covered samples, unit or 0; None when not asked for."""
    ids: NDArray[np.uint32] | None = None
    """(h, w) uint32 object of the nearest sample, 0 = none; None when not asked for."""
    statistics: Statistics = field(default_factory=Statistics)

    def pixels(self, sky: NDArray[np.floating] | None) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 sRGB over a sky, or without one (h, w, 4) with straight alpha.

        sky: (3,) or (h, w, 3) linear light.
        """
        if sky is None:
            color = np.concatenate([srgb_from_linear(self.color), self.alpha[..., None]], -1)
        else:
            alpha = self.alpha[..., None].astype(np.float64)
            color = srgb_from_linear(self.color * alpha + sky * (1 - alpha))
        return np.floor(color * 255 + 0.5).astype(np.uint8)

    def save(self, path: Path, sky: NDArray[np.floating] | None, layers: tuple[str, ...] = ("colour",)) -> list[Path]:
        """Writes the colour as PNG to `path` and the other layers beside it; returns all files written.

        depth: NAME.depth.npy, float32 metres, inf = nothing; of splats up to a pitch too far (spec/drawing.md).
        normal: NAME.normal.png, 8 bits, (n + 1) / 2, world axes.
        id: NAME.id.npy, uint32. Raises OptionError for an unknown layer or one that was not rendered.
        """
        written = []
        for name in layers:
            written.append(self._save_layer(path, sky, name))
        return written

    def _save_layer(self, path: Path, sky: NDArray[np.floating] | None, name: str) -> Path:
        target = path
        if name == "colour":
            Image.fromarray(self.pixels(sky)).save(target, format="PNG")
        elif name == "depth":
            target = path.with_suffix(".depth.npy")
            np.save(target, self.depth)
        elif name == "normal" and self.normal is not None:
            target = path.with_suffix(".normal.png")
            Image.fromarray(np.floor((self.normal + 1) * 127.5 + 0.5).astype(np.uint8)).save(target)
        elif name == "id" and self.ids is not None:
            target = path.with_suffix(".id.npy")
            np.save(target, self.ids)
        else:
            raise OptionError(f"no layer {name!r} to write", "--layers", f"layers are {', '.join(LAYERS)}")
        return target
