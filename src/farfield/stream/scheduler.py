"""Which item to send to a viewer next: the one that adds most for the time it takes (BEN 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.kernels.benefit import added_benefits
from farfield.kernels.orders import best_totals, gains_beside, largest
from farfield.stream.link import OVERHEAD, Link
from farfield.stream.motion import MotionPredictor, Viewing
from farfield.stream.offers import SHARES, WEIGHTS, Kind, Objects, Offers, joined
from farfield.stream.outlook import Outlook, cutoff, look

STEADY = 0.02
"""An object that shows something is changed for a gain of more than this only: changes are seen (BEN 4.2)."""
OTHERWISE = 0.1
"""Share of the cases in which a viewer does something else than it is expected to. In a simulated walk
through the garden at 4 m/s and 100 kB/s the mean quality is 1.00 with 0.05 and 0.2, .98 with none."""
LEADERS = 3
"""Items, those that add most for their time and as many that add most, of which all orders are compared."""
BETTER = 1 + 1e-4
"""By which another order must be better than that with the best for its time first: less is rounding."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Choice:
    """What to send."""

    kind: Kind
    item: object
    """As the kind tells it."""
    size: int
    """Bytes, or how many are expected."""
    benefit: float
    """What it adds, pixel seconds."""
    seconds: float
    """What it costs: how long the link is taken by it."""


