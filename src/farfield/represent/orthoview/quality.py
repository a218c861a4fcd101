"""Quality presets: what an orthoview tile may cost."""

from __future__ import annotations

from dataclasses import dataclass

from farfield.errors import OptionError


@dataclass(frozen=True, slots=True)
class Quality:
    """How faithfully tiles keep what was drawn. Depth, coverage and flags are exact in every preset."""

    name: str
    """What `--quality` and the manifest call it."""
    webp_quality: int
    """0..100, of the lossy colour."""
    webp_method: int
    """0 (fast) .. 6 (small). Per 512 x 512: 0: 7 ms, 1: 8 ms, 2: 11 ms, 3 and 4: 23 ms. At equal PSNR 0 is 4-9 % larger
    than 2, 1 is 3 % larger, 3 is 2-4 % smaller; colour is a fifth of a tile."""
    normal_bits: int
    """5 or 6; with 5, odd codes move to the even one nearer the middle: 2.5 instead of 1 degree, 6 % less bytes."""


QUALITIES: dict[str, Quality] = {
    "compact": Quality("compact", webp_quality=75, webp_method=1, normal_bits=5),
    "normal": Quality("normal", webp_quality=85, webp_method=1, normal_bits=6),
    "high": Quality("high", webp_quality=93, webp_method=1, normal_bits=6),
}
"""Presets by name."""
DEFAULT = QUALITIES["normal"]


def quality(name: str) -> Quality:
    """The preset of that name. Raises OptionError when there is none."""
    try:
        return QUALITIES[name]
    except KeyError:
        raise OptionError("unknown quality", f"--quality {name!r}", f"presets are {', '.join(QUALITIES)}") from None
