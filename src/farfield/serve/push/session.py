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

from farfield.errors import CorruptTileError, ProtocolError, StoreError
from farfield.serve.push.messages import (
    PIECE,
    Ack,
    Add,
    Cancelled,
    Drop,
    FromViewer,
    Hello,
    Idle,
    Missing,
    Value,
    View,
    piece,
    write,
)
from farfield.serve.push.pace import FAIR_HELD, MOST_HELD_BY_ALL, BoundedRegions, Pace
from farfield.store.contract import Store
from farfield.stream.motion import Viewing
from farfield.stream.pictures import Pictures, SentCell
from farfield.stream.regions import Shape
from farfield.stream.scheduler import Scheduler
from farfield.stream.tree import CellTree
from farfield.view.impostors import ImpostorMaker
from farfield.world.keys import DYNAMIC, DynamicImpostor

AHEAD_SECONDS = 0.5
"""Of the link that may be under way beside what a round trip holds: what turns out to be more urgent waits no longer.

Without the round trip a far viewer never fills the link, and each measurement of it gives less than the one before: at
250 kB/s and 700 ms Tokyo was complete after 79 s instead of 31 s.
"""
OWN_SHARE = 0.25
"""Of a core, that the looks of one session may take: with a tenth, who turns in a garden of 257 statues waits half a
second until that is taken in."""
STANDING_SHARE = 0.5
"""Of the time that a viewer has stood: after so long it is looked at again."""
MOST_MADE = 10_000
"""Images made on demand that it may say it holds: each is looked up by its name in every look."""
MOST_HELD = 200_000
"""Keys that a viewer may say it holds: some 27 MB of them."""
BLOCK = 16 * PIECE
"""Bytes of a value that are in memory at once."""
MOST_BYTES = 1 << 32
"""Of a value: places of pieces have 32 bits."""

_log = logging.getLogger("farfield.serve")

