"""What a command prints on stdout: text for people, or one JSON object."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import typer


def report(facts: Mapping[str, Any], *, as_json: bool, text: str = "") -> None:
    """Print `facts` as one JSON object, or else `text` (or, without one, a line `name value` for each fact)."""
    if as_json:
        typer.echo(json.dumps(plain(facts), allow_nan=False))
    else:
        typer.echo(text or "\n".join(f"{name:<24} {value}" for name, value in facts.items()))


def plain(value: Any) -> Any:
    """`value` made of what JSON knows: NumPy numbers and arrays become Python's, NaN and infinities null."""
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Sequence | set | frozenset):
        return [plain(item) for item in value]
    raise TypeError(f"no JSON for {type(value).__name__}")


def in_bytes(count: float) -> str:
    """A number of bytes for people, in decimal units: "3.4 MB"."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} TB"


def in_time(seconds: float) -> str:
    """A duration for people: "0.4 s", "12 s", "3 min 5 s", "2 h 10 min"."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
