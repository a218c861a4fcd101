"""Distances that rays leap by, against a search over all texels."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.kernels.leaps import leaps


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10**6), st.sampled_from([1, 2, 7, 16, 64]), st.sampled_from([0.0, 0.002, 0.05, 0.5, 1.0]))
def test_as_the_nearest_of_all_that_are_higher(seed: int, n: int, share: float) -> None:
    random = np.random.default_rng(seed)
    tops = random.choice(np.float32([-np.inf, 0.0, 3.0]), (n, n))
    tops[random.random((n, n)) < share] = 9
    found = np.zeros((n, n), np.uint8)
    leaps(tops, np.float32(3), found)
    rows, columns = np.nonzero(tops > 3)
    j, i = np.mgrid[:n, :n]
    away = np.maximum(np.abs(j[..., None] - rows), np.abs(i[..., None] - columns))
    assert (found == away.min(axis=-1, initial=255)).all()
