"""A world in one file on a server of files, read by byte ranges: the picture is that of the folder."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from e2e.browsing import Visit, psnr
from farfield.pipeline import copy_place
from farfield.serve.run import ServeOptions, serving
from farfield.serve.viewer_files import install_viewer
from farfield.store import DirectoryStore, open_store

VIEWS = [((-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)), ((-34.0, -36.0, 12.0), (0.0, 0.0, 2.0))]


class _Files(SimpleHTTPRequestHandler):
    """Sends files as they are."""

    def log_message(self, *_: Any) -> None:
        """Says nothing."""


class _Ranges(_Files):
    """Sends byte ranges too, as servers of files mostly do."""

    def do_GET(self) -> None:
        found = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if not found or not path.is_file():
            super().do_GET()
            return
        first, last = int(found[1]), int(found[2])
        with path.open("rb") as file:
            file.seek(first)
            part = file.read(last + 1 - first)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{first + len(part) - 1}/{path.stat().st_size}")
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        self.wfile.write(part)


@contextmanager
def files(folder: Path, handler: type[_Files]) -> Iterator[str]:
    """A server of the files in `folder`; its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture
def site(world: DirectoryStore, tmp_path: Path) -> Path:
    """A folder with the page and `town.farfield` beside it."""
    copy_place(world.location, tmp_path / "town.farfield")
    install_viewer(DirectoryStore(tmp_path))
    return tmp_path


def test_the_picture_is_that_of_the_folder(address: str, site: Path, visit: Callable[..., Visit]) -> None:
    with files(site, _Ranges) as url:
        folder, archive = visit(address), visit(f"{url}?world=town.farfield")
        for eye, target in VIEWS:
            pictures = []
            for page in (folder, archive):
                page.options(nearRadius=20, farGeometry=False)
                page.look(eye, target)
                assert page.stats()["tiles_missing"] == 0
                pictures.append(page.picture())
            assert psnr(*pictures) >= 50
        stats = archive.stats()
        assert stats["splats"] > 1000
        assert stats["triangles"] > 20
        assert stats["requests"] < 0.9 * len(folder.fetched), "neighbours come together"


def test_a_damaged_value_is_one_event(site: Path, visit: Callable[..., Visit]) -> None:
    archive = site / "town.farfield"
    store = open_store(archive)
    data = bytearray(archive.read_bytes())
    for key in list(store.list("orthoview/0"))[::3]:
        data[store._span(key).offset + 20] ^= 1  # type: ignore[attr-defined]
    archive.write_bytes(data)
    with files(site, _Ranges) as url:
        page = visit(f"{url}?world=town.farfield", expect_errors=True)
        page.options(nearRadius=0)
        page.look(*VIEWS[0])
        stats = page.stats()
    assert stats["tiles_missing"] > 5
    assert stats["stand_ins"] >= 1


def test_a_server_without_ranges_is_named(site: Path, visit: Callable[..., Visit]) -> None:
    with files(site, _Files) as url:
        page = visit(f"{url}?world=town.farfield")
        page.says("This server cannot send parts of a file")
        page.says("The server does not support byte ranges.")


def test_an_archive_that_is_cut_short(site: Path, visit: Callable[..., Visit]) -> None:
    archive = site / "town.farfield"
    archive.write_bytes(archive.read_bytes()[:-10])
    with files(site, _Ranges) as url:
        page = visit(f"{url}?world=town.farfield")
        page.says("The world is damaged")
        page.says("farfield copy the world again")


def test_an_archive_is_served_like_a_folder(site: Path, visit: Callable[..., Visit]) -> None:
    with serving(open_store(site / "town.farfield"), ServeOptions(port=0)) as url:
        page = visit(url)
        page.options(nearRadius=20, farGeometry=False)
        page.look(*VIEWS[0])
        stats = page.stats()
        page.leave()
    assert stats["splats"] > 1000
    assert stats["tiles_missing"] == 0
    assert stats["requests"] < len(page.fetched), "in batches"
