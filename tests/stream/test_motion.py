"""What a viewer does is told apart, goes on, and is compared with what happens."""

from __future__ import annotations

import numpy as np
import pytest

from farfield.stream.motion import MotionPredictor, Movement, Prediction, Viewing


def viewing(time: float = 0.0, eye: tuple[float, float, float] = (0, 0, 0), **more: object) -> Viewing:
    """A viewer that looks north."""
    arrays = {name: np.array(value, float) for name, value in more.items() if name != "turning"}
    forward = arrays.pop("forward", np.array([0.0, 1.0, 0.0]))
    turning = float(more.get("turning", 0.0))  # type: ignore[arg-type]
    return Viewing(time, np.array(eye, float), forward, 60.0, (640, 480), turning=turning, **arrays)


def predicted(*seen: Viewing) -> Prediction:
    predictor = MotionPredictor()
    for one in seen:
        predictor.follow(one)
    assert predictor.prediction is not None
    return predictor.prediction


@pytest.mark.parametrize(
    ("movement", "seen"),
    [
        (Movement.STANDING, viewing()),
        (Movement.TURNING, viewing(turning=0.3)),
        (Movement.STRAIGHT, viewing(velocity=(2, 0, 0))),
        (Movement.STRAIGHT, viewing(velocity=(2, 0, 0), turning=0.3)),
    ],
)
def test_tells_movements_apart(movement: Movement, seen: Viewing) -> None:
    assert predicted(seen).movement is movement


def test_standing_lasts() -> None:
    found = predicted(viewing(0, velocity=(1, 0, 0)), viewing(3), viewing(5))
    assert found.lasted(9) == 6


def test_a_turn_goes_round() -> None:
    found = predicted(viewing(turning=np.pi / 2))
    np.testing.assert_allclose(found.forwards([0, 1, 2]), [[0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    np.testing.assert_array_equal(found.eyes([0, 1]), np.zeros((2, 3)))


def test_a_straight_line_speeds_up_for_a_second() -> None:
    found = predicted(viewing(velocity=(2, 0, 0), acceleration=(4, 0, 0)))
    # 2 t + 2 t^2 for a second, then 6 m/s.
    np.testing.assert_allclose(found.eyes([0.5, 1.0, 2.0])[:, 0], [1.5, 4.0, 10.0])
    np.testing.assert_array_equal(found.forwards([0.5, 1.0]), [[0, 1, 0]] * 2)


def test_slowing_down_does_not_turn_back() -> None:
    found = predicted(viewing(velocity=(2, 0, 0), acceleration=(-4, 0, 0)))
    np.testing.assert_allclose(found.eyes([0.5, 1.0, 5.0])[:, 0], [0.5, 0.5, 0.5])


def test_a_curve_is_its_mean_direction() -> None:
    found = predicted(viewing(0, velocity=(3, 0, 0)), viewing(0.5, velocity=(0, 3, 0)))
    np.testing.assert_allclose(found.viewing.velocity, np.array([3, 3, 0]) / np.sqrt(2))
    # What is a second and more ago is forgotten.
    found = predicted(viewing(0, velocity=(3, 0, 0)), viewing(1.5, velocity=(0, 3, 0)))
    np.testing.assert_allclose(found.viewing.velocity, [0, 3, 0])
    # Who turned round goes where it goes now.
    found = predicted(viewing(0, velocity=(3, 0, 0)), viewing(0.5, velocity=(-3, 0, 0)))
    np.testing.assert_allclose(found.viewing.velocity, [-3, 0, 0])


def test_another_direction_is_another_course() -> None:
    degrees = np.radians([0, 20, 28, 45, 60])
    seen = [viewing(3.0 * n, velocity=(3 * np.cos(a), 3 * np.sin(a), 0)) for n, a in enumerate(degrees)]
    assert [predicted(*seen[: n + 1]).since for n in range(5)] == [0.0, 0.0, 0.0, 9.0, 9.0]


def test_is_compared_with_what_happened() -> None:
    predictor = MotionPredictor()
    for n in range(11):
        predictor.follow(viewing(n / 10, (n / 5, 0, 0), velocity=(2, 0, 0)))
    assert {round(one.horizon, 6) for one in predictor.outcomes} == {0.5, 1.0}
    assert all(one.missed_by < 1e-9 and one.turned_off == 0 for one in predictor.outcomes)
    # It goes round a corner: what was said half a second before is wrong by as much.
    for n in range(1, 6):
        predictor.follow(viewing(1 + n / 10, (2, n / 5, 0), velocity=(0, 2, 0)))
    last = next(one for one in reversed(predictor.outcomes) if one.horizon < 0.9)
    assert last.missed_by == pytest.approx(np.hypot(1, 1))
    assert last.travelled == pytest.approx(1.0)


def test_late_news_is_passed_over() -> None:
    predictor = MotionPredictor()
    predictor.follow(viewing(2, velocity=(1, 0, 0)))
    assert predictor.follow(viewing(1)).movement is Movement.STRAIGHT
    assert predictor.follow(viewing(2)).movement is Movement.STRAIGHT
