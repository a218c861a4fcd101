"""What is known of a link that stands still for a while, and then goes on."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import pytest

from farfield.stream.link import Link

PIECE = 16_384
AHEAD = 0.5
"""Seconds of the link that are under way, as in sessions."""


@dataclass
class Way:
    """A link of so many bytes a second that stands still from one moment to another."""

    bandwidth: float
    delay: float
    stands: tuple[float, float]
    at_once: bool
    """What was under way comes at once when it goes on, as from a viewer that stood still itself."""

    def arrival(self, begin: float) -> float:
        """When a piece has come that goes out then."""
        first, last = self.stands
        begin = last if first <= begin < last else begin
        end = begin + PIECE / self.bandwidth
        return end + last - first if begin < first < end else end


def estimates(way: Way, end: float) -> list[tuple[float, float]]:
    """When something came, and what was known of the bandwidth then."""
    link, now, free_at = Link(), 0.0, 0.0
    coming: list[float] = []
    found = []
    while now < end:
        while link.under_way == 0 or link.under_way + PIECE <= link.bandwidth * AHEAD:
            link.sent(now, PIECE)
            free_at = way.arrival(max(free_at, now))
            heapq.heappush(coming, free_at + way.delay)
        now = heapq.heappop(coming)
        if way.at_once and way.stands[0] <= now < way.stands[1]:
            now = way.stands[1]
        link.acknowledged(now, PIECE)
        found.append((now, link.bandwidth))
    return found


@pytest.mark.parametrize("bandwidth", [100_000.0, 250_000.0, 4e6])
@pytest.mark.parametrize("delay", [0.02, 0.2])
@pytest.mark.parametrize("at_once", [False, True])
def test_a_link_that_stood_still_is_known_again_within_a_second(bandwidth: float, delay: float, at_once: bool) -> None:
    found = estimates(Way(bandwidth, delay, (5.0, 15.0), at_once), 20.0)
    after = [estimate for now, estimate in found if 16.0 <= now < 18.0]
    assert min(after) > 0.6 * bandwidth
    assert max(after) < 1.5 * bandwidth
    # And it is used, for two of three seconds at least.
    assert 1.5 * _between(found, 15.0, 18.0) >= _between(found, 2.0, 5.0)


def test_a_slow_link_is_slow_even_if_a_piece_takes_longer_than_is_measured_over() -> None:
    found = estimates(Way(2_000.0, 0.05, (1e9, 1e9), False), 60.0)
    assert found[-1][1] == pytest.approx(2_000.0, rel=0.1)


def _between(found: list[tuple[float, float]], begin: float, end: float) -> int:
    """Pieces that came."""
    return sum(begin <= now < end for now, _ in found)
