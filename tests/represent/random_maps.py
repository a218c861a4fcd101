"""BlockMaps of random numbers: blocks of few heights, holes, slopes, bodies in the air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farfield.represent.blockmap.blockmap import SIZES, BlockMap
from farfield.represent.blockmap.build import fitted_to

WIDTH, DEPTH = 48.0, 32.0
"""Metres of the cell."""


def random_map(
    seed: int, by_area: bool, sloped: bool, number: int = 0, holes: float = 0.2, hanging: float = 0.0
) -> BlockMap:
    """number: of SIZES. holes: share of texels where nothing is. hanging: share of those with a floor, which is between
    code 1 and the top; 0: the map tells of no floors."""
    random, size = np.random.default_rng(seed), SIZES[number]
    n = size.side
    coarse = random.choice(np.array([1, 1, 3, 40, 120, 255], np.uint8), (n // 2, n // 2))
    codes = coarse.repeat(2, 0).repeat(2, 1)
    codes[random.random((n, n)) < holes] = 0
    codes[n // 2, n // 2] = 200
    slopes = (random.integers(-127, 128, (n, n, 2)) * (random.random((n, n, 1)) < 0.4)).astype(np.int8)
    found = BlockMap(
        size, -1.5, 0.06, codes, slopes if sloped else None, random.integers(0, 2, (4, n)).astype(np.uint8),
        int(random.integers(1, 9)), 0, 0, by_area, random.integers(0, 256, (n, n + size.columns, 3)).astype(np.uint8),
        np.empty(0, np.uint8), random.integers(1, 1000, (n, n)).astype(np.uint32),
    )  # fmt: skip
    if hanging:
        floors = np.minimum(1 + random.integers(0, np.maximum(codes, 1)), codes)
        found = replace(found, floors=(floors * (random.random((n, n)) < hanging)).astype(np.uint8))
    found = fitted_to(found, WIDTH / n)
    return found.with_turns(random.integers(0, 64, len(found.unfolded.sides)).astype(np.uint8))
