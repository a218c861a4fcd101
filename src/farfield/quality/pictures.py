"""Reading pictures that are to be compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from farfield.errors import InputError


def read_picture(path: Path) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 sRGB, or (h, w, 4) with straight alpha when the file has alpha.

    Raises InputError when the file is missing or no picture.
    """
    try:
        with Image.open(path) as image:
            alpha = "A" in image.getbands() or "transparency" in image.info
            return np.array(image.convert("RGBA" if alpha else "RGB"))
    except FileNotFoundError:
        raise InputError("no such file", str(path)) from None
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(f"not a picture that can be read: {error}", str(path), "PNG, JPEG or WebP") from None
