"""Where a viewer is going: what it does now goes on for a while (BEN 5.1).

A viewer stands, turns about or moves in a straight line; who flies a curve is taken to move in the mean of the last
directions. What was predicted is compared with what happened and kept, so that a walk can tell how good it was.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
MEAN_OVER = 1.0
"""Seconds of directions that a curve is averaged over."""
ACCELERATES = 1.0
"""Seconds for which an acceleration is believed."""
STILL = 1e-3
"""A viewer moves from this share of its field of view a second on: metres beside what it looks at, or radians."""
TURNED = np.radians(30.0)
"""From this angle on another direction is another course."""
HORIZONS = (0.5, 1.0, 2.0)
"""Seconds after which predictions are compared with what happened."""
LOGGED = 1000


class Movement(StrEnum):
    """What a viewer does."""

    STANDING = "standing"
    TURNING = "turning"
    STRAIGHT = "straight"


@dataclass(frozen=True, slots=True)
class Viewing:
    """A viewer at a moment, as it says of itself."""

    time: float
    """Seconds, of any clock that goes on evenly."""
    eye: Floats
    """(3,) local metres."""
    forward: Floats
    """(3,) unit vector."""
    fov: float
    """Vertical, degrees."""
    size: tuple[int, int]
    """Width and height of the picture, pixels."""
    velocity: Floats = field(default_factory=lambda: np.zeros(3))
    """(3,) metres a second."""
    turning: float = 0.0
    """Radians a second about the vertical, counter-clockwise from above."""
    acceleration: Floats = field(default_factory=lambda: np.zeros(3))
    """(3,) metres a second squared."""

    @property
    def focal(self) -> float:
        """Pixels of one unit at distance one."""
        return float(self.size[1] / 2 / np.tan(np.radians(self.fov) / 2))

    @property
    def speed(self) -> float:
        """Metres a second."""
        return float(np.linalg.norm(self.velocity))


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a viewer is expected to do from a moment on."""

    movement: Movement
    viewing: Viewing
    since: float
    """When it began to move this way, and in about this direction, seconds of its clock."""

    def lasted(self, now: float) -> float:
        """Seconds for which it has moved this way."""
        return max(now - self.since, 0.0)

    def eyes(self, seconds: ArrayLike) -> Floats:
        """(..., 3) local metres, so many seconds after the viewing."""
        ahead = np.asarray(seconds, dtype=np.float64)[..., None]
        if self.movement is not Movement.STRAIGHT:
            return np.broadcast_to(self.viewing.eye, (*ahead.shape[:-1], 3))
        speeding = np.minimum(ahead, self._accelerates())
        by = self.viewing.velocity * ahead + self.viewing.acceleration * speeding * (ahead - speeding / 2)
        return np.asarray(self.viewing.eye + by)

    def forwards(self, seconds: ArrayLike) -> Floats:
        """(..., 3) unit vectors, so many seconds after the viewing."""
        ahead = np.asarray(seconds, dtype=np.float64)
        if self.movement is not Movement.TURNING:
            return np.broadcast_to(self.viewing.forward, (*ahead.shape, 3))
        x, y, z = self.viewing.forward
        cos, sin = np.cos(self.viewing.turning * ahead), np.sin(self.viewing.turning * ahead)
        return np.stack([cos * x - sin * y, sin * x + cos * y, np.broadcast_to(z, ahead.shape)], axis=-1)

    def _accelerates(self) -> float:
        """Seconds for which the acceleration is believed: less when it would stop the viewer before."""
        slowing = -float(self.viewing.velocity @ self.viewing.acceleration)
        if slowing <= 0:
            return ACCELERATES
        return min(ACCELERATES, self.viewing.speed**2 / slowing)


@dataclass(frozen=True, slots=True)
class Outcome:
    """A prediction, and what happened."""

    movement: Movement
    horizon: float
    """Seconds between the two."""
    missed_by: float
    """Metres between the eyes."""
    travelled: float
    """Metres that the eye went."""
    turned_off: float
    """Radians between the directions."""


class MotionPredictor:
    """Follows a viewer and predicts it. Times are those of the viewer's clock and ascend."""

    def __init__(self, scale: float = 1.0) -> None:
        """scale: metres to what is looked at, so that there is a least speed that counts as moving."""
        self.outcomes: deque[Outcome] = deque(maxlen=LOGGED)
        """What came of the last predictions."""
        self._scale = scale
        self._seen: deque[Viewing] = deque()
        self._prediction: Prediction | None = None
        self._course: Floats = np.zeros(3)
        self._made: dict[float, deque[Prediction]] = {horizon: deque() for horizon in HORIZONS}

    @property
    def prediction(self) -> Prediction | None:
        """Of what was said last; None before anything was."""
        return self._prediction

    def follow(self, viewing: Viewing) -> Prediction:
        """Takes what a viewer says of itself; what is older than what it said before is passed over."""
        before = self._prediction
        if before and viewing.time <= before.viewing.time:
            return before
        self._seen.append(viewing)
        while self._seen[0].time < viewing.time - MEAN_OVER:
            self._seen.popleft()
        movement = self._movement(viewing)
        goes = self._straightened(viewing, movement)
        if before is None or before.movement is not movement or self._is_off(goes, movement):
            self._prediction = Prediction(movement, goes, viewing.time)
            self._course = goes.velocity
        else:
            self._prediction = Prediction(movement, goes, before.since)
        self.outcomes.extend(self._happened(viewing))
        for made in self._made.values():
            made.append(self._prediction)
        return self._prediction

    def _movement(self, viewing: Viewing) -> Movement:
        if viewing.speed > STILL * self._scale:
            return Movement.STRAIGHT
        return Movement.TURNING if abs(viewing.turning) > STILL else Movement.STANDING

    def _is_off(self, goes: Viewing, movement: Movement) -> bool:
        """Whether a line goes in another direction than when it began."""
        if movement is not Movement.STRAIGHT:
            return False
        along = float(goes.velocity @ self._course)
        return along < float(np.cos(TURNED)) * goes.speed * float(np.linalg.norm(self._course))

    def _straightened(self, viewing: Viewing, movement: Movement) -> Viewing:
        """A curve's velocity in the mean direction of the last second, as fast as now."""
        if movement is not Movement.STRAIGHT:
            return viewing
        directions = [one.velocity / one.speed for one in self._seen if one.speed > STILL * self._scale]
        mean = np.mean(directions, axis=0)
        length = float(np.linalg.norm(mean))
        if length < 0.5:
            # It turned round within the second: what it does now counts.
            return viewing
        velocity = mean * (viewing.speed / length)
        return Viewing(
            viewing.time, viewing.eye, viewing.forward, viewing.fov, viewing.size, velocity, viewing.turning,
            viewing.acceleration,
        )  # fmt: skip

    def _happened(self, viewing: Viewing) -> Iterator[Outcome]:
        """What came of predictions whose horizon has passed."""
        for horizon, made in self._made.items():
            due = None
            while made and made[0].viewing.time + horizon <= viewing.time:
                due = made.popleft()
            if due is None:
                continue
            ahead = viewing.time - due.viewing.time
            missed = float(np.linalg.norm(due.eyes(ahead) - viewing.eye))
            travelled = float(np.linalg.norm(viewing.eye - due.viewing.eye))
            cosine = float(np.clip(due.forwards(ahead) @ viewing.forward, -1.0, 1.0))
            yield Outcome(due.movement, ahead, missed, travelled, float(np.arccos(cosine)))
