"""The greedy choice of tiles, in plain Python."""

from __future__ import annotations

import numpy as np

LOOSE = 128


def greedy(quality: np.ndarray, cost: np.ndarray, least: float, most: int) -> list[tuple[int, int]]:
    """(thing, what it adds), best gain per cost first; only the first may gain less than `least`.

    quality: (things, m) uint8, 0..120, with LOOSE for what fills a share of what is left.
    """
    values, loose = (quality % LOOSE).astype(int), quality >= LOOSE
    chosen: list[tuple[int, int]] = []
    best = np.zeros(quality.shape[1], int)
    while len(chosen) < most:
        added = np.where(loose, values * (120 - best) // 120, np.maximum(values - best, 0))
        gains = added.sum(1)
        gains[[thing for thing, _ in chosen]] = 0
        winner = int(np.argmax(gains / cost))
        if gains[winner] == 0 or (chosen and gains[winner] / cost[winner] < least):
            break
        chosen.append((winner, int(gains[winner])))
        best = best + added[winner]
    return chosen


def discounted(nearest: np.ndarray, quality: np.ndarray, tolerance: float, behind: float) -> np.ndarray:
    """nearest, quality: (tiles, m), 1e30 = nothing. What is hidden counts less."""
    visible = nearest <= nearest.min(0) + np.float32(tolerance)
    less = (quality % LOOSE * np.float32(behind)).astype(np.uint8) + quality // LOOSE * LOOSE
    return np.where(visible, quality, less).astype(np.uint8)
