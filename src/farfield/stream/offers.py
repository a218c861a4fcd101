"""What could be sent next: items, what each would take, and how well it would show which objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.stream.motion import Prediction
from farfield.stream.outlook import Outlook

SHARES = (0.25, 0.5, 0.75, 0.9, 1.0)
"""What there is to see of an object is taken in parts, up to these shares of it: a cell's tiles, best first, show one
part after the other, and those of a finer cell the same ones first."""
WEIGHTS = np.diff(np.array([0.0, *SHARES])).astype(np.float32)
"""(parts,) of each part."""


def parts_of(share: float) -> int:
    """How many parts are shown whole where so much of an object is."""
    return sum(share >= end - 1e-6 for end in SHARES)


@dataclass(frozen=True, slots=True)
class Offers:
    """m items of one kind. An item may show several objects: a mesh that is placed many times, a cell's pictures."""

    sizes: NDArray[np.int64]
    """(m,) bytes."""
    firsts: NDArray[np.int64]
    """(m + 1,): uses firsts[i] to firsts[i + 1] - 1 are those of item i."""
    objects: NDArray[np.int32]
    """(u,) the object of each use."""
    accuracy: NDArray[np.float32]
    """(u, k) of each use in each interval of the outlook, 0 to 1."""
    series: NDArray[np.int64] | None = None
    """(m,) numbers: of items with the same, each larger one holds all that the smaller ones do, and what was sent of it
    needs not be sent again. None: each is for itself."""
    parts: NDArray[np.int32] | None = None
    """(m,) how many parts of each object it shows (SHARES). None: all."""

    def uses(self, item: int) -> slice:
        """Those of an item."""
        return slice(int(self.firsts[item]), int(self.firsts[item + 1]))

    def split(self, items: NDArray[np.int64], parts: NDArray[np.int32]) -> Offers:
        """So many parts of some of the items, any number of times; those of one item are a series, as large as it."""
        counts = np.diff(self.firsts)[items]
        firsts = np.concatenate([[0], np.cumsum(counts)])
        uses = np.repeat(self.firsts[:-1][items] - firsts[:-1], counts) + np.arange(firsts[-1])
        return Offers(self.sizes[items], firsts, self.objects[uses], self.accuracy[uses], items, parts)

    @staticmethod
    def none(intervals: int) -> Offers:
        """No items."""
        return Offers.single(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, intervals), np.float32))

    @staticmethod
    def single(sizes: NDArray[np.int64], objects: NDArray[np.int32], accuracy: NDArray[np.float32]) -> Offers:
        """Items that show one object each."""
        return Offers(sizes, np.arange(len(sizes) + 1), objects, accuracy)


class Objects(Protocol):
    """What there is to be seen."""

    def boxes(self, prediction: Prediction, seconds: float) -> NDArray[np.float64]:
        """(n, 6) local metres, lower and upper corners. Numbers of objects hold until the next call.

        seconds: for which the prediction is believed.
        """
        ...

    def importance(self, outlook: Outlook) -> NDArray[np.float32]:
        """(n,) factors of their benefit, after the last call (BEN 4.3). outlook: what will be seen of them."""
        ...


@dataclass(frozen=True, slots=True)
class FixedObjects:
    """Objects that stay the same."""

    places: NDArray[np.float64]
    """(n, 6) local metres, lower and upper corners."""
    factors: NDArray[np.float32] | None = None
    """(n,) see `importance`; None: all are 1."""

    def boxes(self, prediction: Prediction, seconds: float) -> NDArray[np.float64]:
        """See Objects."""
        return self.places

    def importance(self, outlook: Outlook) -> NDArray[np.float32]:
        """See Objects."""
        return np.ones(len(self.places), np.float32) if self.factors is None else self.factors


class Kind(Protocol):
    """A way to show objects, as far as choosing goes: what it takes and how accurate it is.

    Others plug in by the same answers; how much of an object can be seen is the same for all kinds.
    """

    def offers(self, outlook: Outlook) -> Offers:
        """What a viewer does not hold and could be sent; numbers of items hold until the next call."""
        ...

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        """Raises best, (n, k, parts), the accuracy of what each object is shown by, to that of what a viewer holds."""
        ...

    def take(self, item: int) -> object:
        """An item is sent: it counts as held from now on. Returns what tells the sender what to send."""
        ...


def joined(offers: Sequence[Offers]) -> Offers:
    """All of them in one list, in order."""
    ends = np.cumsum([0, *(len(one.objects) for one in offers)])
    counts = np.cumsum([0, *(len(one.sizes) for one in offers)])
    own = [np.arange(len(one.sizes)) if one.series is None else one.series for one in offers]
    parts = [np.full(len(one.sizes), len(SHARES), np.int32) if one.parts is None else one.parts for one in offers]
    return Offers(
        np.concatenate([one.sizes for one in offers]),
        np.concatenate([one.firsts[:-1] + end for one, end in zip(offers, ends, strict=False)] + [ends[-1:]]),
        np.concatenate([one.objects for one in offers]),
        np.concatenate([one.accuracy for one in offers]),
        np.concatenate([series + count for series, count in zip(own, counts, strict=False)]),
        np.concatenate(parts),
    )
