"""Runs the server: finds a port, says where it is, opens the browser, ends cleanly."""

from __future__ import annotations

import asyncio
import errno
import math
import os
import queue
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import uvicorn

from farfield.errors import OptionError, ServeError
from farfield.serve.app import create_app
from farfield.serve.clock import Clock, WallClock
from farfield.serve.protocol import STALL_SECONDS, SessionProtocol, WatchedProtocol
from farfield.serve.push.endpoint import PushLimits, load
from farfield.serve.push.messages import MAX_MESSAGE
from farfield.serve.throttle import Link
from farfield.serve.viewer_files import page_store
from farfield.store import Store

FIRST_PORT = 8000
PORTS_TRIED = 50
"""From FIRST_PORT on, when no port was asked for."""

MAX_CONNECTIONS = 500
"""More are answered 503: half of the 1,024 files that a process may usually have open."""

MAX_HEADER = 32 * 1024
"""Bytes of one request's line and headers; more are answered 400."""


MAX_DELAY = 10.0
"""Seconds; a page gives an answer up after 30."""


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """How a world is served."""

    host: str = "127.0.0.1"
    """Address or name to listen on."""

    port: int | None = None
    """Port; 0 for any that is free; None for the first free one from 8000."""

    bandwidth: float | None = None
    """Bytes a second over all answers together; None for no limit."""

    delay: float = 0.0
    """Seconds that each answer comes later, as from a server far away."""

    clock: Clock = field(default_factory=WallClock)
    """By which bandwidth and delay are kept; tests and benchmarks move it themselves."""

    open_browser: bool = False
    """Open the page once the server is there."""

    sessions: PushLimits = field(default_factory=PushLimits)
    """What sessions may take."""

    stall_seconds: float = STALL_SECONDS
    """After which a client that neither asks nor takes is let go."""


def serve(world: Store, options: ServeOptions, announce: Callable[[str], None]) -> None:
    """Serve `world` until interrupted (Ctrl-C); `announce` is called with the page's URL once it can be opened.

    Raises ServeError: no port to listen on. OptionError: a value that makes no sense.
    """
    listener = bind(options.host, options.port)
    server = _Server(world, options, announce)
    try:
        server.run(sockets=[listener])
    except KeyboardInterrupt:
        # The ordinary way to end a server.
        return
    finally:
        listener.close()


@contextmanager
def serving(world: Store, options: ServeOptions) -> Iterator[str]:
    """Serve `world` from a thread while the block runs; gives the page's URL. Raises as `serve` does."""
    listener = bind(options.host, options.port)
    started: queue.SimpleQueue[str] = queue.SimpleQueue()
    server = _Server(world, options, started.put)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        yield started.get(timeout=10)
    finally:
        server.should_exit = True
        thread.join(10)
        listener.close()


def bind(host: str, port: int | None) -> socket.socket:
    """A listening socket. Raises ServeError: the address is not ours, or the port not free."""
    candidates = range(FIRST_PORT, FIRST_PORT + PORTS_TRIED) if port is None else [port]
    for candidate in candidates:
        try:
            return _listen(host, candidate)
        except OSError as error:
            if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
                raise ServeError("this machine has no such address", host, "try --host 127.0.0.1") from error
            if error.errno != errno.EADDRINUSE:
                hint = "ports below 1024 need root" if error.errno == errno.EACCES else ""
                raise ServeError(f"cannot listen: {error.strerror}", f"{host}:{candidate}", hint) from error
    if port is None:
        raise ServeError(f"ports {candidates[0]} to {candidates[-1]} are all in use", host, "name another with --port")
    raise ServeError(f"port {port} is in use", host, "name another with --port, or none")


def page_url(listener: socket.socket) -> str:
    """The address to open in a browser of this machine."""
    host, port = listener.getsockname()[:2]
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def _listen(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listener = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":
            # A server started again at once finds its port still waiting for the last packets of the old one.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        # Two sockets may be bound so; only one may listen.
        listener.listen(128)
    except OSError:
        listener.close()
        raise
    return listener


class _Server(uvicorn.Server):
    """uvicorn, which says when it is ready and does not wait for downloads when it ends."""

    def __init__(self, world: Store, options: ServeOptions, announce: Callable[[str], None]) -> None:
        bandwidth = options.bandwidth
        if bandwidth is not None and not (math.isfinite(bandwidth) and bandwidth > 0):
            raise OptionError("must be a number of bytes a second above 0", "--bandwidth")
        if not 0 <= options.delay < MAX_DELAY:
            raise OptionError(f"must be 0 to {1000 * MAX_DELAY:.0f} milliseconds", "--delay")
        protocol = type("Protocol", (WatchedProtocol,), {"stall_seconds": options.stall_seconds})
        config = uvicorn.Config(
            create_app(world, page_store(), Link(bandwidth, options.delay, options.clock), options.sessions),
            http=protocol,
            ws=SessionProtocol,
            ws_max_size=MAX_MESSAGE,
            # Values are packed already: to deflate a piece again takes .4 ms and saves nothing.
            ws_per_message_deflate=False,
            lifespan="off",
            log_level="error",
            access_log=False,
            server_header=False,
            limit_concurrency=MAX_CONNECTIONS,
            h11_max_incomplete_event_size=MAX_HEADER,
            timeout_keep_alive=int(max(options.stall_seconds, 1)),
            timeout_graceful_shutdown=2,
        )
        super().__init__(config)
        self._announce = announce
        self._open_browser = options.open_browser

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """See uvicorn."""
        await super().startup(sockets)
        url = page_url((sockets or [])[0])
        self._announce(url)
        # Every page asks for a session, and opens faster than that is loaded.
        threading.Thread(target=load, daemon=True).start()
        if self._open_browser and _has_display():
            await asyncio.get_running_loop().run_in_executor(None, webbrowser.open, url)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """See uvicorn."""
        for connection in list(self.server_state.connections):
            connection.transport.abort()
        await super().shutdown(sockets)


def _has_display() -> bool:
    """Without one, `webbrowser` would start a text browser in the terminal that shows the URL."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
