"""Morton codes: places in three dimensions along one line on which neighbours stay near each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BITS = 21
"""Of a code for each axis: three times as many are the most that 64 bits hold."""

_HALVINGS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton_codes(steps: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """(n,) uint64; steps: (n, 3) uint64 below 2**BITS. Bit i of axis a becomes bit 3 i + a."""
    code = np.zeros(len(steps), dtype=np.uint64)
    for axis in range(3):
        code |= _spread(steps[:, axis]) << np.uint64(axis)
    return code


def codes_along(points: NDArray[np.float64]) -> NDArray[np.uint64]:
    """(n,) uint64 Morton codes of (n, 3) points in the smallest cube around them."""
    if not len(points):
        return np.empty(0, dtype=np.uint64)
    low, high = points.min(0), points.max(0)
    steps = (points - low) * (((1 << BITS) - 1) / max(float((high - low).max()), 1e-300))
    return morton_codes(steps.astype(np.uint64))


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    for shift, mask in _HALVINGS:
        value = (value | (value << np.uint64(shift))) & np.uint64(mask)
    return value
