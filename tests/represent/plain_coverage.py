"""The greedy choice of views, in plain Python."""

from __future__ import annotations

import numpy as np


def greedy(nearest: np.ndarray, quality: np.ndarray, tolerance: float, behind: float, most: int) -> list[int]:
    """nearest, quality: (eyes, views, p, p), 1e30 = nothing. What is hidden counts less; best gain first."""
    nearest, quality = (np.concatenate(list(a), axis=1) for a in (nearest, quality))
    shown = np.where(nearest <= nearest.min(0) + np.float32(tolerance), quality, quality * np.float32(behind))
    chosen: list[int] = []
    best = np.zeros(nearest.shape[1:], np.float32)
    while len(chosen) < most:
        gains = np.maximum(shown - best, 0).sum((1, 2))
        if gains.max() <= 0:
            break
        chosen.append(int(np.argmax(gains)))
        best = np.maximum(best, shown[chosen[-1]])
    return chosen
