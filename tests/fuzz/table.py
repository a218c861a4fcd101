"""What a decoder is to the fuzzing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fuzz.shells import Shell


def _unused(_: Any) -> None:
    return None


@dataclass(frozen=True, slots=True)
class Decoder:
    """One decoder and what is needed to try it."""

    name: str
    decode: Callable[[bytes], Any]
    """Raises FarfieldError for damage, and nothing else."""
    corpus: tuple[bytes, ...]
    """Valid values."""
    shells: tuple[Shell, ...]
    """Ways into them, each taken equally often."""
    bound: Callable[[bytes], int]
    """Bytes of memory that decoding the input may take at most, as the decoder's docstring says."""
    use: Callable[[Any], None] = _unused
    """Does with what was read what its users do; kernels above all, which do not look where their indices lead."""
