"""The time by which a slow link sends: the wall's, or one that somebody else moves on."""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol

PATIENCE_SECONDS = 5.0
"""How long a step of SteppedClock waits, by the wall, for an answer that neither sleeps nor ends: its reader stalls."""


class Clock(Protocol):
    """What a link needs to know of time."""

    def now(self) -> float:
        """Seconds since some moment."""
        ...

    async def sleep(self, seconds: float) -> None:
        """Returns that much later."""
        ...

    def answering(self) -> AbstractContextManager[None]:
        """Held while one request is being answered."""
        ...


class WallClock:
    """Time as it passes."""

    def now(self) -> float:
        """See Clock."""
        return time.monotonic()

    async def sleep(self, seconds: float) -> None:
        """See Clock."""
        await asyncio.sleep(seconds)

    def answering(self) -> AbstractContextManager[None]:
        """See Clock."""
        return nullcontext()


class SteppedClock:
    """Time that stands still but for `advance`: a link for clients that cannot keep up with the wall.

    Reading a value takes no time by it: a step goes on only when every request under way waits for the link.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._count = 0
        self._answering = 0
        self._loop: asyncio.AbstractEventLoop | None = None

    def now(self) -> float:
        """See Clock."""
        return self._now

    async def sleep(self, seconds: float) -> None:
        """See Clock."""
        if seconds <= 0:
            return
        self._count += 1
        future = asyncio.get_running_loop().create_future()
        sleeper = (self._now + seconds, self._count, future)
        heapq.heappush(self._sleepers, sleeper)
        try:
            await future
        finally:
            if sleeper in self._sleepers:
                # Given up by its reader.
                self._sleepers.remove(sleeper)
                heapq.heapify(self._sleepers)

    @contextmanager
    def answering(self) -> Iterator[None]:
        """See Clock."""
        self._loop = asyncio.get_running_loop()
        self._answering += 1
        try:
            yield
        finally:
            self._answering -= 1

    @property
    def under_way(self) -> int:
        """Requests being answered."""
        return self._answering

    def advance(self, seconds: float) -> None:
        """Moves time on from another thread; returns when everything has been sent that leaves in this time."""
        if self._loop is None:
            self._now += seconds
            return
        asyncio.run_coroutine_threadsafe(self._advance(seconds), self._loop).result()

    async def _advance(self, seconds: float) -> None:
        end = self._now + seconds
        await self._quiet()
        while self._sleepers and self._sleepers[0][0] <= end:
            self._now, _, future = heapq.heappop(self._sleepers)
            if not future.done():
                future.set_result(None)
            await self._quiet()
        self._now = end

    async def _quiet(self) -> None:
        given_up = time.monotonic() + PATIENCE_SECONDS
        # Once round the loop: what has just been woken is to leave the list of the answering, or to sleep again.
        await asyncio.sleep(0)
        while self._answering > len(self._sleepers) and time.monotonic() < given_up:
            await asyncio.sleep(0.0005)
