"""Façades as the kernel paints them against the plain twin."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.kernels.facade import SIGN, SIGNS, Facade, paint_facade
from kernels.plain_facade import PlainFacade


def some_facade(seed: int, floors: int, bays: int, street: int) -> Facade:
    """One whose numbers and colours are anything that may be."""
    random = np.random.default_rng(seed)
    low = [0.08, 0.1, 0.7, 0.01, 0.01, 1, 0.0, 0.0, 0.0, 1, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    high = [0.3, 0.5, 0.95, 0.05, 0.05, 4, 0.8, 0.15, 0.2, 4, 0.25, 0.5, 0.5, 1.0, 0.5, 0.08, 0.5]
    numbers = random.uniform(low, high).astype(np.float32)
    numbers[[5, 9]] = np.floor(numbers[[5, 9]])
    numbers[[6, 7, 8]] *= random.random(3) < 0.7
    colors = random.uniform(0.05, 0.9, (SIGN + SIGNS, 3)).astype(np.float32)
    return Facade._make((np.uint64(random.integers(1 << 32)), floors, bays, street, *numbers, colors))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 7), st.integers(1, 9), st.integers(0, 3), st.sampled_from([16, 31, 64]))
def test_as_the_plain_twin(seed: int, floors: int, bays: int, street: int, side: int) -> None:
    facade = some_facade(seed, floors, bays, street)
    pixels = np.zeros((side, side, 4), np.uint8)
    paint_facade(facade, np.empty((side, side, 3), np.float32), np.empty(side, np.float32), pixels)
    assert (pixels[..., 3] == 255).all()
    # Linear light has 4096 steps on its way to sRGB: up to a step in the darkest bytes.
    assert np.abs(PlainFacade(facade, side).painted() - pixels[..., :3]).max() < 1.6
