"""The thesis' formulas against values worked out by hand (BEN 4.1)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.stream.accuracy import compound_accuracy, impostor_accuracy, level_accuracy, texture_accuracy


@pytest.mark.parametrize(
    ("area", "faces", "all_faces", "expected"),
    [
        # 10,000 pixels on 100 faces are 100 a face, on 2,500 they are 4: sqrt(4 / 100).
        (10_000, 100, 2_500, 0.2),
        # Full faces of less than a pixel count as one: sqrt(1 / 4).
        (400, 100, 2_500, 0.5),
        # All faces below a pixel.
        (50, 100, 2_500, 1.0),
        (10_000, 2_500, 2_500, 1.0),
    ],
)
def test_level(area: float, faces: int, all_faces: int, expected: float) -> None:
    assert level_accuracy(area, faces, all_faces) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("rows", "height", "degrees", "expected"),
    [
        (64, 64, 90, 1.0),
        # Twice as high as its image: half.
        (64, 128, 90, 0.5),
        # Anything from 60 to 120 degrees is as good as head on.
        (64, 32, 60, 1.0),
        (64, 32, 119.9, 1.0),
        # (sin 30 / sin 60)^3 = (1 / sqrt 3)^3.
        (64, 32, 30, 3**-1.5),
        (64, 128, 150, 0.5 * 3**-1.5),
        # From the edge there is nothing, from behind neither.
        (64, 32, 0, 0.0),
        (64, 32, 200, 0.0),
    ],
)
def test_impostor(rows: int, height: float, degrees: float, expected: float) -> None:
    assert impostor_accuracy(rows, height, np.radians(degrees)) == pytest.approx(expected)


def test_texture_and_compound() -> None:
    # 1,024 texels for 4,096 pixels: half along a side.
    assert texture_accuracy(1_024, 4_096) == pytest.approx(0.5)
    assert texture_accuracy(4_096, 1_024) == 1.0
    assert compound_accuracy(level_accuracy(400, 100, 2_500), texture_accuracy(1_024, 4_096)) == pytest.approx(0.25)


@given(
    st.floats(0, 1e7), st.integers(1, 10**6), st.integers(1, 10**6), st.integers(1, 4096), st.floats(0, np.pi)
)  # fmt: skip
def test_all_lie_between_nothing_and_everything(area: float, few: int, more: int, rows: int, angle: float) -> None:
    faces, all_faces = sorted((few, more))
    for found in (level_accuracy(area, faces, all_faces), impostor_accuracy(rows, area, angle)):
        assert 0 <= found <= 1
    assert level_accuracy(area, faces, all_faces) <= level_accuracy(area, all_faces, all_faces) == 1
