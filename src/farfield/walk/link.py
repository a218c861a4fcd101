"""A slow connection, on the real clock: its bytes pass one after the other, and arrive late."""

from __future__ import annotations

import asyncio
import math
import time

from farfield.errors import OptionError
from farfield.serve.throttle import TokenBucket


class SlowLink:
    """What lies between a client and its server. Raises OptionError for what is no bandwidth or latency."""

    def __init__(self, bandwidth: float, latency: float = 0.0) -> None:
        """bandwidth: bytes a second, downwards. latency: seconds, each way."""
        if not (math.isfinite(bandwidth) and bandwidth > 0):
            raise OptionError("must be a number of bytes a second above 0", "--bandwidth")
        if not 0 <= latency < 10:
            raise OptionError("must be 0 to 10 seconds", "--latency")
        self.latency = latency
        self.bytes = 0
        """That have passed."""
        self._bucket = TokenBucket(bandwidth, time.monotonic)

    async def carry(self, size: int) -> None:
        """Returns when so many bytes have passed; they arrive `latency` later."""
        await asyncio.sleep(self._bucket.reserve(size))
        self.bytes += size
