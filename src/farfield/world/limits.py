"""What the numbers and names in the JSON of a world may be (spec/world.md, Limits).

They are checked when a value is read, so that nothing behind a reader meets a number that overflows, a name that
leads elsewhere, or a list that never ends.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

DAMAGE = (ValueError, RecursionError)
"""What `msgspec.json.decode` raises for bytes that are not what they should be: its own errors are ValueErrors, and so
is that of text that is no UTF-8; nesting beyond the interpreter's limit is a RecursionError."""

Hash = Annotated[str, Meta(pattern=r"^[0-9a-f]{16}\Z")]
"""16 hexadecimal digits: part of a key, so nothing else will do."""
HashOrNone = Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?\Z")]
"""The same, or empty."""
Metres = Annotated[float, Meta(ge=-1e12, le=1e12)]
Vector = tuple[Metres, Metres, Metres]
Bounds = tuple[Vector, Vector]
"""Lower and upper corner."""
Count = Annotated[int, Meta(ge=0, le=1 << 53)]
"""Up to what a double holds exactly: the viewer has no other numbers."""
DirectionNumber = Annotated[int, Meta(ge=0, le=255)]
PickNumber = Annotated[int, Meta(ge=0, le=511)]
"""Place of a tile in its cell's list, or code of a gain."""
LayerNumber = Annotated[int, Meta(ge=0, le=1)]


def is_box(box: Bounds) -> bool:
    """Whether no lower bound is above its upper one."""
    return all(lower <= upper for lower, upper in zip(*box, strict=True))
