"""What will be seen: cut-offs, and integrals against fine sampling by a moving viewer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from farfield.stream import outlook
from farfield.stream.motion import Movement, Prediction
from farfield.stream.outlook import LEAST_COURSE, cutoff, look
from stream.test_motion import predicted, viewing

BOXES = np.array([(-1, 9, -1, 1, 11, 1), (9, -1, -1, 11, 1, 1), (-9, -9, -1, -8, -8, 1), (-1, 29, 0, 2, 32, 3)], float)
FAR = 100.0


def sampled(prediction: Prediction, seconds: np.ndarray) -> np.ndarray:
    """(n, k) pixels visible by a viewer that has really gone on."""
    eyes, forwards = prediction.eyes(seconds), prediction.forwards(seconds)
    return outlook._seen(prediction, BOXES, eyes, forwards)[..., 0]


def test_who_stands_longer_will_stand_longer() -> None:
    short, long = predicted(viewing(0)), predicted(viewing(0), viewing(30))
    assert cutoff(short, 0.0, FAR) < cutoff(short, 5.0, FAR) < cutoff(long, 30.0, FAR)
    found = look(long, BOXES, 30.0, FAR)
    assert found.bounds.tolist() == [0.0, cutoff(long, 30.0, FAR)]
    np.testing.assert_array_equal(found.visible, sampled(long, np.zeros(1)))
    assert (found.visible[:, 0] > 0).tolist() == [True, False, False, True]


def test_a_turn_goes_on_for_two_fields_of_view() -> None:
    found = predicted(viewing(turning=0.5))
    wide = 2 * np.arctan(np.tan(np.radians(30)) * 640 / 480)
    assert cutoff(found, 0.0, FAR) == pytest.approx(2 * wide / 0.5)


def test_a_line_goes_on_for_twice_the_way_to_the_far_plane_and_as_long_as_it_has() -> None:
    prediction = predicted(viewing(velocity=(4, 0, 0)))
    assert cutoff(prediction, 0.0, FAR) == pytest.approx(LEAST_COURSE)
    assert cutoff(prediction, 10.0, FAR) == pytest.approx(10.0 + LEAST_COURSE)
    assert cutoff(prediction, 100.0, FAR) == pytest.approx(50.0)


@pytest.mark.parametrize("turning", [0.4, -0.4])
def test_a_turn_is_integrated(turning: float) -> None:
    prediction = predicted(viewing(turning=turning))
    found = look(prediction, BOXES, 0.0, FAR)
    seconds = (np.arange(4000) + 0.5) / 4000 * found.bounds[-1]
    true = sampled(prediction, seconds).reshape(len(BOXES), outlook.INTERVALS, -1)
    for n, box in enumerate(BOXES):
        shown = true[n].sum() > 0
        assert (found.visible[n].sum() > 0) == shown, box
        if shown:
            # Objects grow towards the picture's edges, which the thesis passes over: 40 % at 40 degrees.
            assert found.visible[n].sum() == pytest.approx(true[n].mean(axis=1).sum(), rel=0.5)


def test_an_object_at_the_edge_comes_in_little_by_little() -> None:
    swept = outlook._swept
    half, spread = 0.5, np.array([0.1])
    # From the middle to the plateau's end it is whole, to where it has gone it is half of it on average.
    assert swept(np.array([0.4]), spread, half) == pytest.approx(0.4)
    assert swept(np.array([0.6]), spread, half) == pytest.approx(0.4 + 0.1)
    assert swept(np.array([9.0]), spread, half) == pytest.approx(0.5)
    assert swept(np.array([-0.6]), spread, half) == pytest.approx(-0.5)
    # One twice as wide as the picture: half of it at most.
    assert swept(np.array([0.5]), np.array([1.0]), half) == pytest.approx(0.25)


def test_a_line_is_sampled() -> None:
    # It has gone this way for long.
    prediction = replace(predicted(viewing(velocity=(0, 5, 0))), since=-100.0)
    found = look(prediction, BOXES, 0.0, FAR)
    assert len(found.bounds) == outlook.INTERVALS + 1
    assert (np.diff(found.bounds) > 0).all()
    middles = (found.bounds[1:] + found.bounds[:-1]) / 2
    np.testing.assert_array_equal(found.visible, sampled(prediction, middles))
    # It comes nearer, and is passed.
    assert found.height[0, 0] < found.height[0, 1]
    assert found.visible[0, -1] == 0


def test_nothing_to_look_at() -> None:
    for seen in (viewing(), viewing(turning=1.0), viewing(velocity=(1, 0, 0))):
        assert look(predicted(seen), np.zeros((0, 6)), 0.0, FAR).visible.shape[0] == 0


def test_straight_up_and_still() -> None:
    up = replace(viewing(turning=0.1), forward=np.array([0.0, 0.0, 1.0]))
    found = look(predicted(up), np.array([(-1.0, -1.0, 5.0, 1.0, 1.0, 6.0)]), 0.0, FAR)
    assert predicted(up).movement is Movement.TURNING
    assert np.isfinite(found.visible).all()
    assert found.visible.any()


def test_in_some_cases_the_viewer_looks_elsewhere() -> None:
    for seen in (viewing(), viewing(turning=1.0), viewing(velocity=(0, 1, 0))):
        sure, unsure = (look(predicted(seen), BOXES, 0.0, FAR, share) for share in (0.0, 0.1))
        # Behind is what may be seen, too, but by less than what is ahead.
        assert not sure.visible[2].all()
        assert (unsure.visible[2] > 0).all()
        assert unsure.visible[0, 0] > 5 * unsure.visible[2, 0]
        np.testing.assert_allclose(unsure.visible[0, 0], sure.visible[0, 0], rtol=0.15)
        np.testing.assert_array_equal(unsure.whole[sure.whole > 0], sure.whole[sure.whole > 0])
