"""Sessions over WebSocket: who may begin one, what it may say, and how it ends (spec/stream.md)."""

from __future__ import annotations

import asyncio
import hmac
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect

from farfield.errors import FarfieldError, ProtocolError
from farfield.serve.protocol import CLOSE_SECONDS
from farfield.serve.public import MANIFEST, tag_of
from farfield.serve.push.messages import Hello, Welcome, read, write
from farfield.serve.served import Served
from farfield.store import Store

if TYPE_CHECKING:
    from farfield.serve.push.pace import Pace
    from farfield.serve.push.session import Sendable, Session

HELLO_SECONDS = 10.0
"""In which the first message comes, or the session ends."""
BAD, TRY_LATER, FAILED = 1008, 1013, 1011
"""Codes of a close: against the rules, no session is free, the world cannot be read or the server is at fault."""
COUNTED = 16 << 10
"""Bytes for which a message counts once more: 4,096 keys take 1.6 ms to read."""

_log = logging.getLogger("farfield.serve")


@dataclass(frozen=True, slots=True)
class PushLimits:
    """What sessions may take."""

    sessions: int = 200
    """At once."""
    idle_seconds: float = 60.0
    """Without a message a session ends; viewers say where they are every 20 s at least."""
    messages: float = 100.0
    """A second, on average over ten."""
    token: str = ""
    """What viewers must say to begin a session; empty: nothing."""


class Push:
    """All sessions of a world."""

    def __init__(self, world: Served, limits: PushLimits, now: Callable[[], float]) -> None:
        self.sessions = 0
        """How many there are now."""
        self._pace: Pace | None = None
        self._limits = limits
        self._now = now
        self._world = world
        self._lock = asyncio.Lock()
        self._tag = ""
        self._sendable: Sendable | None = None

    async def serve(self, socket: WebSocket) -> None:
        """One connection, from its beginning to its end; whatever goes wrong ends that session alone."""
        await socket.accept()
        if self.sessions >= self._limits.sessions:
            await _close(socket, TRY_LATER, "too many sessions")
            return
        self.sessions += 1
        try:
            await self._begin(socket)
        except WebSocketDisconnect:
            return
        except ProtocolError as error:
            await _close(socket, BAD, str(error))
        except FarfieldError as error:
            _log.warning("%s", error)
            await _close(socket, FAILED, "the world cannot be read")
        except Exception:
            _log.exception("a session failed")
            await _close(socket, FAILED, "the server failed")
        finally:
            self.sessions -= 1

    async def _begin(self, socket: WebSocket) -> None:
        said = _Said(socket, self._limits, self._now)
        hello = read(await said.next(HELLO_SECONDS))
        if not isinstance(hello, Hello):
            raise ProtocolError("the first message is no hello")
        if self._limits.token and not hmac.compare_digest(hello.token.encode(), self._limits.token.encode()):
            raise ProtocolError("the token is another")
        await run_in_threadpool(load)
        from farfield.serve.push.pace import Pace
        from farfield.serve.push.session import Session

        world = await self._current()
        pace = self._pace = self._pace or Pace()
        session = Session(world, _sender(socket), self._now, pace)
        # What a viewer has of another generation may be of no use, and does no harm.
        session.hold(hello.holds)
        await socket.send_text(write(Welcome(world.generation)))
        pace.sessions.add(session)
        tasks = [asyncio.create_task(both) for both in (session.send(), self._listen(said, session))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            # Either ends by an error alone.
            done.pop().result()
        finally:
            pace.sessions.discard(session)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _listen(self, said: _Said, session: Session) -> None:
        while True:
            session.take(read(await said.next(self._limits.idle_seconds)))

    async def _current(self) -> Sendable:
        """The world as it is now; its index is read once for all sessions.

        Only that is done by one session after the other: 200 that began at once waited 15 s, each for all before it.
        """
        store, tag = await run_in_threadpool(self._seen)
        if tag != self._tag:
            async with self._lock:
                if tag != self._tag:
                    self._sendable, self._tag = await run_in_threadpool(_sendable, store), tag
        assert self._sendable is not None
        return self._sendable

    def _seen(self) -> tuple[Store, str]:
        store = self._world.now()
        return store, tag_of(store.get(MANIFEST))


def load() -> None:
    """Loads what sessions are made with: the kernels take a second, in which the server should answer others."""
    import farfield.serve.push.session  # noqa: F401


class _Said:
    """What a viewer says, as fast as it may."""

    def __init__(self, socket: WebSocket, limits: PushLimits, now: Callable[[], float]) -> None:
        self._socket = socket
        self._limits = limits
        self._now = now
        self._free_at = now() - 10.0

    async def next(self, seconds: float) -> str | bytes:
        """The next message. Raises ProtocolError when none comes, or too many do; WebSocketDisconnect at the end."""
        try:
            async with asyncio.timeout(seconds):
                message = await self._socket.receive()
        except TimeoutError:
            raise ProtocolError("nothing was said for too long") from None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        text: str | bytes | None = message.get("text")
        found: str | bytes = message["bytes"] if text is None else text
        cost = (1 + len(found) // COUNTED) / self._limits.messages
        self._free_at = max(self._free_at, self._now() - 10.0) + cost
        if self._free_at > self._now():
            raise ProtocolError("too many messages")
        return found


def _sendable(store: Store) -> Sendable:
    from farfield.serve.push.session import Sendable
    from farfield.stream.tree import CellTree
    from farfield.view.impostors import ImpostorMaker
    from farfield.world.world import World

    world = World.open(store)
    tree = CellTree.of(world)
    return Sendable(store, tree, ImpostorMaker(store, tree.instances), world.manifest.generation)


def _sender(socket: WebSocket) -> Callable[[str | bytes], Awaitable[None]]:
    async def send(message: str | bytes) -> None:
        if isinstance(message, str):
            await socket.send_text(message)
        else:
            await socket.send_bytes(message)

    return send


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    """Says why. A viewer that is gone hears nothing, and one that takes nothing is not waited for."""
    with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
        async with asyncio.timeout(CLOSE_SECONDS):
            # 123 bytes are what the protocol has for it.
            await socket.close(code, reason.encode()[:120].decode(errors="ignore"))
