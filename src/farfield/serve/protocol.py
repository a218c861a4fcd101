"""uvicorn's HTTP/1.1 and WebSocket, with a watch on every connection: clients that stall are let go."""

from __future__ import annotations

import asyncio
import socket
import struct

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

STALL_SECONDS = 30.0
"""Without a whole request, or without taking any of the answer, for so long: the connection is cut.

uvicorn itself limits only the pause between two requests; a client that sends a header byte by byte, or asks for a
mesh and never reads it, would hold its connection for ever.
"""

CLOSE_SECONDS = 2.0
"""In which a client takes the end of its session: what it leaves is dropped."""


class WatchedProtocol(H11Protocol):
    """One connection. Requests that are being worked on, with nothing waiting to be sent, are left alone."""

    stall_seconds = STALL_SECONDS

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """See asyncio.Protocol."""
        super().connection_made(transport)
        self._is_session = False
        self._seen: object = None
        self._seen_at = self.loop.time()
        self._watch()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """See uvicorn. Sessions end those that say nothing by themselves."""
        self._is_session = True
        super().handle_websocket_upgrade(event)

    def _watch(self) -> None:
        if self.transport.is_closing() or self._is_session:
            return
        busy = self.cycle is not None and not self.cycle.response_complete
        waiting = self.transport.get_write_buffer_size()
        seen = (self.cycle, busy, waiting)
        now = self.loop.time()
        if seen != self._seen or (busy and not waiting):
            self._seen, self._seen_at = seen, now
        elif now - self._seen_at >= self.stall_seconds:
            self._cut()
            return
        self.loop.call_later(self.stall_seconds / 6, self._watch)

    def _cut(self) -> None:
        """Close at once; without lingering, so that the kernel drops what waits for a client that does not read."""
        connection = self.transport.get_extra_info("socket")
        if connection is not None:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.transport.abort()


class SessionProtocol(WebSocketsSansIOProtocol):
    """One session. uvicorn closes a connection only when all that waits for it has been taken, which may be never."""

    async def run_asgi(self) -> None:
        """See uvicorn."""
        await super().run_asgi()
        self.loop.call_later(CLOSE_SECONDS, self.transport.abort)

    def keepalive_timeout(self) -> None:
        """See uvicorn. Who answers no ping has vanished, and hears no reason."""
        self.transport.abort()
