"""What a viewer says of how it moves, and paths between their frames."""

from __future__ import annotations

import math

import numpy as np
import pytest

from farfield.errors import InputError
from farfield.view.path import CameraPath, PathFrame
from farfield.walk.observer import Observer, Pose, Poses


def pose(x: float = 0.0, heading: float = 0.0) -> Pose:
    return Pose(np.array([x, 0.0, 1.7]), np.array([math.cos(heading), math.sin(heading), 0.0]), 45.0)


def path(*frames: tuple[float, float], fps: float = 10.0) -> CameraPath:
    """Times, and metres east."""
    return CameraPath(fps, tuple(PathFrame(t, (x, 0.0, 1.7), (x + 10.0, 0.0, 1.7), 45.0) for t, x in frames))


def test_a_straight_line() -> None:
    observer = Observer()
    for n in range(20):
        observer.see(pose(0.2 * n), n / 10)
    assert observer.velocity == pytest.approx([2.0, 0.0, 0.0])
    assert observer.acceleration == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert observer.turning == 0.0


def test_it_rests_after_half_a_second() -> None:
    observer = Observer()
    for n in range(20):
        observer.see(pose(0.2 * min(n, 10)), n / 10)
        assert observer.velocity.any() == (1 <= n <= 15), n


def test_a_turn() -> None:
    observer = Observer()
    for n in range(20):
        # Across the direction from which angles begin anew.
        observer.see(pose(heading=3.0 + 0.05 * n), n / 10)
    assert observer.turning == pytest.approx(0.5)
    for n in range(20, 27):
        observer.see(pose(heading=3.0 + 0.05 * 19), n / 10)
    assert observer.turning == 0.0


def test_gaining_speed() -> None:
    observer = Observer()
    for n in range(1, 30):
        observer.see(pose(0.5 * 3.0 * (n / 10) ** 2), n / 10)
    assert observer.acceleration == pytest.approx([3.0, 0.0, 0.0], rel=0.05)


def test_a_view_as_it_is_said() -> None:
    observer = Observer()
    observer.see(pose(), 0.0)
    view = observer.view(pose(), (640, 480), None)
    assert (view.eye, view.size, view.velocity, view.near_radius) == (
        (0.0, 0.0, 1.7),
        (640, 480),
        (0.0, 0.0, 0.0),
        None,
    )


def test_poses_between_frames() -> None:
    poses = Poses(path((5.0, 0.0), (6.0, 4.0)))
    assert poses.seconds == pytest.approx(1.1)
    assert poses.at(0.25).eye == pytest.approx([1.0, 0.0, 1.7])
    assert poses.at(9.0).eye == pytest.approx([4.0, 0.0, 1.7])
    assert poses.at(0.5).forward == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize("frames", [((1.0, 0.0), (1.0, 1.0)), ((0.0, math.nan),), ((math.inf, 0.0),)])
def test_paths_that_lead_nowhere(frames: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(InputError):
        Poses(path(*frames))