Send = Callable[[str | bytes], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class Sendable:
    """A generation of a world, for all sessions that show it."""

    store: Store
    tree: CellTree
    impostors: ImpostorMaker
    """Of values that the store does not have."""
    generation: int

    @property
    def far(self) -> float:
        """Metres across all that there is."""
        if not len(self.tree.roots):
            return 1.0
        bounds = self.tree.bounds[self.tree.roots]
        return float(np.linalg.norm(bounds[:, 3:].max(axis=0) - bounds[:, :3].min(axis=0)))


class Session:
    """Sends to one viewer. `take` and `send` run in one event loop; times are seconds of `now`."""

    def __init__(self, world: Sendable, send: Send, now: Callable[[], float], pace: Pace) -> None:
        self._world = world
        self._pace = pace
        self._send = send
        self._now = now
        self._regions = BoundedRegions(world.tree)
        self._pictures = Pictures(self._regions)
        self._scheduler = Scheduler(self._regions, [self._pictures], world.far)
        self._view: View | None = None
        self._looked_at: View | None = None
        self._viewed = self._looked = -np.inf
        self._look_seconds = 0.0
        self._due = False
        self._changed = asyncio.Event()
        self._unacknowledged: deque[tuple[float, int]] = deque()
        self._round_trip = np.inf
        self._pieces = self._acknowledged = 0
        self._values = 0
        self._is_idle = False
        self._has_made_all = True
        """No image that was to be made on demand could not."""

    @property
    def bandwidth(self) -> float:
        """Bytes a second that the link is taken to bring."""
        return self._scheduler.link.bandwidth

    @property
    def held(self) -> int:
        """How many keys the viewer holds."""
        return len(self._pictures.held)

    def take(self, message: FromViewer) -> None:
        """What the viewer says. Raises ProtocolError."""
        match message:
            case Hello():
                raise ProtocolError("a second hello")
            case View():
                self._view, self._viewed = message, self._now()
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
        own = self.held + len(keys)
        made = sum(key.startswith(DYNAMIC) for key in keys)
        if made:
            made += sum(key.startswith(DYNAMIC) for key in self._pictures.held)
        if own > MOST_HELD or made > MOST_MADE or (own > FAIR_HELD and self._pace.held + len(keys) > MOST_HELD_BY_ALL):
            raise ProtocolError("holds too much")
        self._pictures.hold(keys)

    async def send(self) -> None:
        """Sends until it is cancelled."""
        while True:
            self._changed.clear()
            if not self._has_room() or self._view is None:
                await self._wait()
                continue
            choice = self._next()
            if choice is None:
                await self._rest()
                continue
            self._is_idle = False
            await self._send_item(choice)

    async def _send_item(self, item: SentCell) -> None:
        """Value by value, until something else may be better by now: then what is left is chosen again, or is not."""
        begun = self._now()
        for number, key in enumerate(item.keys):
            has_moved = self._view is not self._looked_at or self._looked > begun
            if has_moved and number > 0 and self._now() >= begun + self._pause:
                self._leave(item.keys[number:])
                return
            if not await self._send_value(key, item):
                self._leave(item.keys[number:])
                return

    def _leave(self, keys: tuple[str, ...]) -> None:
        self._pictures.drop(keys)
        self._due = True

    async def _rest(self) -> None:
        """Says once that there is nothing to send, and waits."""
        if not self._is_idle and self._view is self._looked_at:
            self._is_idle = True
            await self._send(write(Idle()))
        await self._wait()

    def _next(self) -> SentCell | None:
        """What to send now; None: nothing would add anything."""
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
        if not (is_new or self._due) or now < self._looked + self._pause:
            return
        begun = perf_counter()
        self._looked_at, self._looked, self._due = view, now, False
        may_make = view.dynamic_impostors and self._may_make
        self._regions.shape = Shape(view.near_radius, view.bias, view.least_gain, view.far_geometry, may_make)
        forward = np.array(view.forward, np.float64)
        length = float(np.linalg.norm(forward))
        if length < 0.5:
            raise ProtocolError("a view that looks nowhere")
        vectors = (np.array(part, np.float64) for part in (view.eye, view.velocity, view.acceleration))
        eye, velocity, acceleration = vectors
        # By the server's clock: a viewer's may jump.
        seen = Viewing(now, eye, forward / length, view.fov, view.size, velocity, view.turning, acceleration)
        self._scheduler.follow(seen, now)
        self._look_seconds = perf_counter() - begun
        self._pace.took(self._look_seconds)

    @property
    def _may_make(self) -> bool:
        """Whether images may be made on demand now."""
        return self._has_made_all and not self._world.impostors.is_busy

    @property
    def _pause(self) -> float:
        """Seconds between two looks."""
        return max(self._pace.pause, self._look_seconds / OWN_SHARE)

    def _has_room(self, size: int = 0) -> bool:
        """For so many bytes: that of whole pieces would keep a far viewer to one small value a round trip."""
        link = self._scheduler.link
        seconds = AHEAD_SECONDS + (self._round_trip if np.isfinite(self._round_trip) else 0.0)
        return link.under_way == 0 or link.under_way + size <= link.bandwidth * seconds

    async def _wait(self) -> None:
        """Until the viewer says something, or it is time to look again."""
        try:
            async with asyncio.timeout(self._patience()):
                await self._changed.wait()
        except TimeoutError:
            # Who stands is expected to stay the longer, the longer it has stood: another look may find more.
            self._due = True

    def _patience(self) -> float | None:
        """Seconds until it is time to look again, at most."""
        if self._view is None:
            return None
        is_waited_for = self._due or self._view is not self._looked_at
        return self._pause if is_waited_for else max(self._pause, STANDING_SHARE * (self._now() - self._viewed))

    async def _send_value(self, key: str, item: SentCell) -> bool:
        """Whether it was not given up on the way."""
        if key.startswith(DYNAMIC) and not self._may_make:
            return False
        begun = False
        try:
            block = await self._read(key, 0)
            size = len(block) if len(block) < BLOCK else await run_in_threadpool(self._world.store.size, key)
            if size >= MOST_BYTES:
                raise StoreError("a value of more than 4 GiB", key)
            self._values, begun = self._values + 1, True
            await self._send(write(Value(self._values, key, size)))
            for offset in range(0, size, PIECE):
                if offset > 0 and offset % BLOCK == 0:
                    block = await self._read(key, offset)
                if not await self._send_piece(offset, block[offset % BLOCK :][:PIECE], item):
                    await self._send(write(Cancelled(self._values)))
                    return False
        except (StoreError, CorruptTileError) as error:
            # Taken to be held, so that it is not chosen again and again.
            _log.warning("%s", error)
            if begun:
                await self._send(write(Cancelled(self._values)))
            await self._send(write(Missing(key)))
            if key.startswith(DYNAMIC):
                # Its mesh would be damaged from other sides, too; and what was never there is not taken to be seen.
                self._has_made_all = False
                self._leave((key,))
        return True

    async def _read(self, key: str, offset: int) -> bytes:
        """So much of a value as is in memory at once."""
        if dynamic := DynamicImpostor.of(key):
            return (await asyncio.wrap_future(self._world.impostors.begin(dynamic)))[offset:][:BLOCK]
        return await run_in_threadpool(self._world.store.get_range, key, offset, BLOCK)

    async def _send_piece(self, offset: int, part: bytes, item: SentCell) -> bool:
        """As soon as there is room; whether it was still of use then."""
        while not self._has_room(len(part)):
            self._changed.clear()
            await self._wait()
        self._look()
        if offset > 0 and not self._pictures.is_useful(item):
            return False
        now = self._now()
        self._scheduler.link.sent(now, len(part))
        self._unacknowledged.append((now, len(part)))
        self._pieces += 1
        await self._send(piece(self._values, offset, part))
        return True

    def _take_ack(self, pieces: int) -> None:
        """Counts pieces, so that acknowledgements that come twice, or late, say nothing new."""
        if pieces > self._pieces:
            raise ProtocolError("acknowledges what was not sent")
        now, size = self._now(), 0
        while self._acknowledged < pieces:
            sent, part = self._unacknowledged.popleft()
            size += part
            self._acknowledged += 1
            # The shortest: the others have waited behind what was under way.
            self._round_trip = min(self._round_trip, now - sent)
        if size:
            self._scheduler.link.acknowledged(now, size)
