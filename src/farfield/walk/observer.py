"""What a viewer that goes along a path says of itself: the twin of the page's observer (core/stream/observer.ts)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.serve.push.messages import View
from farfield.view.path import CameraPath

Floats = NDArray[np.float64]
SMOOTHING = 0.25
"""Seconds over which velocity, acceleration and turning are smoothed."""
REST = 0.5
"""Seconds without a move, or a turn, after which the viewer rests."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A viewer at a moment."""

    eye: Floats
    """(3,) local metres."""
    forward: Floats
    """(3,) unit vector."""
    fov: float
    """Vertical, degrees."""


class Poses:
    """A recorded path between its frames: eye, target and field of view go evenly from each to the next."""

    def __init__(self, path: CameraPath) -> None:
        """Raises InputError when its times do not ascend, or a frame looks nowhere."""
        self._times = np.array([frame.t for frame in path.frames])
        self._rows = np.array([(*frame.eye, *frame.target, frame.fov) for frame in path.frames])
        if not (np.isfinite(self._times).all() and (np.diff(self._times) > 0).all()):
            raise InputError("the times of a path's frames must ascend", "path")
        if not (np.isfinite(self._rows).all() and (self._rows[:, :3] != self._rows[:, 3:6]).any(axis=1).all()):
            raise InputError("each frame of a path needs an eye and another point as target", "path")
        if not ((self._rows[:, 6] > 0) & (self._rows[:, 6] < 180)).all():
            raise InputError("fields of view must lie between 0 and 180 degrees", "path")
        self.seconds = float(self._times[-1] - self._times[0]) + 1 / max(path.fps, 1e-3)
        """From the first frame to the end of the last."""

    def at(self, seconds: float) -> Pose:
        """So many seconds after the first frame."""
        row = np.array([np.interp(self._times[0] + seconds, self._times, column) for column in self._rows.T])
        forward = row[3:6] - row[:3]
        return Pose(row[:3], forward / np.linalg.norm(forward), float(row[6]))


class Observer:
    """Tells from one picture to the next how a viewer moves and turns."""

    def __init__(self) -> None:
        self.velocity, self.acceleration = np.zeros(3), np.zeros(3)
        self.turning = 0.0
        self._eye: Floats | None = None
        self._moved = self._turned = self._last = -math.inf
        self._heading = 0.0
        self._smooth = np.zeros(3)

    def see(self, pose: Pose, at: float) -> None:
        """The picture that is seen at a time in seconds."""
        before = self.velocity
        self.velocity = self._followed(pose.eye, at)
        self._accelerate(before, at - self._last)
        self._turn(math.atan2(pose.forward[1], pose.forward[0]), at)
        self._last = at

    def view(self, pose: Pose, size: tuple[int, int], near_radius: float | None, dynamic: bool = True) -> View:
        """As it is said to the server."""
        eye, forward, velocity, acceleration = (
            tuple(vector.tolist()) for vector in (pose.eye, pose.forward, self.velocity, self.acceleration)
        )
        return View(
            eye, forward, pose.fov, size, velocity, self.turning, acceleration, near_radius, far_geometry=True,
            dynamic_impostors=dynamic,
        )  # fmt: skip

    def _followed(self, eye: Floats, at: float) -> Floats:
        """Metres a second."""
        if self._eye is None or (eye != self._eye).any():
            seconds = at - self._moved
            if self._eye is not None and 0 < seconds <= REST:
                # From rest the first step counts as a whole: else it would be taken for slower than it is.
                share = 1 - math.exp(-seconds / SMOOTHING) if self._smooth.any() else 1.0
                self._smooth = self._smooth + share * ((eye - self._eye) / seconds - self._smooth)
            else:
                self._smooth = np.zeros(3)
            self._eye, self._moved = eye, at
        return self._smooth if at - self._moved <= REST else np.zeros(3)

    def _accelerate(self, before: Floats, seconds: float) -> None:
        # From rest and to rest the eye jumps to its speed: that goes on for no longer than a picture.
        if not 0 < seconds <= REST or not self.velocity.any() or not before.any():
            self.acceleration = np.zeros(3)
            return
        share = 1 - math.exp(-seconds / SMOOTHING)
        self.acceleration = self.acceleration + share * ((self.velocity - before) / seconds - self.acceleration)

    def _turn(self, heading: float, at: float) -> None:
        if self._turned == -math.inf:
            self._heading, self._turned = heading, at
            return
        by = math.remainder(heading - self._heading, 2 * math.pi)
        seconds = at - self._turned
        if by == 0:
            self.turning = 0.0 if seconds > REST else self.turning
            return
        self._heading, self._turned = heading, at
        if not 0 < seconds <= REST:
            self.turning = 0.0
            return
        share = 1 - math.exp(-seconds / SMOOTHING) if self.turning else 1.0
        self.turning += share * (by / seconds - self.turning)
