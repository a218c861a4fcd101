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
    """0 (fast) .. 6 (small), effort of the colour's encoder."""
    normal_bits: int
    """Bits that vary of each normal coordinate, 5 or 6; codes stay 0..63."""


QUALITIES: dict[str, Quality] = {
    "compact": Quality("compact", webp_quality=75, webp_method=2, normal_bits=5),
    "normal": Quality("normal", webp_quality=85, webp_method=2, normal_bits=6),
    "high": Quality("high", webp_quality=93, webp_method=2, normal_bits=6),
}
"""Presets by name."""
DEFAULT = QUALITIES["normal"]


def quality(name: str) -> Quality:
    """The preset of that name. Raises OptionError when there is none."""
    try:
        return QUALITIES[name]
    except KeyError:
        raise OptionError("unknown quality", f"--quality {name!r}", f"presets are {', '.join(QUALITIES)}") from None
