"""How good walks would be with images of objects made on demand, which no session sends yet (BEN 4.1; bench_walks.py).

Simulated, not sent: on a link of that many bytes a second one image after the other, always the one that adds most to
the measure for its bytes from where the viewer is at that moment, made from there, without looking ahead. Their sizes
are those that `stream.impostors` expects.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.stream.accuracy import impostor_accuracy
from farfield.stream.impostors import ROWS, estimated_bytes
from farfield.walk.measure import Look, Measure, Sample
from farfield.walk.observer import Pose
from farfield.walk.session import Received, Walker
from farfield.walk.walk import SAMPLES_A_SECOND, WalkedWorld, summed_up
from walk_orders import REQUEST_BYTES

Floats = NDArray[np.float64]
IDLE_SECONDS = 0.05
HEIGHTS = np.array([ROWS[0] // 2, *ROWS, 2 * ROWS[-1], 4 * ROWS[-1], 8 * ROWS[-1]])
"""Of images, pixels."""


def impostor_bound(known: WalkedWorld, walker: Walker, bandwidth: float) -> dict[str, Any]:
    """Figures as of a walk."""
    boards = _Boards(known, walker.size)
    times = (np.arange(round(walker.length * SAMPLES_A_SECOND)) / SAMPLES_A_SECOND).tolist()
    found: list[Sample] = []
    now, sent = 0.0, 0
    while len(found) < len(times):
        while len(found) < len(times) and times[len(found)] <= now:
            found.append(boards.sample(walker.poses.at(times[len(found)])))
        size = boards.send_best(walker.poses.at(now))
        sent += size
        now += size / bandwidth if size else IDLE_SECONDS
    result = summed_up(times, found, Received(bytes=sent))
    return {
        "mean_quality": round(result.mean_quality, 4),
        "quality": [round(value, 3) for value in result.quality],
        "missing_after": result.missing_after,
        "bytes": sent,
        "simulated": True,
    }


class _Boards:
    """The images that a viewer holds."""

    def __init__(self, known: WalkedWorld, size: tuple[int, int]) -> None:
        objects = known.objects.without_ground()
        self._measure = Measure(objects, [], size)
        sides = objects.boxes[:, 3:] - objects.boxes[:, :3]
        aspect = np.hypot(sides[:, 0], sides[:, 1]) / np.maximum(sides[:, 2], 1e-9)
        self._sizes = np.stack([estimated_bytes(rows, aspect) for rows in HEIGHTS.tolist()], axis=1) + REQUEST_BYTES
        self._objects, self._rows = np.zeros(0, np.int64), np.zeros(0)
        self._towards = np.zeros((0, 3))
        """(h, 3) unit vectors from each image's object to where it was made."""

    def sample(self, pose: Pose) -> Sample:
        """As of now."""
        look = self._measure.look(pose)
        if not len(look.objects):
            return Sample(math.nan, 0, 0)
        best = self._best(look)
        return Sample(float((look.visible * best).sum() / look.visible.sum()), int((best == 0).sum()), len(best))

    def send_best(self, pose: Pose) -> int:
        """Sends the image that adds most for its bytes; its bytes, 0 when none adds anything."""
        look = self._measure.look(pose)
        if not len(look.objects):
            return 0
        height, towards = _of_objects(look)
        accuracy = impostor_accuracy(HEIGHTS, height[:, None], np.pi / 2)
        added = look.visible[:, None] * np.maximum(accuracy - self._best(look)[:, None], 0.0)
        rates = added / self._sizes[look.objects]
        row, column = divmod(int(np.argmax(rates)), rates.shape[1])
        if rates[row, column] <= 0:
            return 0
        self._objects = np.append(self._objects, look.objects[row])
        self._rows = np.append(self._rows, HEIGHTS[column])
        self._towards = np.vstack([self._towards, towards[row]])
        return int(self._sizes[look.objects[row], column])

    def _best(self, look: Look) -> Floats:
        """(m,) accuracy of each object in view."""
        places = np.full(int(max(look.objects.max(), self._objects.max(initial=0))) + 1, -1)
        places[look.objects] = np.arange(len(look.objects))
        held = np.flatnonzero(places[self._objects] >= 0)
        own = places[self._objects[held]]
        height, towards = _of_objects(look)
        angle = np.arcsin(np.clip((towards[own] * self._towards[held]).sum(axis=1), 0.0, 1.0))
        found = np.zeros(len(look.objects))
        np.maximum.at(found, own, impostor_accuracy(self._rows[held], height[own], angle))
        return found


def _of_objects(look: Look) -> tuple[Floats, Floats]:
    """Height on the screen, pixels, and unit vectors to the eye of the objects in view."""
    _, first = np.unique(look.piece_object, return_index=True)
    return look.sight.height[first], look.sight.towards[first]
