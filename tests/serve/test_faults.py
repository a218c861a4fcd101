"""Sessions when something goes wrong: servers that end, viewers that vanish, links that stop, and hostile messages."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from farfield.errors import MissingKeyError
from farfield.serve import app
from farfield.serve.push import endpoint, pace
from farfield.serve.push.endpoint import Push, PushLimits
from farfield.serve.push.messages import PIECE
from farfield.serve.push.pace import BoundedRegions
from farfield.serve.push.session import BLOCK, Session
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore, MemoryStore, Store
from farfield.stream.motion import MotionPredictor
from farfield.stream.regions import Shape
from farfield.stream.scheduler import Scheduler
from farfield.world.manifest import KEY, decode_manifest, encode_manifest
from serve.hostile import sessions, valid
from serve.test_push import VIEW, Viewer, say_and_listen, session, welcomed
from stream.cells import flat_tree
from stream.test_pictures import seen_from

FIRST = "orthoview/3/0/0/0/"
"""How the keys of what comes first begin."""


class Watched(Push):
    """Keeps what tests want to see."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        made.append(self)
        self.loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, socket: Any) -> None:
        self.loop = asyncio.get_running_loop()
        await super().serve(socket)

    @property
    def served(self) -> list[Session]:
        """Those that have begun."""
        return list(self._pace.sessions) if self._pace else []

    def tasks(self) -> int:
        assert self.loop is not None
        return len(asyncio.all_tasks(self.loop))


made: list[Watched] = []


@pytest.fixture(autouse=True)
def watched(monkeypatch: pytest.MonkeyPatch) -> None:
    made.clear()
    monkeypatch.setattr(app, "Push", Watched)


@pytest.fixture
def faults() -> Iterator[list[str]]:
    """What servers say of exceptions that nobody expected."""
    found: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: found.append(handler.format(record))  # type: ignore[method-assign]
    loggers = [logging.getLogger(name) for name in ("farfield.serve", "uvicorn.error", "asyncio")]
    for logger in loggers:
        logger.addHandler(handler)
    yield found
    for logger in loggers:
        logger.removeHandler(handler)


