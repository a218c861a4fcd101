"""A link that is cut after so many bytes: what has arrived has arrived, the rest waits until more is let through."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from farfield.serve.run import bind, page_url

POLL = 0.01
"""Seconds between looks for more room."""


class Gate:
    """Counts the bytes of answers and holds back, in the middle of a body, what goes beyond the limit."""

    def __init__(self, app: ASGIApp, counted: Callable[[str], bool]) -> None:
        self.sent = 0
        self.limit = 0
        self.waiting = 0
        """Answers that are held back."""
        self.closed = False
        self._app, self._counted = app, counted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] != "http" or not self._counted(scope["path"]):
            await self._app(scope, receive, send)
            return

        async def metered(message: Message) -> None:
            if message["type"] != "http.response.body":
                await send(message)
                return
            async for part, more in self._parts(message.get("body", b"")):
                await send({**message, "body": part, "more_body": more or message.get("more_body", False)})

        await self._app(scope, receive, metered)

    async def _parts(self, body: bytes):  # type: ignore[no-untyped-def]
        """Pieces of a body as there is room for them, and whether more of it follow."""
        while True:
            if body and self.sent >= self.limit:
                self.waiting += 1
                while self.sent >= self.limit and not self.closed:
                    await asyncio.sleep(POLL)
                self.waiting -= 1
            part = body if self.closed else body[: self.limit - self.sent]
            self.sent += len(part)
            body = body[len(part) :]
            yield part, bool(body)
            if not body:
                return


@contextmanager
def served(gate: Gate) -> Iterator[str]:
    """Serves an application from a thread while the block runs; gives its address."""
    listener = bind("127.0.0.1", 0)
    config = uvicorn.Config(gate, ws="none", lifespan="off", log_level="error", timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        yield page_url(listener)
    finally:
        gate.closed = True
        server.should_exit = True
        thread.join(10)
        listener.close()
