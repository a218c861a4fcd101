"""The greedy choice of tiles, in plain Python."""

from __future__ import annotations

import numpy as np


def greedy(quality: np.ndarray, cost: np.ndarray, least: float, most: int) -> list[tuple[int, int]]:
    """(thing, what it adds), best gain per cost first; only the first may gain less than `least`.

    quality: (things, m) uint8.
    """
    chosen: list[tuple[int, int]] = []
    best = np.zeros(quality.shape[1], int)
    while len(chosen) < most:
        gains = np.maximum(quality - best, 0).sum(1)
        winner = int(np.argmax(gains / cost))
        if gains[winner] == 0 or (chosen and gains[winner] / cost[winner] < least):
            break
        chosen.append((winner, int(gains[winner])))
        best = np.maximum(best, quality[winner])
    return chosen


def discounted(nearest: np.ndarray, quality: np.ndarray, tolerance: float, behind: float) -> np.ndarray:
    """nearest, quality: (tiles, m), 1e30 = nothing. What is hidden counts less."""
    visible = nearest <= nearest.min(0) + np.float32(tolerance)
    return np.where(visible, quality, (quality * np.float32(behind)).astype(np.uint8))
