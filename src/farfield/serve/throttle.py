"""A slow link, for trying one out: all answers together leave at so many bytes a second, and late."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from farfield.serve.clock import Clock, WallClock

SLICES_A_SECOND = 20
"""How often a second a byte may leave: bodies are cut into slices of this share of a second, but at least 512 bytes."""

BURST_SECONDS = 0.05
"""How much of an idle link's past may be used up at once."""

BUFFERED = 64
"""Messages of a session that wait for the link, like those in the buffers of a socket: 1 MB of pieces."""

UNENDING = "/events"
"""Its answer does not end, and is a few bytes an hour: it does not go through the link."""


@dataclass(frozen=True, slots=True)
class Link:
    """What lies between the server and who asks it."""

    bandwidth: float | None = None
    """Bytes a second over all answers together; None for no limit."""

    delay: float = 0.0
    """Seconds that each answer is late, by the round trip."""

    clock: Clock = field(default_factory=WallClock)
    """By which it sends."""

    @property
    def is_slow(self) -> bool:
        """Whether it is any slower than none."""
        return self.bandwidth is not None or self.delay > 0


class TokenBucket:
    """Gives out bytes at `rate` a second, first come first served."""

    def __init__(self, rate: float, clock: Callable[[], float]) -> None:
        self._rate = rate
        self._clock = clock
        self._free_at = -math.inf

    def reserve(self, count: int) -> float:
        """Seconds to wait until `count` bytes may be sent; they are taken from the link at once."""
        now = self._clock()
        self._free_at = max(self._free_at, now - BURST_SECONDS) + count / self._rate
        return max(self._free_at - now, 0.0)


class Throttle:
    """Sends the answers of `app` over `link`, all connections together."""

    def __init__(self, app: ASGIApp, link: Link) -> None:
        rate = link.bandwidth or math.inf
        self._app = app
        self._link = link
        self._bucket = TokenBucket(rate, link.clock.now)
        self._slice = max(512, int(min(rate / SLICES_A_SECOND, 64 * 1024)))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._slow_session(scope, receive, send)
            return
        if scope["type"] != "http" or scope["path"] == UNENDING:
            await self._app(scope, receive, send)
            return
        with self._link.clock.answering():
            await self._link.clock.sleep(self._link.delay)
            await self._app(scope, receive, self._slowed(send))

    async def _slow_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        """What a session sends is taken at once, as by the buffers of a socket, and leaves as fast as the link does."""
        clock, waiting = self._link.clock, asyncio.Queue[tuple[float, Message]](BUFFERED)

        async def slow_send(message: Message) -> None:
            size = len(message.get("bytes") or b"") + len(message.get("text") or "")
            await waiting.put((clock.now() + self._bucket.reserve(size) + self._link.delay, message))

        async def leave() -> None:
            while True:
                due, message = await waiting.get()
                await clock.sleep(max(due - clock.now(), 0.0))
                await send(message)
                waiting.task_done()

        tasks = [asyncio.create_task(leave())]
        try:
            await self._app(scope, receive, slow_send)
            tasks.append(asyncio.create_task(waiting.join()))
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def _slowed(self, send: Send) -> Send:
        async def slow_send(message: Message) -> None:
            if message["type"] == "http.response.start":
                await self._wait(sum(len(name) + len(value) + 4 for name, value in message["headers"]))
                await send(message)
            elif message["type"] == "http.response.body":
                await self._send_in_slices(message, send)
            else:
                await send(message)

        return slow_send

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
        await self._link.clock.sleep(self._bucket.reserve(count))
