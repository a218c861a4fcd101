"""Decoded images, shared by the chunks whose faces have them."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from threading import Lock

from farfield.scene.cityjson.appearance import Image
from farfield.scene.model import Texture
from farfield.scene.textures import decode_image

BUDGET = 256 << 20
"""Bytes of pixels: 1,024 images of 256 x 256."""


class DecodedImages:
    """The images used last, within a budget of bytes; threads may share it."""

    def __init__(self, budget: int = BUDGET) -> None:
        self._budget = budget
        self._bytes = 0
        self._kept: OrderedDict[Image, Texture] = OrderedDict()
        self._lock = Lock()

    def get(self, image: Image) -> Texture:
        """The image, from memory or read again. Raises InputError when it cannot be read."""
        with self._lock:
            if image not in self._kept:
                self._kept[image] = texture = decode_image(Path(image.path), image.path)
                self._bytes += texture.pixels.nbytes
                while self._bytes > self._budget and len(self._kept) > 1:
                    self._bytes -= self._kept.popitem(last=False)[1].pixels.nbytes
            self._kept.move_to_end(image)
            return self._kept[image]