def until(is_so: Callable[[], bool], seconds: float = 10.0) -> None:
    """Waits for it."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, "did not happen"
        time.sleep(0.02)


def most_tasks(seconds: float = 0.3) -> int:
    """Of the first server in so long: the tasks of a session do not all begin before its welcome is there."""
    end, most = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        most = max(most, made[0].tasks())
        time.sleep(0.01)
    return most


def copied(cells: Store, store: Store) -> Store:
    for key in cells.list(""):
        store.put(key, cells.get(key))
    return store


def in_leaves(keys: Iterable[str]) -> set[str]:
    """All but pictures of cells above."""
    return {key for key in keys if not key.startswith("orthoview/") or key.startswith("orthoview/0/")}


def test_after_a_restart_nothing_that_is_held_comes_again(cells: Store) -> None:
    with serving(cells, ServeOptions(port=0)) as url, session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        viewer.hear(2.0, most=12)
        port = urlsplit(url).port
    first = viewer
    assert 0 < len(first.values) <= 12
    with serving(cells, ServeOptions(port=port)) as url, session(url, holds=sorted(first.values)[:5]) as viewer:
        welcomed(viewer)
        viewer.say(type="add", keys=sorted(first.values)[5:])
        viewer.say(**VIEW)
        viewer.hear(1.0)
    assert viewer.order
    assert not set(viewer.order) & set(first.values)
    with serving(cells, ServeOptions(port=0)) as url, session(url) as whole:
        welcomed(whole)
        whole.say(**VIEW)
        whole.hear(1.0)
    # Pictures of cells above come or not by how many of their leaves came before.
    assert in_leaves(whole.values) == in_leaves(first.values) | in_leaves(viewer.values)


def test_who_vanishes_leaves_nothing_behind(cells: Store, faults: list[str]) -> None:
    with serving(cells, ServeOptions(port=0)) as url, session(url) as good:
        welcomed(good)
        alone = most_tasks()
        for _ in range(5):
            with session(url) as gone:
                welcomed(gone)
                gone.say(**VIEW)
                gone.hear(1.0, most=3)
                # Closed with a reset, as by a process that is killed.
                gone.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                gone.socket.socket.close()
        until(lambda: made[0].sessions == 1 and made[0].tasks() <= alone)
        good.say(**VIEW)
        good.hear(0.5)
        assert len(good.values) > 20
    assert faults == []


def test_who_takes_nothing_holds_little_and_is_let_go(cells: Store, faults: list[str]) -> None:
    """A viewer that acknowledges what it does not read, until all buffers are full, and then is silent."""
    world = copied(cells, MemoryStore())
    for key in cells.list(""):
        if key.startswith(FIRST):
            world.put(key, bytes(30 << 20))
    with serving(world, ServeOptions(port=0, sessions=PushLimits(idle_seconds=1.0, messages=1e6))) as url:
        viewer = _deaf(url)
        viewer.sendall(_frame({"type": "hello", "version": 1}) + _frame(VIEW))
        until(lambda: len(made[0].served) == 1)
        one, pieces, still = made[0].served[0], -1, 0
        while still < 10:
            still = still + 1 if one._pieces == pieces else 0
            pieces = one._pieces
            viewer.sendall(_frame({"type": "ack", "pieces": pieces}))
            time.sleep(0.02)
        # What is sent is in the buffers of two sockets, and waits for no more than another 64 kB.
        assert pieces * PIECE < 16 << 20
        until(lambda: made[0].sessions == 0)
        until(lambda: made[0].tasks() <= 1 + 1)
        viewer.settimeout(10)
        with suppress(ConnectionResetError):
            while viewer.recv(1 << 20):
                pass
        viewer.close()
    assert faults == []


def _deaf(url: str) -> socket.socket:
    """A connection that has begun a session's protocol and has no buffer to speak of."""
    parts = urlsplit(url)
    found = socket.socket()
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    found.connect((parts.hostname, parts.port))
    found.sendall(
        f"GET /stream HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert b" 101 " in found.recv(1000)
    return found


def _frame(message: dict[str, Any]) -> bytes:
    """A text message, masked by zeros."""
    text = json.dumps(message).encode()
    return bytes([0x81, 0x80 | 126]) + struct.pack(">H", len(text)) + bytes(4) + text


def test_acknowledgements_in_any_order_and_more_than_once(cells: Store) -> None:
    r = random.Random(1)
    with serving(cells, ServeOptions(port=0)) as url, session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        said = 0
        while len(viewer.values) < 20:
            viewer.hear(0.1, acknowledge=False)
            for pieces in r.sample(range(said + 1, viewer.pieces + 1), viewer.pieces - said) + [viewer.pieces, 0]:
                viewer.say(type="ack", pieces=pieces)
            said = viewer.pieces
        assert len(viewer.order) == len(set(viewer.order))


def test_an_exception_ends_one_session_and_is_told(
    cells: Store, faults: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    follow = Scheduler.follow

    def failing(self: Scheduler, viewing: Any, now: float) -> None:
        if viewing.fov == 13:
            raise ZeroDivisionError("by design")
        follow(self, viewing, now)

    monkeypatch.setattr(Scheduler, "follow", failing)
    with serving(cells, ServeOptions(port=0)) as url, session(url) as good, session(url) as bad:
        welcomed(good)
        welcomed(bad)
        with pytest.raises(ConnectionClosed) as closed:
            say_and_listen(bad.socket, [json.dumps(VIEW | {"fov": 13})])
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1011, "the server failed")
        good.say(**VIEW)
        good.hear(0.5)
        assert len(good.values) > 20
    assert len(faults) == 1
    assert "by design" in faults[0]


def test_a_world_that_is_replaced_while_sessions_run(cells: Store, tmp_path: Path) -> None:
    world = copied(cells, DirectoryStore(tmp_path / "copy"))
    with serving(world, ServeOptions(port=0)) as url, session(url) as old:
        assert welcomed(old)["generation"] == 4
        world.put(KEY, encode_manifest(msgspec.structs.replace(decode_manifest(world.get(KEY), ""), generation=5)))
        with session(url) as new:
            assert welcomed(new)["generation"] == 5
            for viewer in (old, new):
                viewer.say(**VIEW)
                viewer.hear(0.5)
                assert len(viewer.values) > 20
        # One that cannot be read ends those that begin alone.
        world.put(KEY, b"{")
        with session(url) as failing, pytest.raises(ConnectionClosed) as closed:
            failing.socket.recv(timeout=5)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1011
        gone = old.order[-1]
        old.say(type="drop", keys=[gone])
        old.hear(1.0)
        assert old.order.count(gone) == 2


class Shrinking(MemoryStore):
    """Values are gone after their first blocks."""

    most = 0
    ends = 1 << 40

    def get_range(self, key: str, start: int, length: int) -> bytes:
        if not key.startswith("world"):
            self.most = max(self.most, length)
            if start >= self.ends:
                raise MissingKeyError("nothing is stored there", key)
        return super().get_range(key, start, length)


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_large_value_is_read_in_blocks(cells: Store, is_whole: bool) -> None:
    world = Shrinking()
    copied(cells, world)
    large = [key for key in cells.list("") if key.startswith(FIRST)]
    value = random.Random(2).randbytes(2 * BLOCK + 5)
    for key in large:
        world.put(key, value)
    if not is_whole:
        world.ends = BLOCK
    with serving(world, ServeOptions(port=0)) as url, session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        viewer.hear(1.0)
    assert world.most == BLOCK
    come = [key for key in large if viewer.values.get(key) == value]
    assert bool(come) == is_whole
    assert (viewer.cancelled != []) != is_whole
    assert len(viewer.values) > 20


def test_a_look_has_to_do_with_so_many_cells_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pace, "MOST_CELLS", 30)
    tree = flat_tree()
    for near in (None, 1e12):
        regions = BoundedRegions(tree, Shape(near, -4.0))
        boxes = regions.boxes(MotionPredictor().follow(seen_from((32.0, 32.0, 2.0))), 60.0)
        assert 1 < len(boxes) <= 30
        assert (boxes[:, 3:5] - boxes[:, :2]).prod(axis=1).sum() == 64.0**2
        assert regions.shape == Shape(near, -4.0)


