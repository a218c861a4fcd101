"""How fast a link is: what was acknowledged within the last seconds (BEN 4)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

WINDOW = 2.0
"""Seconds over which bandwidth is measured."""
FIRST_GUESS = 20_000.0
"""Bytes a second, until something has been acknowledged."""
LEAST = 100.0
AT_ONCE = 0.05
"""Seconds that are too short to measure over."""
OVERHEAD = 0.002
"""Seconds that an item takes besides its bytes: to choose, to decode and to draw it."""


@dataclass(slots=True)
class Link:
    """What is known of the way to a viewer. Times are the server's, seconds."""

    bandwidth: float = FIRST_GUESS
    """Bytes a second."""
    latency: float = 0.1
    """Seconds from sending to holding, bytes apart."""
    under_way: int = 0
    """Bytes sent and not acknowledged."""
    _acknowledged: deque[tuple[float, int]] = field(default_factory=deque)
    _busy_since: float | None = None
    _settled_at: float = 0.0
    """Until when what comes waited together."""

    def sent(self, now: float, size: int) -> None:
        """So many bytes go out."""
        if self.under_way == 0:
            self._busy_since = self._settled_at = now
            self._acknowledged.clear()
        self.under_way += size

    def acknowledged(self, now: float, size: int) -> None:
        """So many bytes have come in. What is acknowledged twice, or was never sent, does not count."""
        size = min(size, self.under_way)
        if size <= 0 or self._busy_since is None:
            return
        self.under_way -= size
        if now < self._settled_at:
            return
        self._acknowledged.append((now, size))
        while self._acknowledged[0][0] < now - WINDOW:
            self._busy_since = self._acknowledged.popleft()[0]
        # Only while something was under way: an idle link says nothing of how fast it is.
        busy = now - self._busy_since
        seconds = max(busy - self.latency, busy - WINDOW, AT_ONCE)
        self.bandwidth = max(sum(part for _, part in self._acknowledged) / seconds, LEAST)
        if len(self._acknowledged) == 1 and busy > WINDOW:
            # Nothing came for so long: what comes next tells whether the link is slow or was away, but not what comes
            # in the same moment. That counted, viewers of a busy server would get the more the more they had got.
            self._acknowledged.clear()
            self._busy_since, self._settled_at = now - self.latency, now + AT_ONCE

    def seconds(self, size: float) -> float:
        """Cost of an item: how long the link is taken by it."""
        return size / self.bandwidth + OVERHEAD
