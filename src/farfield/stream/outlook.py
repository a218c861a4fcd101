"""What a predicted viewer will see of each object, and for how long: three strategies (BEN 5.1.1 to 5.1.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.boxes import see_boxes
from farfield.stream.motion import Movement, Prediction

Floats = NDArray[np.float64]
INTERVALS = 8
"""Parts of the time that is looked ahead while turning or moving."""
LEAST_STAY = 1.0
"""Seconds that who has just come to stand is expected to stay."""
LEAST_COURSE = 5.0
"""Seconds that who has just set out is expected to go on."""
LONGEST = 120.0
"""Seconds; nothing is looked ahead farther."""
TURNS = 2.0
"""Fields of view that a turn goes on for (BEN 5.1.2)."""
REACHES = 2.0
"""Times the way to the far plane that a straight line goes on for (BEN 5.1.3)."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is expected to be seen of n objects in k intervals of time."""

    bounds: Floats
    """(k + 1,) seconds from the viewing on, ascending from 0; the last is the cut-off."""
    eyes: Floats
    """(k, 3) local metres, in the middle of each interval."""
    forwards: Floats
    """(k, 3) unit vectors. While turning: of the viewer that has the object in the middle, see `whole`."""
    visible: NDArray[np.float32]
    """(n, k) pixels of the bounding rectangle within the picture, mean of the interval."""
    whole: NDArray[np.float32]
    """(n, k) pixels of the whole rectangle; while turning of the object in the middle of the picture."""
    height: NDArray[np.float32]
    """(n, k) of the whole rectangle, pixels; the same."""
    focal: float
    """Pixels of one unit at distance one."""
    pixels: int
    """Of the whole picture."""


def cutoff(prediction: Prediction, now: float, far: float) -> float:
    """Seconds from the viewing on for which a prediction is believed. far: metres to the far plane."""
    viewing = prediction.viewing
    if prediction.movement is Movement.STANDING:
        # The longer it has stood, the longer it will: short stops send what is quick (BEN 5.1.1).
        found = LEAST_STAY + prediction.lasted(now)
    elif prediction.movement is Movement.TURNING:
        found = TURNS * _horizontal(viewing.fov, viewing.size) / abs(viewing.turning)
    else:
        # And no longer than it has gone in this direction: from a height the far plane is minutes away.
        found = min(REACHES * far / viewing.speed, LEAST_COURSE + prediction.lasted(now))
    return min(found, LONGEST)


def look(prediction: Prediction, boxes: Floats, now: float, far: float, otherwise: float = 0.0) -> Outlook:
    """What will be seen of boxes, (n, 6) local metres: lower and upper corners.

    now: seconds of the viewer's clock. far: metres to the far plane. otherwise: share of the cases in which the viewer
    does not do what is predicted, but looks elsewhere, anywhere round about. In the thesis there are none: then
    nothing is sent but what the movement will show, and a turn shows nothing at first.
    """
    seconds = cutoff(prediction, now, far)
    if prediction.movement is Movement.TURNING:
        found = _turning(prediction, boxes, seconds)
    elif prediction.movement is Movement.STANDING:
        found = _sampled(prediction, boxes, np.array([0.0, seconds]))
    else:
        # What comes first counts for sure and is cut finest: bounds grow with the square of their number.
        found = _sampled(prediction, boxes, seconds * (np.arange(INTERVALS + 1) / INTERVALS) ** 2)
    return _mixed(prediction, boxes, found, otherwise) if otherwise > 0 else found


def _mixed(prediction: Prediction, boxes: Floats, found: Outlook, otherwise: float) -> Outlook:
    """The same with a share of cases in which the viewer looks to any side from where it will be."""
    height = prediction.viewing.size[1]
    half = _horizontal(prediction.viewing.fov, prediction.viewing.size) / 2
    middles = (boxes[:, :3] + boxes[:, 3:]) / 2
    radius = np.linalg.norm(boxes[:, 3:] - boxes[:, :3], axis=1) / 2
    distance = np.linalg.norm(middles[:, None] - found.eyes[None], axis=2)
    # As a round body of its size would look in the middle of the picture.
    across = 2 * prediction.viewing.focal * radius[:, None] / np.maximum(distance, radius[:, None])
    sizes = boxes[:, 3:] - boxes[:, :3]
    share = np.hypot(sizes[:, 0], sizes[:, 1]) * sizes[:, 2] / np.maximum(4 * radius**2, 1e-12)
    pixels = np.minimum(across**2 * share[:, None], float(height) ** 2)
    elsewhere = (otherwise * half / np.pi * pixels).astype(np.float32)
    whole = np.where(found.whole > 0, found.whole, pixels).astype(np.float32)
    tall = np.where(found.height > 0, found.height, across * (sizes[:, 2] / (2 * radius))[:, None]).astype(np.float32)
    visible = (1 - otherwise) * found.visible + elsewhere
    return replace(found, visible=visible, whole=whole, height=tall)


