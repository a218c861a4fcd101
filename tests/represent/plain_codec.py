"""Plain twins of the kernels that tiles are made with: slow, straight from spec/orthoview.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Neighbours = tuple[tuple[int, int], ...]
WEST, NORTH, NORTH_WEST, NORTH_EAST = (0, -1), (-1, 0), (-1, -1), (-1, 1)


def _at(depth: NDArray[np.uint16], y: int, x: int) -> int:
    inside = 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]
    return int(depth[y, x]) if inside else 0


def _median_edge(a: int, b: int, d: int) -> int:
    if d >= max(a, b):
        return min(a, b)
    return max(a, b) if d <= min(a, b) else a + b - d


def depth_prediction(depth: NDArray[np.uint16], y: int, x: int, previous: int) -> int:
    """What the depth at (y, x) is predicted to be."""
    a, b, d = (_at(depth, y + dy, x + dx) for dy, dx in (WEST, NORTH, NORTH_WEST))
    if a and b and d:
        return a + b - d if max(a, b, d) - min(a, b, d) <= 32 else _median_edge(a, b, d)
    if a and b:
        return (a + b) >> 1
    return a or b or previous


def depth_residuals(depth: NDArray[np.uint16]) -> list[int]:
    """Zigzag residuals in valid order."""
    residuals, previous = [], 0
    for y, x in np.argwhere(depth):
        value = int(depth[y, x])
        r = value - depth_prediction(depth, y, x, previous)
        r = (r + 2**15) % 2**16 - 2**15
        residuals.append((2 * r if r >= 0 else -2 * r - 1) % 2**16)
        previous = value
    return residuals


def normal_prediction(depth: NDArray[np.uint16], codes: NDArray[np.uint8], y: int, x: int, previous: int) -> int:
    """What one coordinate of the normal at (y, x) is predicted to be; codes (h, w)."""
    around = {n: _at(depth, y + n[0], x + n[1]) for n in (WEST, NORTH, NORTH_WEST, NORTH_EAST)}
    away = {n: abs(there - int(depth[y, x])) for n, there in around.items() if there}
    if not away:
        return previous
    counts = {n: int(codes[y + n[0], x + n[1]]) for n, steps in away.items() if steps <= 2 * min(away.values()) + 8}
    if WEST in counts and NORTH in counts:
        if NORTH_WEST in counts:
            return _median_edge(counts[WEST], counts[NORTH], counts[NORTH_WEST])
        return (counts[WEST] + counts[NORTH]) >> 1
    return next(counts[n] for n in (WEST, NORTH, NORTH_WEST, NORTH_EAST) if n in counts)


def normal_residuals(depth: NDArray[np.uint16], codes: NDArray[np.uint8]) -> list[int]:
    """Residuals of one coordinate modulo 64, in valid order; codes (h, w)."""
    residuals, previous = [], 32
    for y, x in np.argwhere(depth):
        residuals.append((int(codes[y, x]) - normal_prediction(depth, codes, y, x, previous)) % 64)
        previous = int(codes[y, x])
    return residuals


def filled(image: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Push-pull, recursively: halve, fill the half, take invalid pixels from it."""
    rows, columns = valid.shape
    if valid.all() or valid.size == 1:
        return np.where(valid[..., None], image, 0).astype(np.uint8)
    half = np.zeros(((rows + 1) // 2, (columns + 1) // 2, 3), np.uint8)
    half_valid = np.zeros(half.shape[:2], bool)
    for j, i in np.ndindex(*half_valid.shape):
        block = (slice(2 * j, 2 * j + 2), slice(2 * i, 2 * i + 2))
        below = image[block][valid[block]].astype(int)
        if len(below):
            half_valid[j, i] = True
            half[j, i] = (2 * below.sum(0) + len(below)) // (2 * len(below))
    half = filled(half, half_valid).astype(int)
    result = image.copy()
    for y, x in np.argwhere(~valid):
        fy = min(max(y // 2 + (1 if y % 2 else -1), 0), half.shape[0] - 1)
        fx = min(max(x // 2 + (1 if x % 2 else -1), 0), half.shape[1] - 1)
        near, far = half[y // 2], half[fy]
        result[y, x] = (9 * near[x // 2] + 3 * near[fx] + 3 * far[x // 2] + far[fx] + 8) // 16
    return result
