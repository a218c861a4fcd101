"""Textures from image files."""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np
from PIL import Image, UnidentifiedImageError

from farfield.errors import InputError
from farfield.scene.model import Texture

LARGEST = 8192
"""Longer sides are shrunk to this: 8192 x 8192 pixels are 256 MiB already."""
_UNREADABLE = (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError)


def decode_image(file: IO[bytes] | Path, where: str) -> Texture:
    """The texture in an image file of any format Pillow reads. Raises InputError when it is none."""
    try:
        with Image.open(file) as image:
            if max(image.size) > LARGEST:
                image.thumbnail((LARGEST, LARGEST), Image.Resampling.BOX)
            return Texture(np.asarray(image.convert("RGBA")))
    except FileNotFoundError as error:
        raise InputError("there is no such file", where, "put it beside the scene") from error
    except _UNREADABLE as error:
        raise InputError("is not an image that can be read", where, "save it as PNG or JPEG") from error


def is_image(path: Path) -> bool:
    """Whether a file begins as an image of a format that Pillow reads; what follows may be damaged all the same."""
    try:
        with Image.open(path):
            return True
    except _UNREADABLE:
        return False
