"""A real server on the loopback: hostile and slow clients, throttling, ports, the end."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import httpx2 as httpx
import pytest

from farfield.errors import OptionError, ServeError
from farfield.serve import viewer_files
from farfield.serve.clock import SteppedClock
from farfield.serve.run import ServeOptions, bind, serve, serving
from farfield.serve.throttle import BURST_SECONDS, TokenBucket
from farfield.store import DirectoryStore, Store
from serve.small_world import BIG, PAGE, TILE, VALUES


def connect(url: str) -> socket.socket:
    parts = urlsplit(url)
    assert parts.hostname
    assert parts.port
    return socket.create_connection((parts.hostname, parts.port), timeout=10)


def said(connection: socket.socket) -> bytes:
    """Everything until the server closes."""
    answer = b""
    with suppress(ConnectionResetError):
        while piece := connection.recv(65536):
            answer += piece
    return answer


def test_a_plain_client(server: str) -> None:
    answer = httpx.get(server + TILE)
    assert answer.content == VALUES[TILE]
    assert "server" not in answer.headers
    assert httpx.get(server + BIG).content == VALUES[BIG]
    assert httpx.post(server + "batch", json=[TILE]).content[4:] == VALUES[TILE]


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"GET / HTTP/1.1\r\nHost: a\r\nX: " + b"a" * 100_000 + b"\r\n\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: a\r\n\r\n",
        b"\x16\x03\x01\x02\x00" + b"\0" * 50 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n",
        b"GET /../../etc/passwd HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n",
        b"GET http://other.example/etc/passwd HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n",
        b"GET /world.json HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: close, Upgrade\r\n\r\n",
        b"POST /batch HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\nfffffffffffffff\r\n",
    ],
)
def test_malformed_requests_do_no_harm(server: str, request_bytes: bytes) -> None:
    with closing(connect(server)) as connection:
        with suppress(BrokenPipeError, ConnectionResetError):
            connection.sendall(request_bytes)
        assert b"root:" not in said(connection)
    assert httpx.get(server + TILE).status_code == 200


def test_clients_that_stall_are_let_go(server: str) -> None:
    """stall_seconds is 1.5 here. One says nothing, one trickles a header, one trickles a body, one never reads."""
    silent, trickling, posting, deaf = (connect(server) for _ in range(4))
    posting.sendall(b"POST /batch HTTP/1.1\r\nHost: a\r\nContent-Length: 50\r\n\r\n[")
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.sendall(f"GET /{BIG} HTTP/1.1\r\nHost: a\r\n\r\n".encode() * 20)
    began = time.monotonic()
    gone = False
    trickling.sendall(b"GET / HTTP/1.1\r\n")
    while not gone and time.monotonic() - began < 10:
        try:
            trickling.sendall(b"X")
            time.sleep(0.2)
        except OSError:
            gone = True
        assert httpx.get(server + TILE).status_code == 200
    assert gone
    assert said(silent) == b""
    assert len(said(deaf)) < 20 * len(VALUES[BIG])
    for connection in (silent, trickling, posting, deaf):
        connection.close()


def test_many_idle_connections_do_not_keep_others_out(server: str) -> None:
    idle = [connect(server) for _ in range(200)]
    assert httpx.get(server + TILE).content == VALUES[TILE]
    for connection in idle:
        connection.close()


def test_aborted_downloads_give_the_link_back(world: Store) -> None:
    """At 400 kB/s the mesh takes 2.5 s; ten readers that leave at once must not hold the link for 25."""
    with serving(world, ServeOptions(port=0, bandwidth=400_000)) as url:
        for _ in range(10):
            with closing(connect(url)) as connection:
                connection.sendall(f"GET /{BIG} HTTP/1.1\r\nHost: a\r\n\r\n".encode())
                connection.recv(100)
        began = time.monotonic()
        assert httpx.get(url + TILE, timeout=30).content == VALUES[TILE]
        assert time.monotonic() - began < 2


def test_a_slow_link_is_shared_by_all(world: Store) -> None:
    rate, key = 1_000_000, BIG
    with serving(world, ServeOptions(port=0, bandwidth=rate)) as url:
        began = time.monotonic()
        answers: list[bytes] = []
        readers = [threading.Thread(target=lambda: answers.append(httpx.get(url + key).content)) for _ in range(2)]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join()
        seconds = time.monotonic() - began
    assert answers == [VALUES[key]] * 2
    ideal = 2 * len(VALUES[key]) / rate
    assert ideal - 2 * BURST_SECONDS <= seconds < 1.5 * ideal + 0.5


def test_a_token_bucket_keeps_its_rate_and_forgets_idle_time() -> None:
    now = [100.0]
    bucket = TokenBucket(1000, clock=lambda: now[0])
    waits = [bucket.reserve(500) for _ in range(3)]
    assert waits == pytest.approx([0.45, 0.95, 1.45])
    now[0] += 1000
    assert bucket.reserve(1000) == pytest.approx(1 - BURST_SECONDS)


def test_an_answer_is_late_by_the_delay(world: Store) -> None:
    with serving(world, ServeOptions(port=0, delay=0.3)) as url:
        began = time.monotonic()
        assert httpx.get(url + TILE).content == VALUES[TILE]
        assert time.monotonic() - began >= 0.3


def test_by_a_stepped_clock_nothing_leaves_before_its_time(world: Store) -> None:
    clock, rate = SteppedClock(), 1_000_000
    answers: list[bytes] = []
    with serving(world, ServeOptions(port=0, bandwidth=rate, delay=0.1, clock=clock)) as url:
        reader = threading.Thread(target=lambda: answers.append(httpx.get(url + BIG, timeout=60).content))
        reader.start()
        while clock.under_way == 0:
            time.sleep(0.001)
        time.sleep(0.2)
        assert clock.now() == 0
        needed = 0.1 + len(VALUES[BIG]) / rate
        clock.advance(needed - 2 * BURST_SECONDS)
        assert clock.under_way == 1
        clock.advance(3 * BURST_SECONDS)
        reader.join(10)
        assert answers == [VALUES[BIG]]
        assert clock.under_way == 0
        assert clock.now() == pytest.approx(needed + BURST_SECONDS)


@pytest.mark.parametrize("delay", [-0.1, float("nan"), 60.0])
def test_a_delay_that_makes_no_sense(world: Store, delay: float) -> None:
    with pytest.raises(OptionError, match="--delay"):
        serve(world, ServeOptions(port=0, delay=delay), print)


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, float("nan"), float("inf")])
def test_a_bandwidth_that_makes_no_sense(world: Store, bandwidth: float) -> None:
    with pytest.raises(OptionError, match="--bandwidth"):
        serve(world, ServeOptions(port=0, bandwidth=bandwidth), print)


def test_a_port_in_use(world: Store) -> None:
    with closing(bind("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ServeError, match=f"port {port} is in use.*--port"):
            serve(world, ServeOptions(port=port), print)


def test_without_a_port_the_next_free_one_is_taken() -> None:
    with closing(bind("127.0.0.1", None)) as first, closing(bind("127.0.0.1", None)) as second:
        assert 8000 <= first.getsockname()[1] < second.getsockname()[1] < 8050


@pytest.mark.parametrize("host", ["no.such.host.invalid", "203.0.113.7"])
def test_an_address_that_is_not_ours(host: str) -> None:
    with pytest.raises(ServeError, match="no such address"):
        bind(host, 0)


@pytest.fixture
def static_server(server: str, world: Store) -> Iterator[str]:
    """Python's own file server over the world's folder, the viewer installed in it."""
    assert viewer_files.install_viewer(world) == len(PAGE)
    assert viewer_files.install_viewer(world) == 0

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=world.location)) as plain:
        thread = threading.Thread(target=plain.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{plain.server_port}/"
        plain.shutdown()
        thread.join()


def test_a_plain_file_server_has_the_same_layout(server: str, static_server: str) -> None:
    public = [key for key in VALUES if not key.startswith(("record", "notes"))]
    for key in ["", *PAGE, *public]:
        mine, plain = httpx.get(server + key), httpx.get(static_server + key)
        assert mine.status_code == plain.status_code == 200, key
        assert mine.content == plain.content, key
    assert "farfield-batch" not in httpx.get(static_server + "world.json").headers


def _command(world: Store, *options: str) -> subprocess.Popen[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        [sys.executable, "-m", "farfield", "serve", world.location, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


@pytest.mark.parametrize("signalled", [signal.SIGINT, signal.SIGTERM])
def test_the_command_serves_until_interrupted(real_world: Store, signalled: signal.Signals) -> None:
    with _command(real_world, "--port", "0", "--open", "--json") as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["url"]
        parts = urlsplit(url)
        assert parts.hostname
        connection = http.client.HTTPConnection(parts.hostname, parts.port)
        connection.request("GET", "/world.json")
        assert connection.getresponse().read() == real_world.get("world.json")
        began = time.monotonic()
        process.send_signal(signalled)
        rest, complaints = process.communicate(timeout=10)
        assert time.monotonic() - began < 3
    assert (process.returncode, rest, complaints) == (0, "", "")


def test_the_command_refuses_what_is_no_world(tmp_path: Path) -> None:
    with _command(DirectoryStore(tmp_path)) as process:
        _, complaints = process.communicate(timeout=10)
    assert process.returncode == 1
    assert complaints.startswith("farfield: ")
    assert complaints.count("\n") == 1
