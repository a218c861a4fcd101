"""What a building's looks are drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def content_seeds(centres: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.uint32]:
    """(n,) uint32 from a building's place and height to 0.1 m: its looks do not depend on its neighbours or order."""
    with np.errstate(over="ignore"):
        mixed = _decimetres(centres[:, 0])
        for part in (_decimetres(centres[:, 1]), _decimetres(height)):
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9) + part
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (mixed >> np.uint64(32)).astype(np.uint32)


def _decimetres(metres: NDArray[Any]) -> NDArray[np.uint64]:
    return np.round(metres * 10).astype(np.int64).astype(np.uint64)
