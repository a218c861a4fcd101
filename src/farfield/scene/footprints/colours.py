"""Colours of walls and roofs in words: names of CSS, #rgb, #rrggbb, and materials."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

MATERIALS = {
    "brick": (150, 92, 72), "bricks": (150, 92, 72), "clinker": (124, 76, 62), "wood": (142, 108, 74),
    "timber_framing": (214, 204, 184), "stone": (168, 160, 146), "sandstone": (200, 176, 134),
    "limestone": (212, 204, 184), "granite": (146, 140, 136), "marble": (226, 222, 214), "concrete": (172, 170, 164),
    "cement_block": (166, 164, 158), "plaster": (222, 212, 192), "stucco": (222, 212, 192), "render": (222, 212, 192),
    "glass": (118, 146, 164), "mirror": (134, 160, 176), "metal": (150, 154, 158), "steel": (140, 144, 148),
    "aluminium": (176, 180, 182), "metal_plates": (150, 154, 158), "metal_sheet": (150, 154, 158),
    "tin": (158, 160, 160), "zinc": (136, 142, 146), "copper": (124, 168, 146), "gold": (212, 172, 74),
    "slate": (84, 88, 94), "tiles": (168, 92, 66), "roof_tiles": (168, 92, 66), "tile": (168, 92, 66),
    "asphalt": (74, 74, 76), "tar_paper": (66, 66, 68), "bitumen": (66, 66, 68), "gravel": (150, 146, 138),
    "eternit": (150, 150, 148), "thatch": (150, 128, 84), "grass": (104, 130, 74), "adobe": (182, 140, 100),
    "mud": (150, 116, 84), "vinyl": (222, 222, 216), "plastic": (206, 208, 208),
}  # fmt: skip
"""sRGB of what OpenStreetMap calls building:material and roof:material; copper is weathered."""


def colours_of(column: NDArray[Any]) -> tuple[NDArray[np.uint8], int]:
    """(n, 4) sRGB and alpha, 0 where none is given; and how many words are no colour that is known."""
    return _looked_up(column, colour_of)


def materials_of(column: NDArray[Any]) -> tuple[NDArray[np.uint8], int]:
    """Likewise of the words of materials."""
    return _looked_up(column, lambda word: MATERIALS.get(re.sub(r"[\s-]+", "_", word.strip().lower())))


def colour_of(word: str) -> tuple[int, int, int] | None:
    """'red', 'Light Grey', '#abc', '#aabbcc', with or without what follows a semicolon; None: no colour."""
    word = re.sub(r"[\s_-]+", "", word.lower())
    try:
        red, green, blue, *_ = ImageColor.getrgb(word)
    except (ValueError, OverflowError):
        return None
    # Pillow reads rgb(300,0,0) and hsl(0,500%,50%) as they are.
    return (red, green, blue) if all(0 <= part <= 255 for part in (red, green, blue)) else None


def _looked_up(column: NDArray[Any], meaning: Any) -> tuple[NDArray[np.uint8], int]:
    """Each word is understood once, its part up to the first semicolon."""
    found = np.zeros((len(column), 4), np.uint8)
    known: dict[str, tuple[int, int, int] | None] = {}
    unknown = 0
    for row, word in enumerate(column.tolist()):
        if not isinstance(word, str) or not word.strip():
            continue
        if word not in known:
            known[word] = meaning(word.split(";")[0])
        color = known[word]
        if color is None:
            unknown += 1
        else:
            found[row] = (*color, 255)
    return found, unknown