def _sampled(prediction: Prediction, boxes: Floats, bounds: Floats) -> Outlook:
    middles = (bounds[:-1] + bounds[1:]) / 2
    eyes, forwards = prediction.eyes(middles), prediction.forwards(middles)
    seen = _seen(prediction, boxes, eyes, forwards)
    visible, whole, height = (np.ascontiguousarray(seen[..., n]) for n in range(3))
    viewing = prediction.viewing
    return Outlook(bounds, eyes, forwards, visible, whole, height, viewing.focal, math.prod(viewing.size))


def _turning(prediction: Prediction, boxes: Floats, seconds: float) -> Outlook:
    """Objects look the same across the picture; how much of them is in it is integrated exactly (BEN 5.1.2)."""
    viewing = prediction.viewing
    bounds = np.linspace(0.0, seconds, INTERVALS + 1)
    middle = (boxes[:, :3] + boxes[:, 3:]) / 2 - viewing.eye
    # Each box by a viewer of its own that has it in the middle, at the height that the viewer looks at.
    flat = np.hypot(viewing.forward[0], viewing.forward[1])
    across = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), 1e-9)
    forwards = np.column_stack([middle[:, :2] * (flat / across)[:, None], np.full(len(boxes), viewing.forward[2])])
    seen = _seen(prediction, boxes, np.broadcast_to(viewing.eye, forwards.shape), forwards, own=True)
    wide = viewing.size[0]
    angle = np.arctan2(middle[:, 1], middle[:, 0]) - np.arctan2(viewing.forward[1], viewing.forward[0])
    angle *= np.sign(viewing.turning)
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    half = _horizontal(viewing.fov, viewing.size) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.where(seen[:, 0, 2] > 0, seen[:, 0, 1] / seen[:, 0, 2], 0.0) / wide * half
    spread = np.clip(spread, 1e-9, np.pi)
    turned = abs(viewing.turning) * bounds
    share = np.zeros((len(boxes), INTERVALS))
    for round_ in (0.0, 2 * np.pi):
        passed = _swept(turned[None] - (angle + round_)[:, None], spread[:, None], half)
        share += np.diff(passed, axis=1) / np.diff(turned)
    # The part of the rectangle that the picture's height leaves; how wide it may be is in the share.
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.where(spread > half, half / spread, 1.0)
        whole = np.where(most > 0, seen[:, 0, 0] / most, 0.0)
    shape = (len(boxes), INTERVALS)
    return Outlook(
        bounds,
        np.broadcast_to(viewing.eye, (INTERVALS, 3)),
        np.broadcast_to(viewing.forward, (INTERVALS, 3)),
        (whole[:, None] * share).astype(np.float32),
        np.broadcast_to(seen[:, :1, 1], shape),
        np.broadcast_to(seen[:, :1, 2], shape),
        viewing.focal,
        math.prod(viewing.size),
    )


def _swept(turned: Floats, spread: Floats, half: float) -> Floats:
    """The integral, from where the object is in the middle, of the share of it within the picture.

    turned: radians that the viewer has turned past the object's middle. spread: half the object's angle. half: of the
    field of view. The share is whole (or half / spread) in the middle and falls linearly to zero at the edges.
    """
    plateau, end = abs(half - spread), half + spread
    most = np.minimum(1.0, half / spread)
    x = np.minimum(np.abs(turned), end)
    ramp = ((end - plateau) ** 2 - (end - np.maximum(x, plateau)) ** 2) / (4 * spread)
    return np.asarray(np.sign(turned) * (most * np.minimum(x, plateau) + ramp))


def _seen(
    prediction: Prediction, boxes: Floats, eyes: Floats, forwards: Floats, own: bool = False
) -> NDArray[np.float32]:
    """(n, k, 3) as kernels.boxes.see_boxes writes it; own: the poses are one of each box, and k is 1."""
    viewing = prediction.viewing
    seen = np.zeros((len(boxes), 1 if own else len(eyes), 3), np.float32)
    width, height = viewing.size
    places, poses, axes = (np.ascontiguousarray(part, dtype=np.float64) for part in (boxes, eyes, _axes(forwards)))
    see_boxes(places, poses, axes, int(own), viewing.focal, float(width), float(height), seen)
    return seen


def _axes(forwards: Floats) -> Floats:
    """(k, 3, 3) rows right, down, forward of (k, 3) directions, z up, as Camera.axes has them."""
    right = np.cross(forwards, [0.0, 0.0, 1.0])
    length = np.linalg.norm(right, axis=-1, keepdims=True)
    right = np.where(length < 1e-9, [1.0, 0.0, 0.0], right / np.maximum(length, 1e-9))
    return np.stack([right, np.cross(forwards, right), forwards], axis=1)


def _horizontal(fov: float, size: tuple[int, int]) -> float:
    """Radians across a picture (width, height) of a vertical field of view in degrees."""
    return float(2 * np.arctan(np.tan(np.radians(fov) / 2) * size[0] / size[1]))
