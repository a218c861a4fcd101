"""Measures of picture quality against values found by hand."""

from __future__ import annotations

import builtins
import math

import numpy as np
import pytest

from farfield.errors import MissingExtraError, OptionError
from farfield.quality.metrics import compare, covered, flip_map, over_sky, psnr, ssim

SKY = (158, 191, 235)


def flat(value: int, shape: tuple[int, int] = (16, 16)) -> np.ndarray:
    return np.full((*shape, 3), value, np.uint8)


def test_psnr_of_a_constant_difference() -> None:
    # An error of 10 everywhere: 10 log10(255^2 / 100).
    assert psnr(flat(100), flat(110)) == pytest.approx(28.1308, abs=1e-4)


def test_psnr_of_half_the_pixels() -> None:
    b = flat(100)
    b[:8] += 10
    assert psnr(flat(100), b) == pytest.approx(28.1308 + 10 * math.log10(2), abs=1e-4)
    mask = np.zeros((16, 16), bool)
    mask[:8] = True
    assert psnr(flat(100), b, mask) == pytest.approx(28.1308, abs=1e-4)
    assert psnr(flat(100), b, ~mask) == math.inf


def test_psnr_of_nothing_is_no_number() -> None:
    assert math.isnan(psnr(flat(1), flat(2), np.zeros((16, 16), bool)))


def test_ssim_of_flat_pictures() -> None:
    # Without variance only the luminance term is left: (2ab + C1) / (a^2 + b^2 + C1), C1 = (0.01 * 255)^2.
    c1 = (0.01 * 255) ** 2
    expected = (2 * 100 * 150 + c1) / (100**2 + 150**2 + c1)
    assert ssim(flat(100), flat(150)) == pytest.approx(expected, abs=1e-6)
    assert ssim(flat(100), flat(100)) == pytest.approx(1.0)


def test_flip_of_black_and_white() -> None:
    assert flip_map(flat(80), flat(80)).max() == 0
    worst = flip_map(flat(0), flat(255))
    # The authors' own figure for black against white is 0.9672; green against blue defines 1.
    assert worst[8, 8] == pytest.approx(0.967, abs=0.005)


def test_covered_grows_by_two_pixels_on_all_sides() -> None:
    a, b = np.zeros((2, 12, 12), np.uint8)
    a[5, 5] = 1
    b[0, 11] = 255
    mask = covered(a, b)
    expected = np.zeros((12, 12), bool)
    expected[3:8, 3:8] = True
    expected[0:3, 9:12] = True
    assert np.array_equal(mask, expected)


def test_transparent_pictures_lie_over_the_sky() -> None:
    picture = np.zeros((1, 3, 4), np.uint8)
    picture[0, :, :3] = 255
    picture[0, :, 3] = 0, 255, 128
    flat_picture = over_sky(picture, SKY)
    assert tuple(flat_picture[0, 0]) == SKY
    assert tuple(flat_picture[0, 1]) == (255, 255, 255)
    # Red: linear of 158 is 0.3419; half white, half that is 0.6723 in linear light, sRGB 214.
    assert flat_picture[0, 2, 0] == 214


def test_compare_counts_covered_pixels_only_where_it_says_so() -> None:
    a = np.zeros((20, 20, 4), np.uint8)
    b = a.copy()
    a[8:12, 8:12] = 90, 90, 90, 255
    b[8:12, 8:12] = 100, 100, 100, 255
    found = compare(a, b)
    assert found["covered"] == pytest.approx(64 / 400)
    # 16 of 64 counted pixels differ by 10, and 16 of all 400.
    assert found["psnr_covered"] == pytest.approx(28.1308 + 10 * math.log10(4), abs=1e-3)
    assert found["psnr"] == pytest.approx(28.1308 + 10 * math.log10(25), abs=1e-3)
    assert 0 < found["flip"] < found["flip_covered"]
    assert set(compare(a[..., :3], b[..., :3])) == {"psnr", "ssim", "flip"}


def test_sizes_must_agree() -> None:
    with pytest.raises(OptionError, match="16x16 and 16x8"):
        psnr(flat(0), flat(0, (8, 16)))


def test_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: object, **more: object) -> object:
        if name.startswith(("skimage", "flip_evaluator")):
            raise ImportError(name)
        return real(name, *rest, **more)

    import importlib

    monkeypatch.setattr(importlib, "import_module", lambda name, package=None: without(name))
    with pytest.raises(MissingExtraError) as caught:
        flip_map(flat(0), flat(1))
    assert caught.value.extra == "quality"
