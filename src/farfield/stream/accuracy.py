"""How well a representation shows an object, 0 to 1, as the thesis defines it (BEN 4.1).

These are the measures that walks are reported in. All take arrays that broadcast against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
FULL_ANGLE = np.radians(60.0)
"""Impostors seen at this angle to their plane or more squarely are as good as seen head on."""

PICTURE = 0.92
"""Of pictures whose pixels are no wider than the screen's."""
BLUR = 0.03, 0.0065
"""By which pictures are worse for each time that they are twice as coarse, and for the square of that."""


def level_accuracy(area: ArrayLike, faces: ArrayLike, all_faces: ArrayLike) -> Floats:
    """Of a level of detail, by the sizes of its faces and of the full model's on the screen (BEN 4.1).

    area: pixels of the bounding rectangle. faces: of the level. all_faces: of the full model. Faces of less than a
    pixel count as a pixel.
    """
    pixels, few, many = (np.asarray(part, dtype=np.float64) for part in (area, faces, all_faces))
    full, own = np.maximum(pixels / many, 1.0), np.maximum(pixels / few, 1.0)
    return np.asarray(np.sqrt(full / own))


def impostor_accuracy(rows: ArrayLike, height: ArrayLike, angle: ArrayLike) -> Floats:
    """Of an image on a board, by the sizes of its pixels and the angle at which it is seen (BEN 4.1).

    rows: of the image. height: pixels of the object on the screen. angle: radians between the board's base line and the
    line from the eye to its middle; a right angle is head on.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        sharpness = np.minimum(1.0, np.asarray(rows, dtype=np.float64) / np.asarray(height, dtype=np.float64))
    most = np.sin(FULL_ANGLE)
    squareness = np.clip(np.sin(angle), 0.0, most) / most
    return np.asarray(sharpness * squareness**3)


def texture_accuracy(texels: ArrayLike, area: ArrayLike) -> Floats:
    """Of a texture, by the sizes of its texels on the screen: as an impostor's, along a side.

    texels: of the whole texture. area: pixels of the bounding rectangle.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.asarray(texels, dtype=np.float64) / np.asarray(area, dtype=np.float64)
    return np.asarray(np.sqrt(np.minimum(1.0, share)))


def picture_accuracy(pitch: ArrayLike) -> Floats:
    """Of a cell's pictures against its geometry, by how wide their pixels are on the screen; no part of the thesis.

    pitch: pixels of the screen from one pixel of a picture to the next. Measured as 1 - FLIP / FLIP of nothing at all:
    three scenes from three sides each, with pixels as wide as the screen's and twice to sixteen times as wide: .91,
    .86, .81, .74, .70 (docs/performance.md, What comes first on a slow link). Beyond that it is a guess: a thousand
    times as wide they show nothing.
    """
    blur = np.log2(np.maximum(np.asarray(pitch, dtype=np.float64), 1.0))
    return np.asarray(np.maximum(PICTURE - (BLUR[0] + BLUR[1] * blur) * blur, 0.0))


def compound_accuracy(geometry: ArrayLike, texture: ArrayLike) -> Floats:
    """Of a level of detail with a level of its texture: the product (BEN 4.1.1, which leaves the form open).

    So either adds in proportion to what the other has reached, and a level without any texture adds nothing until the
    first texture is there.
    """
    return np.asarray(np.asarray(geometry, dtype=np.float64) * np.asarray(texture, dtype=np.float64))
