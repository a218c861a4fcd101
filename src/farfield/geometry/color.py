"""sRGB and linear light. Colours are stored sRGB, averaged and lit in linear light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def linear_from_srgb(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """sRGB in 0..1 -> linear light in 0..1 (IEC 61966-2-1)."""
    c = np.asarray(srgb, dtype=np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Linear light -> sRGB in 0..1; clipped."""
    c = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
    return np.where(c <= 0.0031308, c * 12.92, 1.055 * c ** (1 / 2.4) - 0.055)


LINEAR_OF_BYTE: NDArray[np.float32] = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
"""(256,) float32: linear light of each sRGB byte."""

BYTE_OF_LINEAR: NDArray[np.uint8] = np.floor(srgb_from_linear(np.arange(4096) / 4095.0) * 255.0 + 0.5).astype(np.uint8)
"""(4096,) uint8: sRGB byte of linear light scaled to 0..4095; at most one step off in the darkest bytes."""
