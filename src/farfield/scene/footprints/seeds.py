"""What a building's looks are drawn from: numbers stirred by the finalizer of splitmix64 (Steele, Lea, Flood 2014)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def content_seeds(centres: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.uint32]:
    """(n,) uint32 from a building's place and height to 0.1 m: its looks do not depend on its neighbours or order."""
    with np.errstate(over="ignore"):
        mixed = _decimetres(centres[:, 0])
        for part in (_decimetres(centres[:, 1]), _decimetres(height)):
            mixed = _first(mixed) + part
        mixed = _second(mixed)
    return (mixed >> np.uint64(32)).astype(np.uint32)


def fractions(seed: NDArray[np.uint32], stream: int) -> NDArray[np.float64]:
    """(n,) in 0..1, independent for each stream."""
    mixed = seed.astype(np.uint64) + np.uint64((0x9E3779B97F4A7C15 * (stream + 1)) % (1 << 64))
    with np.errstate(over="ignore"):
        mixed = _second(_first(mixed))
    return (mixed >> np.uint64(40)).astype(np.float64) / (1 << 24)


def _first(mixed: NDArray[np.uint64]) -> NDArray[np.uint64]:
    return (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)


def _second(mixed: NDArray[np.uint64]) -> NDArray[np.uint64]:
    return (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)


def _decimetres(metres: NDArray[Any]) -> NDArray[np.uint64]:
    return np.round(metres * 10).astype(np.int64).astype(np.uint64)
