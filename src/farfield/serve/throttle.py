"""A slow link, for trying one out: all answers together leave at so many bytes a second."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

SLICES_A_SECOND = 20
"""How often a second a byte may leave: bodies are cut into slices of this share of a second, but at least 512 bytes."""

BURST_SECONDS = 0.05
"""How much of an idle link's past may be used up at once."""


class TokenBucket:
    """Gives out bytes at `rate` a second, first come first served."""

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._free_at = -math.inf

    def reserve(self, count: int) -> float:
        """Seconds to wait until `count` bytes may be sent; they are taken from the link at once."""
        now = self._clock()
        self._free_at = max(self._free_at, now - BURST_SECONDS) + count / self._rate
        return max(self._free_at - now, 0.0)


class Throttle:
    """Sends the answers of `app` at `rate` bytes a second over all connections together."""

    def __init__(self, app: ASGIApp, rate: float) -> None:
        self._app = app
        self._bucket = TokenBucket(rate)
        self._slice = max(512, min(int(rate / SLICES_A_SECOND), 64 * 1024))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def slow_send(message: Message) -> None:
            if message["type"] == "http.response.start":
                await self._wait(sum(len(name) + len(value) + 4 for name, value in message["headers"]))
                await send(message)
            elif message["type"] == "http.response.body":
                await self._send_in_slices(message, send)
            else:
                await send(message)

        await self._app(scope, receive, slow_send)

    async def _send_in_slices(self, message: Message, send: Send) -> None:
        body, more = message.get("body", b""), message.get("more_body", False)
        for start in range(0, len(body), self._slice):
            piece = body[start : start + self._slice]
            await self._wait(len(piece))
            last = start + self._slice >= len(body)
            await send({"type": "http.response.body", "body": piece, "more_body": more or not last})
        if not body:
            await send(message)

    async def _wait(self, count: int) -> None:
        await asyncio.sleep(self._bucket.reserve(count))
