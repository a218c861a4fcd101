"""A client of a session that goes along a path (spec/stream.md), and notes what it holds from when on."""

from __future__ import annotations

import asyncio
import struct
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from farfield.errors import ServeError
from farfield.serve.push.messages import (
    MAX_MESSAGE,
    PATH,
    Ack,
    Cancelled,
    FromServer,
    FromViewer,
    Hello,
    Missing,
    Value,
    Welcome,
)
from farfield.walk.link import SlowLink
from farfield.walk.loops import run_apart
from farfield.walk.observer import Observer, Poses

VIEW_SECONDS = 0.1
"""Between two views that are said."""
ACK_SECONDS = 0.02
"""Between two acknowledgements."""
VIEW_AGAIN = 20.0
"""Seconds after which a view is said though nothing has changed."""
_PIECE = struct.Struct("<II")
_decoder = msgspec.json.Decoder(FromServer)


@dataclass(frozen=True, slots=True)
class Walker:
    """Who goes along a path."""

    poses: Poses
    size: tuple[int, int]
    """Width and height of the picture, pixels."""
    near_radius: float | None = None
    """Metres within which leaves are geometry; None: r, as the cut defines it."""
    seconds: float = 0.0
    """That the walk lasts; 0: to the end of the path."""
    dynamic_impostors: bool = True
    """Whether it draws images that are made on demand."""

    @property
    def length(self) -> float:
        """Seconds of the walk."""
        return min(self.seconds, self.poses.seconds) if self.seconds > 0 else self.poses.seconds


@dataclass(slots=True)
class Received:
    """What came over the link. Times are seconds from the server's welcome on."""

    arrivals: list[tuple[float, str, int]] = field(default_factory=list)
    """From when on a value was held, its key, its bytes; ascending."""
    bytes: int = 0
    """That passed, those of messages among them."""


def stream_walk(url: str, walker: Walker, link: SlowLink, each_second: Callable[[], None] = lambda: None) -> Received:
    """Goes the whole walk in a session with the server at `url`, in real time.

    each_second: called once a second. Raises ServeError when the session ends before the walk does.
    """
    return run_apart(_Client(url, walker, link, each_second).walk)


class Values:
    """Takes in values."""

    def __init__(self, url: str, link: SlowLink) -> None:
        self.received = Received()
        self.begun = monotonic()
        self._url, self._link = url, link

    async def fetch(self, key: str) -> bytes:
        """A value by GET. Raises ServeError."""
        await asyncio.sleep(self._link.latency)
        data = await asyncio.to_thread(_get, self._url + key)
        await self._link.carry(len(data))
        await asyncio.sleep(self._link.latency)
        return data

    def take(self, key: str, size: int) -> None:
        """A value has come."""
        self.received.arrivals.append((monotonic() - self.begun, key, size))

    def finish(self) -> Received:
        """What has come by now; what is on its way does not count."""
        self.received.bytes = self._link.bytes
        return self.received


def _get(url: str) -> bytes:
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            data: bytes = answer.read()
    except (urllib.error.URLError, OSError) as error:
        raise ServeError(f"a value cannot be had: {error}", url) from None
    return data


@dataclass(slots=True)
class _Begun:
    """A value of which not all pieces have come."""

    key: str
    size: int
    body: bytearray = field(default_factory=bytearray)


