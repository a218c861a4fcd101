"""A world split over three servers of other origins: the picture of the whole, and what is left when one is away."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from e2e.browsing import Pixels, Visit, differing, psnr
from farfield.octree.grid import CellKey
from farfield.pipeline import copy_place
from farfield.serve.run import ServeOptions, bind, serving
from farfield.serve.viewer_files import install_viewer
from farfield.store import DirectoryStore
from farfield.world.copying import copy_world
from farfield.world.keys import index_key
from farfield.world.manifest import read_manifest
from farfield.world.servers import RULE, ServersRecord
from farfield.world.targets import SplitTarget
from farfield.world.world import World

VIEWS = [((-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)), ((-34.0, -36.0, 12.0), (0.0, 0.0, 2.0))]
SKY = [158, 191, 235]
COUNT = 3


class _Files(SimpleHTTPRequestHandler):
    """Sends files as they are, and lets other origins have them."""

    protocol_version = "HTTP/1.1"

    def log_message(self, *_: Any) -> None:
        """Says nothing."""

    def end_headers(self) -> None:
        self.send_header("Access-Control-Allow-Origin", "*")
        super().end_headers()


class _Plain(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, *arguments: Any) -> None:
        self._connections: list[socket.socket] = []
        super().__init__(*arguments)

    def handle_error(self, *_: Any) -> None:
        """Pages that are closed break connections off."""

    def get_request(self) -> tuple[socket.socket, Any]:
        """See socketserver."""
        connection, client = super().get_request()
        self._connections.append(connection)
        return connection, client

    def server_close(self) -> None:
        """Its threads would go on answering on connections that are kept."""
        super().server_close()
        for connection in self._connections:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)


class Site:
    """The servers of a split world, each at a port that stays its own."""

    def __init__(self, folders: dict[int, Path], *, plain: bool) -> None:
        self.folders = folders
        self._plain = plain
        self._running: dict[int, ExitStack] = {}

    def address(self, number: int) -> str:
        """Of the world at one of the servers."""
        return f"http://127.0.0.1:{list(self.folders)[number]}/"

    def start(self, number: int) -> None:
        """Starts a server, once more perhaps."""
        port = list(self.folders)[number]
        stack = self._running[number] = ExitStack()
        if self._plain:
            stack.enter_context(_plain_server(self.folders[port], port))
        else:
            stack.enter_context(serving(DirectoryStore(self.folders[port]), ServeOptions(port=port)))

    def stop(self, number: int) -> None:
        """Ends a server and its connections."""
        self._running.pop(number).close()

    def close(self) -> None:
        """Ends all of them."""
        for number in list(self._running):
            self.stop(number)


@contextmanager
def _plain_server(folder: Path, port: int) -> Iterator[None]:
    with _Plain(("127.0.0.1", port), partial(_Files, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        yield
        server.shutdown()
        thread.join()


def _free_ports(count: int) -> list[int]:
    listeners = [bind("127.0.0.1", 0) for _ in range(count)]
    ports = [int(listener.getsockname()[1]) for listener in listeners]
    for listener in listeners:
        listener.close()
    return ports


@pytest.fixture(params=["plain servers", "farfield serve"])
def site(request: pytest.FixtureRequest, world: DirectoryStore, tmp_path: Path) -> Iterator[Site]:
    """The town over three servers of files, or as many of `farfield serve`, none of which runs yet."""
    ports = _free_ports(COUNT)
    addresses = [f"http://127.0.0.1:{port}/" for port in ports]
    facts = copy_place(world.location, tmp_path / "split", servers=addresses)
    folders = {port: Path(share["place"]) for port, share in zip(ports, facts["servers"], strict=True)}
    made = Site(folders, plain=request.param == "plain servers")
    yield made
    made.close()


@pytest.fixture(params=[2, 4])
def scattered(request: pytest.FixtureRequest, world: DirectoryStore, tmp_path: Path) -> Iterator[Site]:
    """The town over three servers of files by cells of an upper level: index tiles among them, and of 4 the root."""
    manifest = World.open(world).manifest
    folders = {port: tmp_path / str(port) for port in _free_ports(COUNT)}
    stores = [DirectoryStore(folder) for folder in folders.values()]
    addresses = tuple(f"http://127.0.0.1:{port}/" for port in folders)
    assert manifest.octree.top_level == 4
    servers = ServersRecord(RULE, request.param, addresses)
    copy_world(world, SplitTarget(stores, servers, manifest.octree))
    for store in stores:
        install_viewer(store)
    made = Site(folders, plain=True)
    yield made
    made.close()


def hosts_of(visit: Visit) -> dict[str, int]:
    """Requests for values by the port they went to."""
    counts: dict[str, int] = {}
    visit.page.on("request", lambda request: _count(counts, request.url))
    return counts


def _count(counts: dict[str, int], url: str) -> None:
    # Workers and what they are made of come from the page itself.
    if not url.startswith("blob:"):
        port = str(urlsplit(url).port)
        counts[port] = counts.get(port, 0) + 1


def sky(picture: Pixels) -> float:
    """Share of the picture that shows nothing."""
    return float((np.abs(picture.astype(int) - SKY).max(-1) < 3).mean())


def save(picture: Pixels, name: str, request: pytest.FixtureRequest) -> None:
    """Keeps a picture to be looked at, where --basetemp is given."""
    folder = request.config.option.basetemp
    if folder:
        from PIL import Image

        kind = request.node.name.replace("[", "-").replace("]", "").replace(" ", "-")
        Image.fromarray(picture).save(Path(folder) / f"{kind}-{name}.png")


def test_the_picture_is_that_of_the_whole(
    address: str, site: Site, visit: Callable[..., Visit], request: pytest.FixtureRequest
) -> None:
    for number in range(COUNT):
        site.start(number)
    whole, split = visit(address), visit(site.address(1))
    counts = hosts_of(split)
    for turn, (eye, target) in enumerate(VIEWS):
        pictures = []
        for page in (whole, split):
            page.options(nearRadius=20, farGeometry=False)
            page.look(eye, target)
            assert page.stats()["tiles_missing"] == page.stats()["stand_ins"] == 0
            pictures.append(page.picture())
        save(pictures[0], f"whole{turn}", request)
        save(pictures[1], f"split{turn}", request)
        assert differing(*pictures) < 1e-4
    stats = split.stats()
    assert stats["splats"] > 1000
    assert stats["triangles"] > 20
    assert sorted(counts) == sorted(str(port) for port in site.folders)
    assert min(counts.values()) > 2
    if "plain" not in request.node.name:
        assert stats["requests"] < 0.6 * len(split.fetched), "in batches, of each server"
    split.leave()


def test_one_server_that_is_away_takes_nothing_else_with_it(
    address: str, site: Site, visit: Callable[..., Visit], request: pytest.FixtureRequest
) -> None:
    eye, target = VIEWS[0]
    whole = visit(address)
    whole.options(nearRadius=0)
    whole.look(eye, target)
    good = whole.picture()

    site.start(0)
    site.start(1)
    begun = time.monotonic()
    page = visit(site.address(0), expect_errors=True)
    page.options(nearRadius=0)
    page.look(eye, target)
    assert time.monotonic() - begun < 20, "nothing waits for the one that is away"
    away = urlsplit(site.address(2)).netloc
    page.says(f"{away} does not answer")
    page.page.wait_for_timeout(4000)
    page.complete()
    stats = page.stats()
    coarse = page.picture()
    save(good, "whole", request)
    save(coarse, "one-away", request)
    assert stats["tiles_missing"] == 0, "they are not bad"
    assert stats["tiles_pending"] == 0
    assert stats["stand_ins"] >= 1
    assert 15 < psnr(coarse, good) < 60, "coarser in places"
    assert abs(sky(coarse) - sky(good)) < 0.02, "but nothing is missing"
    warnings = [text for text in page.errors if "farfield:" in text]
    assert len(warnings) == 1, "one message"
    assert len(page.errors) < 10, "and the browser's own of each attempt"

    page.options(nearRadius=30, farGeometry=False)
    page.look(*VIEWS[1])
    assert page.stats()["triangles"] > 20, "what the others have is near geometry"
    page.options(nearRadius=0)
    page.look(eye, target)
    asked = len(page.fetched)
    site.start(2)
    page.page.get_by_text("Try now").evaluate_all("buttons => buttons.forEach((button) => button.click())")
    page.page.wait_for_function("farfield.stats().stand_ins === 0", timeout=20_000)
    page.complete()
    assert differing(page.picture(), good) < 1e-4, "all is well again"
    assert len(page.fetched) > asked
    page.leave()


def test_a_server_that_goes_while_the_page_is_open(
    address: str, site: Site, visit: Callable[..., Visit], request: pytest.FixtureRequest
) -> None:
    for number in range(COUNT):
        site.start(number)
    page = visit(site.address(0), expect_errors=True)
    page.options(nearRadius=0, cacheBytes=2 << 20, views=3)
    page.look((-400.0, -400.0, 300.0), (0.0, 0.0, 0.0))
    site.stop(1)
    page.look(*VIEWS[0])
    page.page.wait_for_timeout(3000)
    page.complete()
    stats = page.stats()
    save(page.picture(), "gone", request)
    assert stats["tiles_pending"] == 0
    assert stats["stand_ins"] >= 1
    assert stats["splats"] > 500
    assert len(page.errors) < 40
    site.start(1)
    page.page.wait_for_function("farfield.stats().stand_ins === 0", timeout=30_000)
    page.page.locator("#banner").wait_for(state="hidden")
    page.leave()


def test_roots_and_index_may_be_anywhere(address: str, scattered: Site, visit: Callable[..., Visit]) -> None:
    manifest = read_manifest(DirectoryStore(next(iter(scattered.folders.values()))))
    assert manifest.servers
    level = manifest.servers.level
    away = manifest.servers.server_of(index_key(CellKey(level, 0, 0, 0), "0" * 16), manifest.octree)
    assert away is not None
    home, other = (number for number in range(COUNT) if number != away)
    scattered.start(home)
    scattered.start(other)
    whole, split = visit(address), visit(scattered.address(home), expect_errors=True)
    for page in (whole, split):
        page.options(nearRadius=0)
    whole.look(*VIEWS[0])
    split.look(*VIEWS[0])
    assert split.stats()["tiles_pending"] == split.stats()["tiles_missing"] == 0
    assert split.stats()["splats"] < whole.stats()["splats"]
    assert (split.stats()["splats"] == 0) == (level == 4), "without a root there is nothing to be shown"
    scattered.start(away)
    # How many are drawn depends on what the picture before hid.
    everything = whole.stats()["splats_in_frustum"]
    split.page.wait_for_function(f"farfield.stats().splats_in_frustum === {everything}", timeout=30_000)
    split.complete()
    assert differing(split.picture(), whole.picture()) < 1e-4
    split.leave()
