"""The colour plane: a simple lossy WebP file (RFC 9649), checked before a decoder sees it."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.errors import CorruptTileError

_FRAME_AT = 20
_KEY_FRAME = b"\x9d\x01\x2a"


def encode(color: NDArray[np.uint8], quality: int, method: int) -> bytes:
    """(h, w, 3) uint8 sRGB -> WebP of quality 0..100 with effort 0..6."""
    stream = io.BytesIO()
    Image.fromarray(color).save(stream, "WEBP", quality=quality, method=method)
    return stream.getvalue()


def decode(data: bytes, width: int, height: int, where: str) -> NDArray[np.uint8]:
    """WebP -> (height, width, 3) uint8. Raises CorruptTileError for another size or anything undecodable.

    The size is read from the frame header first: a decoder would allocate whatever the file claims.
    """
    size = _size(data)
    if size != (width, height):
        raise CorruptTileError(f"the colour is {_says(size)} instead of {width} x {height}", where)
    try:
        with Image.open(io.BytesIO(data), formats=["WEBP"]) as image:
            color = np.array(image.convert("RGB"))
    except (OSError, ValueError, EOFError, SyntaxError, RuntimeError) as error:
        raise CorruptTileError(f"the colour cannot be decoded: {error}", where) from None
    if color.shape != (height, width, 3):
        raise CorruptTileError(f"the colour decodes to {color.shape}", where)
    return color


def _size(data: bytes) -> tuple[int, int] | None:
    """Columns and rows of a simple lossy WebP; None when it is something else."""
    if len(data) < _FRAME_AT + 10 or data[:4] != b"RIFF" or data[8:16] != b"WEBPVP8 ":
        return None
    riff, chunk = int.from_bytes(data[4:8], "little"), int.from_bytes(data[16:20], "little")
    alone = riff + 8 == len(data) and riff == 12 + chunk + chunk % 2
    if not alone or data[_FRAME_AT + 3 : _FRAME_AT + 6] != _KEY_FRAME:
        return None
    return int.from_bytes(data[26:28], "little") & 0x3FFF, int.from_bytes(data[28:30], "little") & 0x3FFF


def _says(size: tuple[int, int] | None) -> str:
    return "no simple lossy WebP" if size is None else f"{size[0]} x {size[1]}"