class _Client:
    def __init__(self, url: str, walker: Walker, link: SlowLink, each_second: Callable[[], None]) -> None:
        self._url, self._walker, self._link, self._each_second = url, walker, link, each_second
        self._values = Values(url, link)
        self._begun: dict[int, _Begun] = {}
        self._sending: set[asyncio.Task[None]] = set()
        self._pieces = 0
        self._ack: asyncio.Task[None] | None = None
        self._acked_at = 0.0

    async def walk(self) -> Received:
        """From hello to the end of the path."""
        address = self._url.replace("http", "ws", 1) + PATH.lstrip("/")
        try:
            async with connect(address, max_size=MAX_MESSAGE, compression=None) as socket:
                await socket.send(_said(Hello(1)))
                welcome = _decoder.decode(await socket.recv())
                if not isinstance(welcome, Welcome):
                    raise ServeError("the server answers something else than a welcome", address)
                await self._go(socket)
        except (OSError, WebSocketException, msgspec.MsgspecError) as error:
            raise ServeError(f"the session ended: {error}", address) from None
        return self._values.finish()

    async def _go(self, socket: ClientConnection) -> None:
        self._values.begun = monotonic()
        late: asyncio.Queue[tuple[float, str | bytes]] = asyncio.Queue()
        listening = [asyncio.create_task(self._hear(socket, late)), asyncio.create_task(self._take(socket, late))]
        try:
            await self._say_views(socket, listening)
        finally:
            for task in listening:
                task.cancel()
            await asyncio.gather(*listening, return_exceptions=True)

    async def _say_views(self, socket: ClientConnection, listening: list[asyncio.Task[None]]) -> None:
        """Where the walker is, whenever that has changed."""
        observer, said, said_at = Observer(), None, 0.0
        for tick in range(round(self._walker.length / VIEW_SECONDS)):
            at = tick * VIEW_SECONDS
            if (left := self._values.begun + at - monotonic()) > 0:
                await asyncio.wait(listening, timeout=left, return_when=asyncio.FIRST_COMPLETED)
            _raise_what_ended(listening)
            pose = self._walker.poses.at(at)
            observer.see(pose, at)
            walker = self._walker
            view = observer.view(pose, walker.size, walker.near_radius, walker.dynamic_impostors)
            if view != said or at - said_at > VIEW_AGAIN:
                said, said_at = view, at
                self._say(socket, view)
            if tick % round(1 / VIEW_SECONDS) == 0:
                self._each_second()
        await asyncio.sleep(max(self._values.begun + self._walker.length - monotonic(), 0.0))

    def _say(self, socket: ClientConnection, message: FromViewer) -> None:
        """It is heard `latency` later; a session that has ended tells so where it is listened to."""

        async def send() -> None:
            await asyncio.sleep(self._link.latency)
            try:
                await socket.send(_said(message))
            except ConnectionClosed:
                return

        task = asyncio.create_task(send())
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _hear(self, socket: ClientConnection, late: asyncio.Queue[tuple[float, str | bytes]]) -> None:
        """Takes no message before the one before it has passed, so that the server's socket fills as on a slow link."""
        async for message in socket:
            await self._link.carry(len(message))
            late.put_nowait((monotonic() + self._link.latency, message))
        raise ServeError("the server ended the session", self._url)

    async def _take(self, socket: ClientConnection, late: asyncio.Queue[tuple[float, str | bytes]]) -> None:
        while True:
            due, message = await late.get()
            await asyncio.sleep(max(due - monotonic(), 0.0))
            if isinstance(message, bytes):
                self._take_piece(message)
                self._acknowledge(socket)
                continue
            match _decoder.decode(message):
                case Value(number, key, size):
                    self._begun[number] = _Begun(key, size)
                case Cancelled(number):
                    self._begun.pop(number, None)
                case Missing():
                    continue

    def _acknowledge(self, socket: ClientConnection) -> None:
        """Pieces that come within ACK_SECONDS together, as the page does: small values are more than may be said."""
        if self._ack is None or self._ack.done():
            self._ack = asyncio.create_task(self._acknowledge_soon(socket))

    async def _acknowledge_soon(self, socket: ClientConnection) -> None:
        await asyncio.sleep(max(self._acked_at + ACK_SECONDS - monotonic(), 0.0))
        self._acked_at = monotonic()
        self._say(socket, Ack(self._pieces))

    def _take_piece(self, message: bytes) -> None:
        self._pieces += 1
        number, _ = _PIECE.unpack_from(message)
        value = self._begun[number]
        value.body += message[_PIECE.size :]
        if len(value.body) == value.size:
            del self._begun[number]
            self._values.take(value.key, value.size)


def _raise_what_ended(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        if task.done():
            task.result()


def _said(message: FromViewer) -> str:
    return msgspec.json.encode(message).decode()
