"""Picture quality: PSNR, SSIM, FLIP, over the whole picture or over its covered pixels.

All on sRGB bytes, as pictures are looked at. Pictures with alpha are laid over the default sky, in linear light, before
anything is measured; their covered pixels are those that are not fully transparent in either, dilated by 2 pixels.
Far geometry often fills a fifth of a frame; whole-frame PSNR is then 7 dB higher than that of what matters.
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from farfield.errors import MissingExtraError, OptionError
from farfield.geometry.color import linear_from_srgb, srgb_from_linear

DILATION = 2
"""Pixels by which covered pixels are grown, so that the rims of silhouettes count."""

SSIM_WINDOW = 7
"""Pixels; both sides of a picture must be at least this."""


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> float:
    """Peak signal-to-noise ratio in dB over all channels of (h, w, 3) sRGB bytes; inf when equal.

    mask: (h, w) bool, the pixels that count; nan when there is none.
    """
    _check_sizes(a, b)
    squared = (a.astype(np.float64) - b.astype(np.float64)) ** 2
    counted = squared if mask is None else squared[mask]
    if counted.size == 0:
        return math.nan
    mean = float(counted.mean())
    return math.inf if mean == 0 else 10 * math.log10(255**2 / mean)


def ssim(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Structural similarity, -1..1 (Wang et al. 2004), mean over the channels.

    Raises MissingExtraError without scikit-image, OptionError for pictures smaller than its window.
    """
    _check_sizes(a, b)
    if min(a.shape[:2]) < SSIM_WINDOW:
        raise OptionError(f"pictures of {a.shape[1]}x{a.shape[0]} are too small for SSIM", "", "7x7 at least")
    metrics = _import("skimage.metrics")
    value = metrics.structural_similarity(a, b, channel_axis=2, data_range=255, win_size=SSIM_WINDOW)
    return float(value)


def flip_map(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w) float32, 0..1: FLIP error of each pixel at 67 pixels a degree (Andersson et al. 2020), a the reference.

    Raises MissingExtraError without flip-evaluator.
    """
    _check_sizes(a, b)
    flip = _import("flip_evaluator")
    scaled = [np.ascontiguousarray(p, dtype=np.float32) / np.float32(255) for p in (a, b)]
    error, _, _ = flip.evaluate(scaled[0], scaled[1], "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(error, dtype=np.float32).reshape(a.shape[:2])


def covered(*alphas: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(h, w) bool: pixels where any of the (h, w) alphas is above 0, or within DILATION pixels of one."""
    mask: NDArray[np.bool_] = np.logical_or.reduce([alpha > 0 for alpha in alphas])
    padded = np.pad(mask, DILATION)
    height, width = mask.shape
    span = range(2 * DILATION + 1)
    grown: NDArray[np.bool_] = np.logical_or.reduce([padded[y : y + height, x : x + width] for y in span for x in span])
    return grown


def over_sky(picture: NDArray[np.uint8], sky: tuple[int, int, int]) -> NDArray[np.uint8]:
    """(h, w, 3) or (h, w, 4) sRGB bytes, straight alpha -> (h, w, 3) over the sky (sRGB bytes), in linear light."""
    if picture.shape[2] == 3:
        return picture
    alpha = picture[..., 3:].astype(np.float64) / 255
    color = linear_from_srgb(picture[..., :3] / 255.0)
    blended = color * alpha + linear_from_srgb(np.array(sky) / 255.0) * (1 - alpha)
    return np.floor(srgb_from_linear(blended) * 255 + 0.5).astype(np.uint8)


def compare(
    a: NDArray[np.uint8], b: NDArray[np.uint8], sky: tuple[int, int, int] = (158, 191, 235)
) -> dict[str, float]:
    """All measures of two pictures, (h, w, 3) or (h, w, 4) sRGB bytes, a the reference.

    psnr (dB), ssim, flip; with alpha in either also psnr_covered, flip_covered and covered, the share of pixels that
    count. Raises OptionError when their sizes differ, MissingExtraError as above.
    """
    _check_sizes(a, b)
    flat = over_sky(a, sky), over_sky(b, sky)
    error = flip_map(*flat)
    found = {"psnr": psnr(*flat), "ssim": ssim(*flat), "flip": float(error.mean(dtype=np.float64))}
    alphas = [p[..., 3] for p in (a, b) if p.shape[2] == 4]
    if alphas:
        mask = covered(*alphas)
        found["psnr_covered"] = psnr(*flat, mask)
        found["flip_covered"] = float(error[mask].mean(dtype=np.float64)) if mask.any() else math.nan
        found["covered"] = float(mask.mean())
    return found


def _check_sizes(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> None:
    if a.shape[:2] != b.shape[:2]:
        sizes = " and ".join(f"{p.shape[1]}x{p.shape[0]}" for p in (a, b))
        raise OptionError(f"pictures of different sizes, {sizes}", "", "render both with the same --size")


def _import(name: str) -> ModuleType:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingExtraError(f"{name.partition('.')[0]} is not installed", "quality") from None
