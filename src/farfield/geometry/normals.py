"""Hemi-octahedral normals: two small integers for a unit vector that faces the canonical camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BITS = 6
"""Bits of each coordinate: 0.95 degrees mean error."""
MAXIMUM = (1 << BITS) - 1


def encode(normals: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(..., 3) unit vectors in the frame (u, v, -w), third component >= 0 -> (..., 2) uint8, 0..63."""
    n = normals / np.maximum(np.abs(normals).sum(-1, keepdims=True), 1e-20)
    square = np.stack([n[..., 0] + n[..., 1], n[..., 0] - n[..., 1]], -1)
    code = np.floor((square * 0.5 + 0.5) * MAXIMUM + 0.5)
    return np.asarray(np.clip(code, 0, MAXIMUM), dtype=np.uint8)


def decode(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(..., 2) uint8 codes -> (..., 3) float32 unit vectors in the frame (u, v, -w)."""
    square = codes.astype(np.float32) * np.float32(2.0 / MAXIMUM) - np.float32(1.0)
    x = (square[..., 0] + square[..., 1]) * np.float32(0.5)
    y = (square[..., 0] - square[..., 1]) * np.float32(0.5)
    z = np.float32(1.0) - np.abs(x) - np.abs(y)
    n = np.stack([x, y, np.maximum(z, 0)], -1)
    return np.asarray(n / np.sqrt((n * n).sum(-1, keepdims=True)), dtype=np.float32)


DECODED: NDArray[np.float32] = decode(
    np.stack(np.meshgrid(np.arange(64), np.arange(64), indexing="ij"), -1).astype(np.uint8)
).reshape(4096, 3)
"""(4096, 3) float32: the vector of code (a, b) at row a * 64 + b."""
