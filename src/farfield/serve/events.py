"""Server-sent events (spec/http.md): who listens is told of every new manifest of the world."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import suppress

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from farfield.errors import FarfieldError
from farfield.serve.served import Served
from farfield.serve.watch import Edition, ManifestWatch

MEDIA_TYPE = "text/event-stream"

MAX_LISTENERS = 200
"""At once; more are answered 503. Each holds a connection, and tiles need those that are left (run.MAX_CONNECTIONS)."""

HEARTBEAT_SECONDS = 15.0
"""Between two lines: proxies cut connections that say nothing, mostly after 60 s."""

RETRY_MS = 2000
"""How long a browser waits before it connects again."""

_HEADERS = {
    "Cache-Control": "no-store",
    # nginx, and what follows its lead, would gather events into blocks of 4 kB.
    "X-Accel-Buffering": "no",
}

_log = logging.getLogger("farfield.serve")


class GenerationFeed:
    """The manifest of a world, looked up by one task for all who listen, and by none while nobody does.

    Belongs to one event loop at a time. Nothing is queued: a listener that was busy hears of the newest only.
    """

    def __init__(
        self, world: Served, *, max_listeners: int = MAX_LISTENERS, heartbeat_seconds: float = HEARTBEAT_SECONDS
    ) -> None:
        self._watch = ManifestWatch(world)
        self._max_listeners = max_listeners
        self._heartbeat_seconds = heartbeat_seconds
        self._listeners = 0
        self._edition: Edition | None = None
        self._complaint = ""
        self._changed = asyncio.Event()
        self._poller: asyncio.Task[None] | None = None

    @property
    def listeners(self) -> int:
        """How many listen now."""
        return self._listeners

    def join(self) -> bool:
        """One listener more, who is to `leave`; False when there are too many."""
        if self._listeners >= self._max_listeners:
            return False
        self._listeners += 1
        if self._poller is None:
            self._changed = asyncio.Event()
            self._poller = asyncio.get_running_loop().create_task(self._poll())
        return True

    def leave(self) -> None:
        """One listener less; with the last one the world is left alone."""
        self._listeners -= 1
        if self._listeners == 0 and self._poller is not None:
            self._poller.cancel()
            self._poller = self._edition = None
            self._watch.forget()

    async def lines(self) -> AsyncIterator[bytes]:
        """What one listener is sent: the manifest as it is, then every new one, and comments between."""
        yield b"retry: %d\n\n" % RETRY_MS
        sent: Edition | None = None
        while True:
            if self._edition is not None and self._edition != sent:
                sent = self._edition
                yield _event(sent)
                # Sending may have taken long: there may be a newer one by now.
                continue
            heard = self._changed
            with suppress(TimeoutError):
                async with asyncio.timeout(self._heartbeat_seconds):
                    await heard.wait()
            if not heard.is_set():
                yield b": still here\n\n"

    async def _poll(self) -> None:
        while True:
            edition = await self._look()
            if edition not in (None, self._edition):
                self._edition = edition
                self._changed.set()
                self._changed = asyncio.Event()
            await asyncio.sleep(self._watch.pause_seconds)

    async def _look(self) -> Edition | None:
        """A world that cannot be read for a while is no news, and complained of once; a later look tells."""
        try:
            edition, complaint = await run_in_threadpool(self._watch.look), ""
        except FarfieldError as error:
            edition, complaint = None, str(error)
        if complaint not in ("", self._complaint):
            _log.warning("%s", complaint)
        self._complaint = complaint
        return edition


def _event(edition: Edition) -> bytes:
    facts = b'{"generation": %d, "manifest": "%s"}' % (edition.generation, edition.tag.encode())
    return b"id: %s\nevent: generation\ndata: %s\n\n" % (edition.tag.encode(), facts)


def events_response(feed: GenerationFeed, request: Request) -> Response:
    """The answer to a GET or HEAD of `/events`."""
    if request.method == "HEAD":
        return Response(headers=_HEADERS, media_type=MEDIA_TYPE)
    return _EventStream(feed)


class _EventStream(StreamingResponse):
    """Counts as a listener for as long as it is sent, however that ends."""

    def __init__(self, feed: GenerationFeed) -> None:
        super().__init__(feed.lines(), headers=_HEADERS, media_type=MEDIA_TYPE)
        self._feed = feed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if not self._feed.join():
            refusal = PlainTextResponse("too many listen already", 503, {"Retry-After": "30"})
            await refusal(scope, receive, send)
            return
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._feed.leave()
