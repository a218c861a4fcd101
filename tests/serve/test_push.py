"""Sessions in which the server decides what to send: what comes, how fast, and what ends them."""

from __future__ import annotations

import itertools
import json
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from farfield.serve.push.endpoint import PushLimits
from farfield.serve.push.messages import MAX_MESSAGE, PIECE
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore, Store

VIEW = {"type": "view", "eye": [32.0, -30.0, 10.0], "forward": [0.0, 0.97, -0.2], "fov": 60.0, "size": [100, 100]}
TOKEN = "open sesame"


@pytest.fixture(scope="module")
def url(cells: Store) -> Iterator[str]:
    limits = PushLimits(sessions=3, idle_seconds=2.0, token=TOKEN, messages=50.0)
    with serving(cells, ServeOptions(port=0, sessions=limits)) as url:
        yield url


class Viewer:
    """A client that puts together what it is sent."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.values: dict[str, bytes] = {}
        self.order: list[str] = []
        self.cancelled: list[str] = []
        self.missing: list[str] = []
        self.pieces = self.bytes = self.idle = 0
        self._begun: dict[int, tuple[str, int, bytearray]] = {}

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def hear(self, seconds: float, acknowledge: bool = True, most: int = 10**9) -> None:
        """Takes what comes until nothing has for so long."""
        while self.pieces < most:
            try:
                message = self.socket.recv(timeout=seconds)
            except TimeoutError:
                return
            if isinstance(message, bytes):
                self._take(message)
                if acknowledge:
                    self.say(type="ack", pieces=self.pieces)
                continue
            told = json.loads(message)
            if told["type"] == "value":
                self._begun[told["number"]] = (told["key"], told["bytes"], bytearray())
                self.order.append(told["key"])
            elif told["type"] == "idle":
                self.idle += 1
            elif told["type"] == "missing":
                self.missing.append(told["key"])
            elif told["type"] == "cancelled":
                self.cancelled.append(self._begun.pop(told["number"])[0])

    def _take(self, message: bytes) -> None:
        number, offset = struct.unpack_from("<II", message)
        key, size, parts = self._begun[number]
        assert offset == len(parts)
        assert len(message) <= 8 + PIECE
        parts += message[8:]
        self.pieces += 1
        self.bytes += len(message)
        if len(parts) == size:
            self.values[key] = bytes(parts)


@contextmanager
def session(url: str, **hello: Any) -> Iterator[Viewer]:
    with connect(url.replace("http", "ws") + "stream", max_size=1 << 20) as socket:
        viewer = Viewer(socket)
        # A server that has no room closes without having heard it.
        with suppress(ConnectionClosed):
            viewer.say(type="hello", **{"version": 1, "token": TOKEN} | hello)
        yield viewer


def say_and_listen(socket: ClientConnection, messages: list[str]) -> None:
    """Until the server closes."""
    for message in messages:
        socket.send(message)
    while True:
        socket.recv(timeout=5)


def welcomed(viewer: Viewer) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(viewer.socket.recv(timeout=10))
    return found


def test_all_that_is_seen_comes_an_outline_first(url: str, cells: Store) -> None:
    with session(url) as viewer:
        assert welcomed(viewer) == {"type": "welcome", "generation": 4, "version": 1, "piece": PIECE}
        viewer.say(**VIEW)
        viewer.hear(1.0)
    assert viewer.order[0].startswith("orthoview/3/0/0/0/")
    assert len(viewer.values) == len(viewer.order) > 20
    assert all(value == cells.get(key) for key, value in viewer.values.items())
    assert not viewer.cancelled


def test_where_sessions_are_is_said_with_the_manifest(url: str) -> None:
    with urlopen(url + "world.json") as answer:
        assert answer.headers["Farfield-Stream"] == "stream"
        assert "Farfield-Stream" in answer.headers["Access-Control-Expose-Headers"]


def test_a_server_that_has_nothing_more_to_send_says_so_once(url: str) -> None:
    with session(url) as viewer:
        welcomed(viewer)
        viewer.hear(0.3)
        assert viewer.idle == 0, "before it knows where the viewer is"
        viewer.say(**VIEW)
        viewer.hear(1.0)
        assert viewer.idle == 1
        viewer.say(type="drop", keys=[viewer.order[-1]])
        viewer.hear(1.0)
        assert viewer.idle == 2


def test_a_viewer_far_away_fills_its_link(cells: Store) -> None:
    """Pieces that are acknowledged late, as after a round trip, are not what the link is slow by."""
    with serving(cells, ServeOptions(port=0, delay=0.6, bandwidth=200_000.0)) as url, session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW, nearRadius=40.0)
        begun = time.monotonic()
        viewer.hear(2.0)
        sizes = sum(map(len, viewer.values.values()))
        assert sizes / (time.monotonic() - begun - 2.0) > 0.15 * 200_000, "62 kB a second; 11 without"


def test_what_is_held_does_not_come_and_what_was_dropped_comes_again(url: str) -> None:
    with session(url) as first:
        welcomed(first)
        first.say(**VIEW)
        first.hear(1.0)
        gone = first.order[-1]
        first.say(type="drop", keys=[gone])
        first.hear(1.0)
        assert first.order.count(gone) == 2
    with session(url, holds=sorted(first.values)) as again:
        welcomed(again)
        again.say(**VIEW)
        again.hear(1.0)
        assert again.order == []


def test_who_stands_gets_what_it_drops_at_once(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("farfield.serve.push.session.STANDING_SHARE", 100.0)
    with session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        viewer.hear(0.6)
        for gone in viewer.order[-2:]:
            viewer.say(type="drop", keys=[gone])
            viewer.hear(0.5)
            assert viewer.order.count(gone) == 2


def test_no_more_is_under_way_than_half_a_second_of_the_link(url: str) -> None:
    with session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW, nearRadius=40.0)
        viewer.hear(0.7, acknowledge=False)
        # Nothing is known of the link yet but a guess of 20 kB a second.
        assert 1 <= viewer.pieces < 12
        stuck = viewer.pieces
        for _ in range(3):
            viewer.say(type="ack", pieces=stuck)
        viewer.say(type="ack", pieces=1)
        viewer.hear(0.7)
        assert viewer.pieces > stuck


def test_what_is_of_no_use_any_more_is_given_up(url: str) -> None:
    with session(url) as viewer:
        welcomed(viewer)
        near = {"eye": [32.0, 1.0, 2.0], "forward": [0.0, 1.0, 0.0], "nearRadius": 12.0}
        viewer.say(**VIEW | near)
        while not any(key.startswith("geometry/") for key in viewer.order):
            viewer.hear(0.05, most=viewer.pieces + 1)
        # Geometry takes two pieces; the second waits for an acknowledgement of what went before.
        viewer.say(**VIEW | {"eye": [32.0, -500.0, 10.0], "nearRadius": 12.0})
        viewer.hear(0.5, acknowledge=False)
        time.sleep(0.3)
        viewer.say(type="ack", pieces=viewer.pieces)
        viewer.hear(1.0)
        begun, come = set(viewer.order), set(viewer.values)
        assert begun == come | set(viewer.cancelled)


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        (["{"], "not a message"),
        (['{"type":"hello","version":1,"token":"open sesame"}'], "second hello"),
        (['{"type":"ack","pieces":5}'], "not sent"),
        (['{"type":"view","eye":[1e300,0,0],"forward":[0,1,0],"fov":60,"size":[9,9]}'], "not a message"),
        (['{"type":"view","eye":[0,0,0],"forward":[0,0,0],"fov":60,"size":[9,9]}'], "looks nowhere"),
        (['{"type":"drop","keys":["world.json"]}'], "not a message"),
        ([json.dumps(VIEW)] * 600, "too many messages"),
        (["[" * 5000], "not a message"),
    ],
)
def test_a_hostile_viewer_ends_its_own_session_alone(url: str, messages: list[str], reason: str) -> None:
    with session(url) as good, session(url) as hostile:
        welcomed(good)
        welcomed(hostile)
        with pytest.raises(ConnectionClosed) as closed:
            say_and_listen(hostile.socket, messages)
        assert closed.value.rcvd is not None
        assert reason in closed.value.rcvd.reason
        good.say(**VIEW)
        good.hear(0.5)
        assert good.values


@pytest.mark.parametrize(
    ("hello", "reason"),
    [
        ({"token": "guess"}, "token"),
        ({"version": 2}, "not a message"),
        ({"holds": ["record/0/0/0/0"]}, "not a message"),
    ],
)
def test_who_may_not_begin(url: str, hello: dict[str, Any], reason: str) -> None:
    with session(url, **hello) as viewer, pytest.raises(ConnectionClosed) as closed:
        viewer.socket.recv(timeout=5)
    assert closed.value.rcvd is not None
    assert reason in closed.value.rcvd.reason


def test_messages_that_are_too_long_too_many_sessions_and_silence(url: str) -> None:
    with session(url) as long:
        welcomed(long)
        long.socket.send(" " * (MAX_MESSAGE + 1))
        with pytest.raises(ConnectionClosed):
            long.socket.recv(timeout=5)
    with session(url) as one, session(url) as two, session(url) as three:
        for viewer in (one, two, three):
            welcomed(viewer)
        with session(url) as four, pytest.raises(ConnectionClosed) as closed:
            four.socket.recv(timeout=5)
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1013, "too many sessions")
        with pytest.raises(ConnectionClosed) as closed:
            one.socket.recv(timeout=5)
        assert closed.value.rcvd is not None
        assert "too long" in closed.value.rcvd.reason


def test_a_value_that_is_gone_is_said_to_be_missing(tmp_path: Path, cells: Store) -> None:
    copy = DirectoryStore(tmp_path / "copy")
    for key in cells.list(""):
        if not key.startswith("orthoview/3/"):
            copy.put(key, cells.get(key))
    with serving(copy, ServeOptions(port=0)) as url, session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        assert json.loads(viewer.socket.recv(timeout=5))["type"] == "missing"
        viewer.hear(0.7)
        assert len(viewer.values) > 20


def test_clocks_that_jump_change_nothing(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine's clock is set, forwards and back, all the time."""
    jumps, true = itertools.cycle((0.0, 86_400.0, -3_600.0)), time.time
    monkeypatch.setattr(time, "time", lambda: true() + next(jumps))
    begun = time.monotonic()
    with session(url) as viewer:
        welcomed(viewer)
        viewer.say(**VIEW)
        viewer.hear(1.0)
        first = len(viewer.values)
        viewer.say(**VIEW | {"eye": [60.0, 60.0, 10.0], "forward": [-0.7, -0.7, -0.14]})
        viewer.hear(1.0)
    assert first > 20
    assert len(viewer.values) > first
    assert not viewer.cancelled
    assert time.monotonic() < begun + 30
