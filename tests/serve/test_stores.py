"""`farfield serve` of a folder, an archive, a bucket, a split world and a world on a web server: the same answers."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.request
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from farfield.cli import main
from farfield.pipeline import copy_place
from farfield.store import DirectoryStore

GOLDEN = Path(__file__).parents[1] / "fixtures/world-v1.zip"
VIEW = ["--eye", "-20,-20,15", "--target", "8,8,0", "--size", "160x120", "--json"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The golden world."""
    with zipfile.ZipFile(GOLDEN) as archive:
        archive.extractall(tmp_path / "golden")
    return tmp_path / "golden"


@pytest.fixture
def elsewhere(folder: Path) -> Iterator[str]:
    """The address at which another server has it."""
    with served(str(folder)) as address:
        yield address


@contextmanager
def served(place: str) -> Iterator[str]:
    """The address at which the command serves `place`."""
    command = [sys.executable, "-m", "farfield", "serve", place, "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["url"]
        finally:
            process.terminate()


@pytest.mark.parametrize("kind", ["folder", "archive", "bucket", "split", "web"])
def test_every_kind_is_served_alike(folder: Path, tmp_path: Path, kind: str, request: pytest.FixtureRequest) -> None:
    if kind == "bucket":
        make: Callable[[], str] = request.getfixturevalue("new_bucket")
        place = f"{make()}/golden"
    else:
        places = {"folder": folder, "archive": tmp_path / "a.farfield", "split": tmp_path / "split/a"}
        place = str(places.get(kind, folder))
    if kind == "split":
        copy_place(folder, tmp_path / "split", servers=["a", "b"])
    elif kind == "web":
        place = request.getfixturevalue("elsewhere")
    elif kind != "folder":
        copy_place(folder, place)
    store = DirectoryStore(folder)
    tiles = list(store.list("orthoview"))[:40]
    with served(place) as url:
        with urllib.request.urlopen(f"{url}world.json") as answer:
            assert answer.read() == store.get("world.json")
            assert answer.headers["Farfield-Batch"] == "batch"
        with urllib.request.urlopen(f"{url}batch?" + "&".join(f"key={key}" for key in tiles)) as answer:
            values = b"".join(store.size(key).to_bytes(4, "little") + store.get(key) for key in tiles)
            assert answer.read() == values
            assert "immutable" in answer.headers["Cache-Control"]
        part = urllib.request.Request(url + tiles[0], headers={"Range": "bytes=3-9"})
        with urllib.request.urlopen(part) as answer:
            assert answer.status == 206
            assert answer.read() == store.get(tiles[0])[3:10]


def test_an_archive_is_drawn_as_the_folder(folder: Path, tmp_path: Path) -> None:
    copy_place(folder, tmp_path / "a.farfield")
    for place, name in ((folder, "folder.png"), (tmp_path / "a.farfield", "archive.png")):
        assert main(["render", str(place), *VIEW, "-o", str(tmp_path / name)]) == 0
    picture = (tmp_path / "folder.png").read_bytes()
    assert len(picture) > 1000
    assert picture == (tmp_path / "archive.png").read_bytes()


def test_splats_of_another_shape(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = set()
    for shape in ("covered", "discs", "ellipses"):
        assert main(["render", str(folder), *VIEW, "--splats", shape, "-o", str(tmp_path / f"{shape}.png")]) == 0
        pictures.add((tmp_path / f"{shape}.png").read_bytes())
    assert len(pictures) == 3
    assert main(["render", str(folder), *VIEW, "--splats", "round", "-o", str(tmp_path / "none.png")]) == 2
    assert "--splats: no splats 'round'" in capsys.readouterr().err
