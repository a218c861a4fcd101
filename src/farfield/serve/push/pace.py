"""What sessions may take together, so that many of them, or hostile ones, leave room for all else."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from farfield.stream.motion import Prediction
from farfield.stream.regions import Regions

if TYPE_CHECKING:
    from farfield.serve.push.session import Session

LOOK_SECONDS = 0.2
"""Between two looks at all that could be sent, at least."""
LOOK_SHARE = 0.5
"""Of a core, that the looks of all sessions together may take; one takes some 2 ms."""
MOST_CELLS = 4_000
"""That a look may have to do with, some 100 ms; where a viewer asks for more they are coarser."""
MOST_HALVINGS = 40
"""From the farthest that a viewer may see to a metre."""
MOST_HELD_BY_ALL, FAIR_HELD = 2_000_000, 10_000
"""Keys of all viewers, some 270 MB, from which on none may hold more than a fair share."""


class Pace:
    """How often sessions may look and how much they may hold, so that many of them leave room for all else."""

    def __init__(self) -> None:
        self.sessions: set[Session] = set()
        """All there are."""
        self._mean = 0.003

    @property
    def pause(self) -> float:
        """Seconds between two looks of one session."""
        return max(LOOK_SECONDS, self._mean * len(self.sessions) / LOOK_SHARE)

    @property
    def held(self) -> int:
        """Keys that all viewers hold."""
        return sum(session.held for session in self.sessions)

    def took(self, seconds: float) -> None:
        """A look took so long, by the wall: with less of the processor there are fewer looks."""
        self._mean += 0.1 * (seconds - self._mean)


class BoundedRegions(Regions):
    """No more cells than a look can have to do with, whatever a viewer says of itself."""

    def boxes(self, prediction: Prediction, seconds: float) -> NDArray[np.float64]:
        """See Objects. What would be too much is made out for half the distance."""
        asked = self.shape
        found = super().boxes(prediction, seconds)
        while len(found) > MOST_CELLS and self.shape.bias < asked.bias + MOST_HALVINGS:
            near = min(self.near, self.radius / 2**self.shape.bias) / 2
            self.shape = replace(self.shape, near=near, bias=self.shape.bias + 1)
            found = super().boxes(prediction, seconds)
        self.shape = asked
        return found
