"""How well a representation shows an object, 0 to 1, as the thesis defines it (BEN 4.1).

These are the measures that walks are reported in. All take arrays that broadcast against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from farfield.represent.geometry.board import squareness
from farfield.world.index import ERROR_SPACING, FARTHEST

Floats = NDArray[np.float64]

UNTOLD = (0.08, 0.12, 0.23)
"""Errors of pictures in worlds that do not tell them (CellEntry.errors): means of three scenes."""
UNTOLD_LOSS = 0.12
"""The same of their losses (CellEntry.losses)."""
LOST, LEAST_LOST = 0.4, 0.2
"""See `loss_from`."""
LEAST_STEP = 0.05
"""By which pictures are worse at least for each ERROR_SPACING times that they are coarser than what is told."""


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
    return np.asarray(sharpness * squareness(np.sin(angle)))


def texture_accuracy(texels: ArrayLike, area: ArrayLike) -> Floats:
    """Of a texture, by the sizes of its texels on the screen: as an impostor's, along a side.

    texels: of the whole texture. area: pixels of the bounding rectangle.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.asarray(texels, dtype=np.float64) / np.asarray(area, dtype=np.float64)
    return np.asarray(np.sqrt(np.minimum(1.0, share)))


def picture_accuracy(told: ArrayLike, pitch: ArrayLike) -> Floats:
    """Of a cell's pictures against its geometry, by how wide their pixels are on the screen; no part of the thesis.

    told: (..., 3) errors that the bake measured, 0 to 1 (CellEntry.errors). pitch: (...) pixels of the screen from one
    pixel of a picture to the next. Beyond what is told it goes on as it did before.
    """
    errors = np.asarray(told, dtype=np.float64)
    at = np.log(np.maximum(FARTHEST * np.asarray(pitch, dtype=np.float64), 1.0)) / np.log(ERROR_SPACING)
    first, second, third = errors[..., 0], errors[..., 1], errors[..., 2]
    within = np.where(at < 1, first + (second - first) * at, second + (third - second) * (at - 1))
    beyond = third + np.maximum(third - second, LEAST_STEP) * (at - 2)
    return np.asarray(np.maximum(1 - np.where(at > 2, beyond, within), 0.0))


def loss_from(loss: ArrayLike, pitch: ArrayLike) -> Floats:
    """Of what is lost by a cell's pictures in the place of a child's: how much shows from farther away, or nearer.

    loss: where the child's pixels are as wide as the screen's (CellEntry.losses). pitch: of the cell's pictures, pixels
    of the screen. Measured: less by .4 of it each time that they are half as wide, down to a fifth.
    """
    share = np.clip(LOST * np.log2(np.maximum(np.asarray(pitch, dtype=np.float64), 1e-9)) + 1 - LOST, LEAST_LOST, 1.0)
    return np.asarray(np.asarray(loss, dtype=np.float64) * share)


def compound_accuracy(geometry: ArrayLike, texture: ArrayLike) -> Floats:
    """Of a level of detail with a level of its texture: the product (BEN 4.1.1, which leaves the form open).

    So either adds in proportion to what the other has reached, and a level without any texture adds nothing until the
    first texture is there.
    """
    return np.asarray(np.asarray(geometry, dtype=np.float64) * np.asarray(texture, dtype=np.float64))