def test_no_viewer_holds_more_than_its_share_once_all_hold_much(cells: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("farfield.serve.push.session.FAIR_HELD", 100)
    monkeypatch.setattr("farfield.serve.push.session.MOST_HELD_BY_ALL", 1_000)
    keys = [f"orthoview/0/{n}/0/0/0/0-0123456789abcdef" for n in range(1_000)]
    with serving(cells, ServeOptions(port=0)) as url, session(url) as greedy, session(url) as modest:
        welcomed(greedy)
        welcomed(modest)
        greedy.say(type="add", keys=keys[:950])
        until(lambda: len(made[0].served) == 2 and sum(one.held for one in made[0].served) == 950)
        modest.say(type="add", keys=keys[:90])
        with pytest.raises(ConnectionClosed) as closed:
            say_and_listen(greedy.socket, [json.dumps({"type": "add", "keys": keys[950:]})])
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.reason.startswith("holds too much")
        modest.say(**VIEW)
        modest.hear(0.5)
        assert len(modest.values) > 20


def test_long_messages_count_for_more(cells: Store) -> None:
    keys = [f"orthoview/0/{n}/0/0/0/0-0123456789abcdef" for n in range(4096)]
    flood = [json.dumps({"type": kind, "keys": keys}) for kind in ("add", "drop")] * 60
    with serving(cells, ServeOptions(port=0)) as url, session(url) as hostile:
        welcomed(hostile)
        with pytest.raises(ConnectionClosed) as closed:
            say_and_listen(hostile.socket, flood)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.reason == "too many messages"


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_hostile_messages_end_their_own_sessions_and_leave_nothing(
    cells: Store, faults: list[str], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard, read = [0], endpoint.read

    def counted(text: str | bytes) -> Any:
        heard[0] += 1
        return read(text)

    monkeypatch.setattr(endpoint, "read", counted)
    with serving(cells, ServeOptions(port=0)) as url:
        # Kernels are loaded and pools filled before memory is counted.
        _attack(url, 0, lambda: heard[0] > 500)
        until(lambda: made[0].sessions == 0)
        heard[0] = 0
        threads, before, rounds = threading.active_count(), _resident(), 0
        hostile = [
            threading.Thread(target=_attack, args=(url, n, lambda: heard[0] > count and rounds > 1))
            for n in range(1, 5)
        ]
        for one in hostile:
            one.start()
        while any(one.is_alive() for one in hostile):
            _be_served(url)
            rounds += 1
        assert heard[0] > count
        assert rounds > 1
        until(lambda: made[0].sessions == 0)
        until(lambda: made[0].tasks() <= 1 + 1)
        # The pool that reads values has 40.
        assert threading.active_count() <= threads + 40
        assert _resident() - before < 60 << 20
    assert faults == []


def _attack(url: str, seed: int, is_enough: Callable[[], bool]) -> None:
    """Sessions one after the other, each to the end that it deserves."""
    hostile = sessions(seed)
    while not is_enough():
        with connect(url.replace("http", "ws") + "stream", max_size=None) as socket, suppress(ConnectionClosed):
            # What is damaged may be valid by chance; the last is not.
            for message in ('{"type":"hello","version":1}', *next(hostile), "{"):
                socket.send(message)
            while True:
                socket.recv(timeout=30)


def _be_served(url: str) -> None:
    """A session as it should be."""
    with session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        viewer.hear(10.0, most=20)
        assert viewer.pieces == 20


def _resident() -> int:
    """Bytes of this process."""
    status = Path("/proc/self/statm")
    if not status.exists():
        pytest.skip("no /proc")
    return int(status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_what_is_valid_is_heard_to_its_extremes(cells: Store, faults: list[str]) -> None:
    r = random.Random(5)
    views = [view for view in (valid(r) for _ in range(400)) if view["type"] == "view"]
    with serving(cells, ServeOptions(port=0, sessions=PushLimits(messages=1e6))) as url, session(url) as viewer:
        welcomed(viewer)
        for view in views[:60]:
            viewer.say(**view)
            viewer.hear(0.0)
        viewer.say(type="drop", keys=sorted(viewer.values))
        viewer.say(**VIEW)
        before = len(viewer.order)
        viewer.hear(1.0)
        assert len(viewer.order) > before
    assert faults == []


class Proxy:
    """A link to a server of so many bytes a second, which can be stopped."""

    def __init__(self, port: int, bandwidth: float) -> None:
        self.goes = threading.Event()
        self.goes.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._bandwidth = bandwidth
        threading.Thread(target=self._serve, args=(port,), daemon=True).start()

    def _serve(self, port: int) -> None:
        near, _ = self._listener.accept()
        far = socket.create_connection(("127.0.0.1", port))
        threading.Thread(target=self._copy, args=(near, far, 1e9), daemon=True).start()
        self._copy(far, near, self._bandwidth)

    def _copy(self, source: socket.socket, target: socket.socket, bandwidth: float) -> None:
        with suppress(OSError):
            while part := source.recv(4096):
                time.sleep(len(part) / bandwidth)
                self.goes.wait()
                target.sendall(part)
        with suppress(OSError):
            target.shutdown(socket.SHUT_WR)


@pytest.mark.slow
def test_a_link_that_stands_for_ten_seconds_is_used_again_at_once(cells: Store) -> None:
    bandwidth = 50_000.0
    with serving(cells, ServeOptions(port=0)) as url:
        proxy = Proxy(urlsplit(url).port or 0, bandwidth)
        with session(f"http://127.0.0.1:{proxy.port}/") as viewer:
            welcomed(viewer)
            viewer.say(**VIEW | {"nearRadius": 200.0})
            assert _bytes_in(viewer, 4.0) > 0.6 * 4 * bandwidth
            proxy.goes.clear()
            assert _bytes_in(viewer, 10.0) < bandwidth
            proxy.goes.set()
            assert _bytes_in(viewer, 3.0) > 0.6 * 3 * bandwidth
            assert np.isclose(made[0].served[0].bandwidth, bandwidth, rtol=0.5)


def _bytes_in(viewer: Viewer, seconds: float) -> int:
    """That come within so long."""
    before, end = viewer.bytes, time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        viewer.hear(left, most=viewer.pieces + 1)
    return viewer.bytes - before
