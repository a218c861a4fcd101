"""The page when something is wrong: bad tiles, no world, a newer one, no WebGL2, a server that goes and comes."""

from __future__ import annotations

import functools
import shutil
import threading
from collections.abc import Callable, Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from e2e.browsing import Visit, psnr
from farfield.serve.run import ServeOptions, serving
from farfield.serve.viewer_files import install_viewer
from farfield.store import DirectoryStore

FAR = ((-60.0, -60.0, 45.0), (0.0, 0.0, 0.0))


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Says nothing."""


@pytest.fixture
def copy(world: DirectoryStore, tmp_path: Path) -> DirectoryStore:
    """A copy of the town that a test may damage, with the viewer in it."""
    shutil.copytree(world.location, tmp_path / "town")
    store = DirectoryStore(tmp_path / "town")
    install_viewer(store)
    return store


@pytest.fixture
def files(copy: DirectoryStore) -> Iterator[str]:
    """Python's own file server on that copy; its address."""
    handler = functools.partial(_Quiet, directory=copy.location)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


def test_a_file_server_is_enough(files: str, visit: Callable[..., Visit]) -> None:
    page = visit(files)
    page.options(nearRadius=20, farGeometry=False)
    page.complete()
    stats = page.stats()
    assert stats["splats"] > 1000
    assert stats["tiles_missing"] == 0
    assert stats["requests"] >= len(page.fetched) > 50, "one request a tile"


def test_a_world_elsewhere(files: str, address: str, visit: Callable[..., Visit]) -> None:
    """The page of one server shows the world of another (the second has to allow it: `farfield serve` does)."""
    page = visit(f"{files}?world={address}world.json")
    page.options(nearRadius=20, farGeometry=False)
    page.complete()
    assert page.stats()["splats"] > 1000
    assert any(key.startswith("orthoview/") for key in page.fetched)


def test_parents_stand_in_for_bad_tiles(copy: DirectoryStore, files: str, visit: Callable[..., Visit]) -> None:
    page = visit(files)
    page.complete()
    page.options(nearRadius=0)
    page.look(*FAR)
    good = page.picture()
    leaves = sorted({"/".join(key.split("/")[:5]) for key in page.fetched if key.startswith("orthoview/0/")})
    for number, leaf in enumerate(leaves[10:30]):
        for path in (Path(copy.location) / leaf).rglob("*"):
            if path.is_file() and number % 2:
                path.unlink()
            elif path.is_file():
                path.write_bytes(path.read_bytes()[:-9] + b"scrambled")
    again = visit(files, expect_errors=True)
    again.do("farfield.setOptions({nearRadius: 0})")
    again.look(*FAR)
    stats = again.stats()
    assert stats["tiles_missing"] > 20
    assert stats["stand_ins"] >= 1
    shown = again.picture()
    assert 18 < psnr(shown, good) < 60, "coarser in places, but nothing missing"
    sky = (np.abs(shown.astype(int) - [158, 191, 235]).max(-1) < 3).mean()
    assert abs(sky - (np.abs(good.astype(int) - [158, 191, 235]).max(-1) < 3).mean()) < 0.02


def test_the_server_goes_and_comes_back(copy: DirectoryStore, visit: Callable[..., Visit]) -> None:
    with serving(copy, ServeOptions(port=0)) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        page = visit(address, expect_errors=True)
        page.options(nearRadius=20, farGeometry=False)
        page.complete()
        page.options(cacheBytes=1 << 20)
    page.do("camera => farfield.setCamera(camera)", {"eye": [20, 5, 3], "target": [0, 5, 2]})
    page.says("The server does not answer")
    with serving(copy, ServeOptions(port=port)):
        page.complete()
        page.page.locator("#banner").wait_for(state="hidden")
    assert page.stats()["tiles_missing"] == 0


def test_a_server_that_is_not_there_yet(copy: DirectoryStore, files: str, visit: Callable[..., Visit]) -> None:
    with serving(copy, ServeOptions(port=0)) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
    page = visit(f"{files}?world=http://127.0.0.1:{port}/", expect_errors=True)
    page.says("Opening the world")
    page.says("The server does not answer")
    with serving(copy, ServeOptions(port=port)):
        page.complete()
    assert page.stats()["triangles"] > 500


def test_no_world_at_that_address(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(f"{address}?world=nowhere/", expect_errors=True)
    page.says("There is no world here")
    page.says("nowhere/")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (b'"version": 1', b'"version": 2', "made by a newer farfield"),
        (b'"resolution": 32', b'"resolution": -1', "damaged manifest"),
        (b"farfield-world", b"something-else", "There is no world here"),
    ],
)
def test_manifests_that_cannot_be_read(
    copy: DirectoryStore, files: str, visit: Callable[..., Visit], before: bytes, after: bytes, message: str
) -> None:
    manifest = Path(copy.location) / "world.json"
    assert before in manifest.read_bytes()
    manifest.write_bytes(manifest.read_bytes().replace(before, after))
    visit(files).says(message)


def test_a_browser_without_webgl2(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address, script="HTMLCanvasElement.prototype.getContext = () => null")
    page.says("It offers no WebGL 2")
