"""Layers of every kind for property tests."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from farfield.represent.orthoview.layer import OrthoLayer


def random_layer(
    seed: int, height: int, width: int, fill: float = 0.7, spread: int = 200, objects: bool = False,
    x: int = 0, y: int = 0,
) -> OrthoLayer:  # fmt: skip
    """A layer with at least one valid pixel: depths within `spread` steps about a slope, everything else at random."""
    r = np.random.default_rng(seed)
    shape = height, width
    slope = r.integers(-20, 21, 2)
    plane = 2000 + slope[0] * np.arange(height)[:, None] + slope[1] * np.arange(width)
    depth = plane + r.integers(0, spread + 1, shape)
    valid = r.random(shape) < fill
    valid[r.integers(height), r.integers(width)] = True
    return OrthoLayer(
        x=x,
        y=y,
        depth_base=int(r.integers(-5000, 5000)),
        depth=np.where(valid, np.clip(depth, 1, 65535), 0).astype(np.uint16),
        color=r.integers(0, 256, (*shape, 3), dtype=np.uint8),
        normal=np.clip(r.normal(32, 10, (*shape, 2)), 0, 63).astype(np.uint8),
        length=r.integers(1, 9, shape, dtype=np.uint8),
        coverage=np.where(valid, r.integers(1, 17, shape), 0).astype(np.uint8),
        connected=r.integers(0, 4, shape, dtype=np.uint8) * valid,
        objects=r.integers(0, 2**32, shape, dtype=np.uint32) if objects else None,
    )


def layers(largest: int = 12) -> st.SearchStrategy[OrthoLayer]:
    """Small layers, dense and sparse, smooth and rough, anywhere on the lattice."""
    return st.builds(
        random_layer,
        seed=st.integers(0, 2**32 - 1),
        height=st.integers(1, largest),
        width=st.integers(1, largest),
        fill=st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0]),
        spread=st.sampled_from([0, 10, 100, 1000, 40000]),
        objects=st.booleans(),
        x=st.integers(-9, 9),
        y=st.integers(-9, 9),
    )
