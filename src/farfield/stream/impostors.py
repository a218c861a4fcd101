"""Images of objects on boards, made on demand for where a viewer will be, as things to send (BEN 4.1, 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.stream.accuracy import impostor_accuracy
from farfield.stream.offers import Offers
from farfield.stream.outlook import Outlook

Floats = NDArray[np.float64]
ROWS = (12, 24, 48, 96, 192)
"""Heights of images, pixels."""
HEADER = 55
"""Bytes of an image beside its pixels."""
BYTES_A_SIDE = 11.0
"""Of an image for each pixel of its side, the geometric mean of both: statues as WebP of quality 20 take 165, 265, 480,
940, 1,930 bytes with 12 to 192 rows, far less than in proportion to their pixels."""
SHARP = 1.5
"""Times as high as the object will be on the screen, at most: finer ones are not offered."""


@dataclass(frozen=True, slots=True)
class SentImpostor:
    """What is to be sent: an image of an object as it is seen from a point."""

    object: int
    rows: int
    """Height of the image, pixels."""
    eye: tuple[float, float, float]
    """Local metres."""


class Impostors:
    """Images of all objects for one viewer, and which of them it holds."""

    def __init__(self, boxes: Floats) -> None:
        """boxes: (n, 6) local metres, lower and upper corners."""
        self._middles = (boxes[:, :3] + boxes[:, 3:]) / 2
        size = boxes[:, 3:] - boxes[:, :3]
        self._aspect = np.hypot(size[:, 0], size[:, 1]) / np.maximum(size[:, 2], 1e-9)
        self.held: list[SentImpostor] = []
        self._items: list[SentImpostor] = []

    def offers(self, outlook: Outlook) -> Offers:
        """An image of each height of each object that will be visible, from where it is seen best in between."""
        intervals = outlook.visible.shape[1]
        seen = np.flatnonzero(outlook.visible.any(axis=1))
        # Half way through what is seen of it, as from coming into view to leaving it (BEN 5.1.3).
        passed = np.cumsum(outlook.visible[seen] * np.diff(outlook.bounds), axis=1)
        half = np.argmax(passed >= passed[:, -1:] / 2, axis=1)
        eyes = outlook.eyes[half]
        most = np.maximum(SHARP * outlook.height[seen].max(axis=1, initial=0.0), ROWS[0])
        squareness = self._accuracy(seen, np.full(len(seen), np.inf), eyes, outlook)
        self._items = []
        objects, sizes, accuracy = [], [], []
        for rows in ROWS:
            own = np.flatnonzero(rows <= most)
            points = map(tuple, eyes[own].tolist())
            self._items += [SentImpostor(n, rows, eye) for n, eye in zip(seen[own].tolist(), points, strict=True)]
            objects.append(seen[own])
            sizes.append(estimated_bytes(rows, self._aspect[seen[own]]))
            accuracy.append(squareness[own] * impostor_accuracy(rows, outlook.height[seen[own]], np.pi / 2))
        return Offers.single(
            np.concatenate([np.zeros(0), *sizes]).astype(np.int64),
            np.concatenate([np.zeros(0), *objects]).astype(np.int32),
            np.concatenate([np.zeros((0, intervals)), *accuracy]).astype(np.float32),
        )

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """By the best image of each object."""
        if self.held:
            objects = np.array([one.object for one in self.held])
            rows, eyes = np.array([one.rows for one in self.held]), np.array([one.eye for one in self.held])
            accuracy = self._accuracy(objects, rows, eyes, outlook).astype(np.float32)
            np.maximum.at(best, objects, accuracy[..., None])

    def take(self, item: int) -> SentImpostor:
        """What to send."""
        self.held.append(self._items[item])
        return self._items[item]

    def _accuracy(self, objects: NDArray[np.int64], rows: Floats, eyes: Floats, outlook: Outlook) -> Floats:
        """(m, k) of images of so many rows, made from these eyes, in each interval."""
        made = self._middles[objects] - eyes
        now = self._middles[objects][:, None] - outlook.eyes[None]
        lengths = np.linalg.norm(made, axis=1)[:, None] * np.linalg.norm(now, axis=2)
        cosine = np.einsum("mc,mkc->mk", made, now) / np.maximum(lengths, 1e-12)
        # The board is square to the line it was made along; seen from behind it shows nothing.
        return impostor_accuracy(rows[:, None], outlook.height[objects], np.arcsin(np.clip(cosine, 0.0, 1.0)))


def estimated_bytes(rows: int, aspect: Floats) -> NDArray[np.int64]:
    """Of images so high, and `aspect` times as wide: what they take is known when they have been made only (BEN 4)."""
    return np.asarray(np.rint(HEADER + BYTES_A_SIDE * rows * np.sqrt(np.maximum(aspect, 1 / rows))), np.int64)
