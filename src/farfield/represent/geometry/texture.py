"""Textures of near geometry: images in a store, checked before they are decoded."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from farfield.errors import CorruptTileError
from farfield.scene.model import Texture

MAXIMUM_SIDE = 8192
"""Columns or rows; `scene.textures` shrinks what is larger."""
_FORMATS = ("PNG", "JPEG", "WEBP")


def decode_texture(data: bytes, where: str) -> Texture:
    """Reads an image. Raises CorruptTileError.

    Allocates at most 32 bytes a pixel, of which there are at most 8192 x 8192, and 16 bytes for each byte of the file.
    """
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            if max(image.size) > MAXIMUM_SIDE:
                raise CorruptTileError(f"the image is {image.size[0]} x {image.size[1]}", where, "run farfield verify")
            return Texture(np.asarray(image.convert("RGBA")))
    except CorruptTileError:
        raise
    except Exception as error:
        # A dozen parsers stand behind this, each with exceptions of its own: SyntaxError, struct.error, EOFError,
        # DecompressionBombError and whatever an index into a short chunk gives.
        raise CorruptTileError(f"the image cannot be decoded: {error}", where, "run farfield verify") from None
