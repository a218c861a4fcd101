"""A store on a web server: what plain servers, those with ranges, and bad ones answer."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from farfield.errors import MissingKeyError, NotAWorldError, OptionError, StoreError
from farfield.serve.run import ServeOptions, serving
from farfield.store import HttpStore, MemoryStore, open_store
from farfield.store import http as http_store

TILE = "orthoview/3/-1/0/-12/17/0-9f86d081884c7d65"
VALUE = bytes(range(200))


class _Odd(BaseHTTPRequestHandler):
    """Answers as the first segment of the address says."""

    def log_message(self, *_: Any) -> None:
        """Says nothing."""

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        kind = self.path.split("/")[1]
        if kind.isdigit():
            self.send_response(int(kind))
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        if kind == "moved":
            self.send_response(302)
            self.send_header("Location", "file:///etc/hostname")
            self.end_headers()
            return
        self.send_response(200)
        if kind == "short":
            self.send_header("Content-Length", str(len(VALUE) + 5))
        elif kind == "plain":
            self.send_header("Content-Length", str(len(VALUE)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(VALUE)


@pytest.fixture(scope="module")
def odd() -> Iterator[str]:
    """Address of a server with a folder for each kind of answer."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Odd) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("kind", ["ranges", "plain", "unknown length"])
def test_values_and_parts_of_them(kind: str, odd: str) -> None:
    inner = MemoryStore()
    inner.put(TILE, VALUE)
    with serving(inner, ServeOptions(port=0)) as address:
        store = HttpStore(address if kind == "ranges" else f"{odd}/{kind.replace(' ', '-')}/")
        assert store.get(TILE) == VALUE
        assert store.size(TILE) == len(VALUE)
        assert store.exists(TILE)
        for start, length in ((0, 7), (3, 5), (190, 50), (200, 5), (500, 5), (5, 0)):
            assert store.get_range(TILE, start, length) == VALUE[start : start + length]
    with pytest.raises(OptionError):
        store.get_range(TILE, 0, -1)


@pytest.mark.parametrize("status", [400, 403, 404, 410])
def test_what_is_refused_is_missing(odd: str, status: int) -> None:
    store = HttpStore(f"{odd}/{status}")
    assert not store.exists(TILE)
    for act in (store.get, store.size, lambda key: store.get_range(key, 0, 1)):
        with pytest.raises(MissingKeyError, match=TILE):
            act(TILE)


@pytest.mark.parametrize("status", [408, 429, 500, 503])
def test_what_passes_is_not_missing(odd: str, status: int) -> None:
    store = HttpStore(f"{odd}/{status}")
    for act in (store.get, store.size, store.exists):
        with pytest.raises(StoreError, match=f"answers {status}") as caught:
            act(TILE)
        assert not isinstance(caught.value, MissingKeyError)


def test_servers_that_cannot_be_believed(odd: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StoreError, match="cut short"):
        HttpStore(f"{odd}/short").get(TILE)
    with pytest.raises(StoreError):
        HttpStore(f"{odd}/moved").get(TILE)
    with pytest.raises(StoreError, match="does not answer"):
        HttpStore("http://127.0.0.1:9").get(TILE)
    monkeypatch.setattr(http_store, "MAXIMUM_BYTES", 100)
    with pytest.raises(StoreError, match="more than a value can have"):
        HttpStore(f"{odd}/plain").get(TILE)


def test_it_is_only_read(odd: str) -> None:
    store = open_store(f"{odd}/plain/")
    assert isinstance(store, HttpStore)
    assert store.location == f"{odd}/plain"
    for act in (lambda: store.put(TILE, b""), lambda: store.delete(TILE), store.writing, lambda: list(store.list())):
        with pytest.raises(StoreError):
            act()
    for key in ("../x", "/etc/passwd", "a?b", ""):
        with pytest.raises(StoreError, match="not a key"):
            store.get(key)
    with pytest.raises(NotAWorldError, match="nothing is written to web servers"):
        open_store(f"{odd}/x", create=True)
    with pytest.raises(NotAWorldError, match="archives"):
        open_store(f"{odd}/x.farfield")


@pytest.mark.parametrize(
    "url", ["http://", "https:///a", "http://u:p@a/", "http://a/?b", "http://a/#b", "http://a /", "http://ü/"]
)
def test_what_is_no_address(url: str) -> None:
    with pytest.raises(StoreError, match="not the address"):
        HttpStore(url)
