"""The greedy choice of tiles, in plain Python."""

from __future__ import annotations

import numpy as np

LOOSE = 128


def greedy(
    quality: np.ndarray, nearest: np.ndarray, tolerance: float, cost: np.ndarray, least: float, most: int
) -> list[tuple[int, int]]:
    """(thing, what it adds), best gain per cost first; only the first may gain less than `least`.

    quality: (things, m) uint8, 0..120, with LOOSE for what fills a share of what is left, but not of its own surface.
    nearest: (things, m) metres; what is within `tolerance` is the same surface.
    """
    values, loose = (quality % LOOSE).astype(int), quality >= LOOSE
    chosen: list[tuple[int, int]] = []
    best, shown = np.zeros(quality.shape[1], int), np.zeros(quality.shape, int)
    while len(chosen) < most:
        share = np.maximum(values - shown, 0) * (120 - best) // 120
        added = np.where(loose, share, np.maximum(values - best, 0))
        gains = added.sum(1)
        winner = int(np.argmax(gains / cost))
        if gains[winner] == 0 or (chosen and gains[winner] / cost[winner] < least):
            break
        chosen.append((winner, int(gains[winner])))
        best = best + added[winner]
        same = np.abs(nearest - nearest[winner]) <= np.float32(tolerance)
        shown = np.where(same, np.maximum(shown, values[winner]), shown)
    return chosen


def discounted(nearest: np.ndarray, quality: np.ndarray, tolerance: float, behind: float) -> np.ndarray:
    """nearest, quality: (tiles, m), 1e30 = nothing. What is hidden counts less."""
    visible = nearest <= nearest.min(0) + np.float32(tolerance)
    less = (quality % LOOSE * np.float32(behind)).astype(np.uint8) + quality // LOOSE * LOOSE
    return np.where(visible, quality, less).astype(np.uint8)