class Scheduler:
    """Chooses for one viewer."""

    def __init__(
        self,
        objects: Objects,
        kinds: Sequence[Kind],
        far: float,
        link: Link | None = None,
    ) -> None:
        """far: metres to the far plane."""
        self.link = Link() if link is None else link
        self.predictor = MotionPredictor()
        self._objects, self._kinds, self._far = objects, kinds, far
        self._outlook: Outlook | None = None
        self._offers: Offers | None = None
        self._counts: list[int] = []
        self._open = np.zeros(0, bool)
        self._sizes = np.zeros(0, np.int64)
        self._late = False
        self._held = np.zeros((0, 0, len(SHARES)), np.float32)
        self._visible = np.zeros((0, 0), np.float32)
        self._seconds = self._benefits = self._rates = np.zeros(0)

    def follow(self, viewing: Viewing, now: float) -> None:
        """The viewer is there, now, in seconds of its clock."""
        prediction = self.predictor.follow(viewing)
        boxes = self._objects.boxes(prediction, cutoff(prediction, now, self._far))
        self._outlook = outlook = look(prediction, boxes, now, self._far, OTHERWISE)
        found = [kind.offers(outlook) for kind in self._kinds]
        self._counts = [len(one.sizes) for one in found]
        self._offers = joined(found)
        self._open = np.ones(len(self._offers.sizes), bool)
        self._sizes = self._offers.sizes.copy()
        self._held = np.zeros((*outlook.visible.shape, len(SHARES)), np.float32)
        for kind in self._kinds:
            kind.shown(outlook, self._held)
        self._visible = outlook.visible * self._objects.importance(outlook)[:, None]
        self._seconds = self._sizes / self.link.bandwidth + OVERHEAD
        self._late = False
        self._benefits, self._rates = np.zeros((2, len(self._seconds)))
        self._renew(np.arange(len(self._seconds)), self._before(now))

    def next(self, now: float) -> Choice | None:
        """What to send now, in seconds of the viewer's clock; None when nothing would add anything.

        Greedy by benefit a second of the link (BEN 5). When nothing would be there in time, the link is not left idle,
        as it is in the thesis: then what would add most if it were there, for its time.
        """
        if self._offers is None or len(self._rates) == 0:
            return None
        before = self._before(now)
        best = self._leading(before)
        if self._rates[best] > 0 and not self._late:
            best = self._first(best, before)
        elif not self._late:
            self._late = True
            self._renew(np.arange(len(self._rates)), before)
            best = self._leading(before)
        return self._chosen(self._offers, best, before) if self._rates[best] > 0 else None

    def _leading(self, before: float) -> int:
        """The item that adds most for its time.

        Benefits only fall from one look to the next, by what is sent and as time passes, so those that are known are
        bounds: only the best is worked out anew, until it stays best.
        """
        best = -1
        while best != (leading := int(np.argmax(self._rates))):
            best = leading
            self._renew(np.array([best]), before)
        return best

    def _before(self, now: float) -> float:
        """Seconds from the viewing on until something of no size that is sent now would be there."""
        prediction = self.predictor.prediction
        since = 0.0 if prediction is None else now - prediction.viewing.time
        return since + self.link.latency + self.link.under_way / self.link.bandwidth

    def _renew(self, items: NDArray[np.int64], before: float) -> None:
        """Works out what items add, beside what is held by now."""
        arrivals = np.zeros(len(items)) if self._late else before + self._seconds[items]
        self._benefits[items] = np.where(self._open[items], self._added(items, arrivals), 0.0)
        self._rates[items] = self._benefits[items] / self._seconds[items]

    def _added(self, items: NDArray[np.int64], arrivals: Floats) -> Floats:
        """(l,) pixel seconds of items that would be there at `arrivals`, beside what is held."""
        offers, outlook = self._offers, self._outlook
        assert offers is not None
        assert outlook is not None
        assert offers.parts is not None
        found = np.zeros(len(items))
        added_benefits(
            items, arrivals, offers.firsts, offers.parts, offers.objects, offers.accuracy, self._held, self._visible,
            outlook.bounds, WEIGHTS, STEADY, found,
        )  # fmt: skip
        return found

    def _first(self, best: int, before: float) -> int:
        """The best for its time, or an item for which it can wait: a large one that is seen for a short time only.

        It is the first of the best order of the items that lead.
        """
        offers, outlook = self._offers, self._outlook
        assert offers is not None
        assert outlook is not None
        assert offers.parts is not None
        items = self._leaders(offers, best, before)
        count = len(items)
        gains, totals = np.zeros((count, count, len(outlook.bounds) - 1)), np.zeros(count)
        places = np.full((count, len(self._visible)), -1, np.int32)
        gains_beside(
            items, offers.firsts, offers.parts, offers.objects, offers.accuracy, self._held, self._visible, WEIGHTS,
            STEADY, places, gains,
        )  # fmt: skip
        best_totals(gains, self._seconds[items], before, outlook.bounds, np.zeros((2, 1 << count)), totals)
        first = 0
        for n in range(1, count):
            if totals[n] > totals[first] * BETTER:
                first = n
        return int(items[first])

    def _leaders(self, offers: Offers, best: int, before: float) -> NDArray[np.int64]:
        """The best for its time first, then others that lead; of a series one alone."""
        assert offers.series is not None
        found = {int(offers.series[best]): best}
        for item in (*_largest(self._rates), *_largest(self._benefits)):
            found.setdefault(int(offers.series[item]), item)
        items = np.array(list(found.values()))
        self._renew(items, before)
        return np.asarray(items[self._benefits[items] > 0])

    def _chosen(self, offers: Offers, item: int, before: float) -> Choice:
        benefit, seconds, size = float(self._benefits[item]), float(self._seconds[item]), int(self._sizes[item])
        uses = offers.uses(item)
        shown = offers.objects[uses]
        assert offers.parts is not None
        parts = slice(int(offers.parts[item]))
        self._held[shown, :, parts] = np.maximum(self._held[shown, :, parts], offers.accuracy[uses][..., None])
        self._shrink(offers, item, before)
        number, kind = item, 0
        while number >= self._counts[kind]:
            number -= self._counts[kind]
            kind += 1
        chosen = self._kinds[kind]
        return Choice(chosen, chosen.take(number), size, benefit, seconds)

    def _shrink(self, offers: Offers, item: int, before: float) -> None:
        """What is sent needs not be sent again, as a part of what is larger."""
        assert offers.series is not None
        same = np.flatnonzero(offers.series == offers.series[item])
        larger = same[self._sizes[same] > self._sizes[item]]
        self._open[same] = False
        self._open[larger] = True
        self._sizes[larger] -= self._sizes[item]
        self._seconds[larger] = self._sizes[larger] / self.link.bandwidth + OVERHEAD
        self._renew(same, before)


def _largest(values: Floats) -> list[int]:
    """Places of the largest few, the largest first."""
    found = np.zeros(min(LEADERS, len(values)), np.int64)
    largest(values, found)
    places: list[int] = found.tolist()
    return places
