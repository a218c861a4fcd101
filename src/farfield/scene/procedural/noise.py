"""Noise that repeats without a seam: white noise filtered in the frequency domain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def tiling_noise(size: int, exponent: float, lowest: int, seed: int) -> NDArray[np.float64]:
    """(size, size) float64 of mean 0 and deviation 1 whose amplitude falls as frequency**-exponent.

    lowest: waves longer than size / lowest pixels are left out, so that the repetition does not show.
    """
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((size, size)))
    frequency = np.hypot(np.fft.fftfreq(size, 1 / size)[:, None], np.fft.rfftfreq(size, 1 / size)[None])
    gain = np.where(frequency < lowest, 0.0, np.maximum(frequency, 1) ** -exponent)
    field = np.fft.irfft2(spectrum * gain, (size, size))
    return np.asarray((field - field.mean()) / field.std(), np.float64)
