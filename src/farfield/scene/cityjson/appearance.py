"""Materials, textures and their themes."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.cityjson.document import mapping, sequence
from farfield.scene.textures import is_image

Color = tuple[int, int, int, int]
"""sRGB bytes and alpha."""
NO_COLOR: Color = (0, 0, 0, 0)
_MISSING = -1


@dataclass(frozen=True, slots=True)
class Image:
    """An image file as it was when the city was read: another one with its name is another image."""

    path: str
    size: int
    modified: int
    """Nanoseconds."""


class Images:
    """The image files of a whole file, each once."""

    def __init__(self, path: Path) -> None:
        self.found: list[Image] = []
        self.missing: dict[str, None] = {}
        self.unreadable: dict[str, None] = {}
        self._folder = path.parent
        self._number: dict[str, int] = {}

    def number(self, name: object) -> int:
        """Of an image in `found`, or -1: what is on the web, not there, or no image is noted."""
        if not isinstance(name, str) or not name:
            return _MISSING
        if name not in self._number:
            self._number[name] = self._look(name)
        return self._number[name]

    def _look(self, name: str) -> int:
        try:
            if "://" in name:
                raise FileNotFoundError
            path = self._folder / name.replace("\\", "/")
            facts = path.stat()
        except (OSError, ValueError):
            self.missing[name] = None
            return _MISSING
        if not is_image(path):
            self.unreadable[name] = None
            return _MISSING
        self.found.append(Image(str(path.absolute()), facts.st_size, facts.st_mtime_ns))
        return len(self.found) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """What a document says about looks."""

    colors: tuple[Color, ...]
    """Of each material; alpha 0 where it says none."""
    images: tuple[int, ...]
    """Of each texture its number among the images, -1 for one that is missing."""
    uvs: NDArray[np.float64]
    """(n, 2), v upwards; NaN where unusable."""
    material_theme: str
    texture_theme: str


NOTHING = Appearance((), (), np.empty((0, 2)), "", "")


def appearance_of(given: dict[str, Any], images: Images) -> Appearance:
    """Reads the appearance of a document; what is of no use in it becomes nothing."""
    if not given:
        return NOTHING
    return Appearance(
        tuple(_color(mapping(entry)) for entry in sequence(given.get("materials"))),
        tuple(images.number(mapping(entry).get("image")) for entry in sequence(given.get("textures"))),
        _pairs(sequence(given.get("vertices-texture"))),
        str(given.get("default-theme-material", "")),
        str(given.get("default-theme-texture", "")),
    )


def themed(given: object, wanted: str) -> dict[str, Any]:
    """What a geometry says for a theme; for its first where it does not know the wanted one."""
    themes = mapping(given)
    return mapping(themes.get(wanted, next(iter(themes.values()), None)))


def is_seen(color: Color) -> bool:
    """False for a material that is more transparent than not: a picture with depth holds one surface a pixel."""
    return color == NO_COLOR or color[3] >= 128


def report(images: Images, where: str, faults: Counter[str]) -> list[str]:
    """A line about images that are missing, one about those that are none, and those of surfaces counted already."""
    lines = []
    for verb, names in (("find", images.missing), ("read", images.unreadable)):
        if names:
            first, *others = names
            more = f" and {len(others):,} more" if others else ""
            lines.append(f"{where}: cannot {verb} the image {first}{more}; their surfaces have default colours")
    if count := faults.pop("texture", 0):
        noun = "surface has" if count == 1 else "surfaces have"
        lines.append(f"{where}: {count:,} {noun} texture coordinates that do not exist, and default colours")
    if count := faults.pop("transparent", 0):
        noun = "surface" if count == 1 else "surfaces"
        lines.append(f"{where}: left out {count:,} {noun} more than half transparent")
    return lines


def _color(material: dict[str, Any]) -> Color:
    try:
        red, green, blue = (_byte(share) for share in material["diffuseColor"])
        alpha = 255 - _byte(material.get("transparency", 0))
    except (KeyError, TypeError, ValueError, OverflowError):
        return NO_COLOR
    return red, green, blue, max(alpha, 1)


def _byte(share: object) -> int:
    value = float(share)  # type: ignore[arg-type]
    if math.isnan(value):
        raise ValueError("a colour that is no number")
    return int(min(max(value, 0.0), 1.0) * 255 + 0.5)


def _pairs(rows: list[Any]) -> NDArray[np.float64]:
    try:
        points = np.array(rows, np.float64)
        if points.ndim == 2 and points.shape[1] == 2:
            points[~(np.abs(points) <= 1e6).all(1)] = np.nan
            return points
    except (ValueError, TypeError, OverflowError):
        pass
    return np.array([_pair(row) for row in rows], np.float64).reshape(-1, 2)


def _pair(row: object) -> tuple[float, float]:
    try:
        u, v = (float(value) for value in row)  # type: ignore[attr-defined]
    except (ValueError, TypeError, OverflowError):
        return math.nan, math.nan
    return (u, v) if abs(u) <= 1e6 and abs(v) <= 1e6 else (math.nan, math.nan)
