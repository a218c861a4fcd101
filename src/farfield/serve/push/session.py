"""One viewer's session: what it says is taken in, and what adds most for its time is sent (BEN 5, spec/stream.md)."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from starlette.concurrency import run_in_threadpool

from farfield.errors import MissingKeyError, ProtocolError, StoreError
from farfield.serve.push.messages import (
    PIECE,
    Ack,
    Add,
    Cancelled,
    Drop,
    FromViewer,
    Hello,
    Missing,
    Value,
    View,
    piece,
    write,
)
from farfield.store.contract import Store
from farfield.stream.motion import Viewing
from farfield.stream.pictures import Pictures, Regions, SentCell, Shape
from farfield.stream.scheduler import Scheduler
from farfield.stream.tree import CellTree

AHEAD_SECONDS = 0.5
"""Of the link that may be under way: what turns out to be more urgent waits no longer."""
LOOK_SECONDS = 0.2
"""Between two looks at all that could be sent, at least."""
LOOK_SHARE = 0.5
"""Of a core, that the looks of all sessions together may take; one takes some 3 ms."""
MOST_HELD = 200_000
"""Keys that a viewer may say it holds: some 20 MB of them."""

_log = logging.getLogger("farfield.serve")

Send = Callable[[str | bytes], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class Sendable:
    """A generation of a world, for all sessions that show it."""

    store: Store
    tree: CellTree
    generation: int

    @property
    def far(self) -> float:
        """Metres across all that there is."""
        if not len(self.tree.roots):
            return 1.0
        bounds = self.tree.bounds[self.tree.roots]
        return float(np.linalg.norm(bounds[:, 3:].max(axis=0) - bounds[:, :3].min(axis=0)))


class Pace:
    """How often sessions may look, so that many of them leave time for all else."""

    def __init__(self) -> None:
        self.sessions = 0
        """How many there are."""
        self._mean = 0.003

    @property
    def pause(self) -> float:
        """Seconds between two looks of one session."""
        return max(LOOK_SECONDS, self._mean * self.sessions / LOOK_SHARE)

    def took(self, seconds: float) -> None:
        """A look took so long."""
        self._mean += 0.1 * (seconds - self._mean)


class Session:
    """Sends to one viewer. `take` and `send` run in one event loop; times are seconds of `now`."""

    def __init__(self, world: Sendable, send: Send, now: Callable[[], float], pace: Pace) -> None:
        self._world = world
        self._pace = pace
        self._send = send
        self._now = now
        self._regions = Regions(world.tree)
        self._pictures = Pictures(self._regions)
        self._scheduler = Scheduler(self._regions, [self._pictures], world.far)
        self._view: View | None = None
        self._looked_at: View | None = None
        self._looked = -np.inf
        self._due = False
        self._changed = asyncio.Event()
        self._unacknowledged: deque[int] = deque()
        self._pieces = self._acknowledged = 0
        self._values = 0

    @property
    def bandwidth(self) -> float:
        """Bytes a second that the link is taken to bring."""
        return self._scheduler.link.bandwidth

    def take(self, message: FromViewer) -> None:
        """What the viewer says. Raises ProtocolError."""
        match message:
            case Hello():
                raise ProtocolError("a second hello")
            case View():
                self._view = message
            case Ack():
                self._take_ack(message.pieces)
            case Drop():
                self._pictures.drop(message.keys)
                self._due = True
            case Add():
                self.hold(message.keys)
                self._due = True
        self._changed.set()

    def hold(self, keys: tuple[str, ...]) -> None:
        """The viewer has these. Raises ProtocolError when it says so of too many."""
        if len(self._pictures.held) + len(keys) > MOST_HELD:
            raise ProtocolError("holds too much")
        self._pictures.hold(keys)

    async def send(self) -> None:
        """Sends until it is cancelled."""
        while True:
            self._changed.clear()
            choice = self._next()
            if choice is None:
                await self._wait()
                continue
            for number, key in enumerate(choice.keys):
                if not await self._send_value(key, choice):
                    self._pictures.drop(choice.keys[number:])
                    break

    def _next(self) -> SentCell | None:
        """What to send now; None while there is nothing, or no room for it."""
        if self._view is None or not self._has_room():
            return None
        self._look()
        choice = self._scheduler.next(self._now())
        if choice is None:
            return None
        assert isinstance(choice.item, SentCell)
        return choice.item

    def _look(self) -> None:
        """Takes in where the viewer is by now."""
        view, now = self._view, self._now()
        assert view is not None
        is_new = view is not self._looked_at
        if not (is_new or self._due) or now < self._looked + self._pace.pause:
            return
        begun = perf_counter()
        self._looked_at, self._looked, self._due = view, now, False
        self._regions.shape = Shape(view.near_radius, view.bias, view.least_gain)
        forward = np.array(view.forward, np.float64)
        length = float(np.linalg.norm(forward))
        if length < 0.5:
            raise ProtocolError("a view that looks nowhere")
        vectors = (np.array(part, np.float64) for part in (view.eye, view.velocity, view.acceleration))
        eye, velocity, acceleration = vectors
        # By the server's clock: a viewer's may jump.
        seen = Viewing(now, eye, forward / length, view.fov, view.size, velocity, view.turning, acceleration)
        self._scheduler.follow(seen, now)
        self._pace.took(perf_counter() - begun)

    def _has_room(self) -> bool:
        link = self._scheduler.link
        return link.under_way == 0 or link.under_way + PIECE <= link.bandwidth * AHEAD_SECONDS

    async def _wait(self) -> None:
        """Until the viewer says something, or it is time to look again."""
        pause = self._pace.pause if self._view is not None else None
        try:
            async with asyncio.timeout(pause):
                await self._changed.wait()
        except TimeoutError:
            # Who stands is expected to stay the longer, the longer it has stood: another look may find more.
            self._due = True

    async def _send_value(self, key: str, item: SentCell) -> bool:
        """Whether it was not given up on the way."""
        try:
            value = await run_in_threadpool(self._world.store.get, key)
        except (MissingKeyError, StoreError) as error:
            # Taken to be held, so that it is not chosen again and again.
            _log.warning("%s", error)
            await self._send(write(Missing(key)))
            return True
        self._values += 1
        await self._send(write(Value(self._values, key, len(value))))
        for offset in range(0, len(value), PIECE):
            while not self._has_room():
                self._changed.clear()
                await self._wait()
                self._look()
            if offset > 0 and not self._pictures.is_useful(item):
                await self._send(write(Cancelled(self._values)))
                return False
            part = value[offset : offset + PIECE]
            self._scheduler.link.sent(self._now(), len(part))
            self._unacknowledged.append(len(part))
            self._pieces += 1
            await self._send(piece(self._values, offset, part))
        return True

    def _take_ack(self, pieces: int) -> None:
        """Counts pieces, so that acknowledgements that come twice, or late, say nothing new."""
        if pieces > self._pieces:
            raise ProtocolError("acknowledges what was not sent")
        size = 0
        while self._acknowledged < pieces:
            size += self._unacknowledged.popleft()
            self._acknowledged += 1
        if size:
            self._scheduler.link.acknowledged(self._now(), size)
