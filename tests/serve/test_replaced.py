"""An archive that is replaced while it is served: each answer is from one archive, the next from the newest."""

from __future__ import annotations

import http.client
import logging
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import urlsplit

import httpx2 as httpx
import msgspec
import pytest

from farfield.errors import StoreError
from farfield.serve.run import ServeOptions, serving
from farfield.serve.served import Served
from farfield.store import ArchiveStore, Store
from farfield.world.manifest import KEY, decode_manifest, encode_manifest
from serve.small_world import BIG, TILE
from serve.test_batch import frames
from serve.test_events import listening, next_event
from store.archives import write_archive

LARGE = 48 << 20
"""Bytes of a value that no buffers between server and client hold."""


def values(world: Store, letter: str) -> Mapping[str, bytes]:
    """Of a small world: a manifest and two values that tell which archive they are from."""
    manifest = msgspec.structs.replace(decode_manifest(world.get(KEY), ""), name=letter)
    return {KEY: encode_manifest(manifest), BIG: letter.encode() * 2_000_000, TILE: letter.encode() * 10}


@pytest.fixture
def archive(real_world: Store, tmp_path: Path) -> Path:
    """The first of them."""
    path = tmp_path / "served.farfield"
    write_archive(path, values(real_world, "a"))
    return path


@pytest.fixture
def other(real_world: Store, tmp_path: Path) -> Path:
    """Another, elsewhere, with one key more."""
    path = tmp_path / "other.farfield"
    write_archive(path, {**values(real_world, "b"), "mesh/00000000000000ee": b"new"})
    return path


@pytest.fixture
def url(archive: Path) -> Iterator[str]:
    with serving(ArchiveStore(archive), ServeOptions(port=0)) as address:
        yield address


def test_the_next_answer_is_from_the_new_archive(url: str, archive: Path, other: Path) -> None:
    with listening(url) as lines:
        first = next_event(lines)
        assert httpx.get(url + TILE).content == b"a" * 10
        assert httpx.get(url + "mesh/00000000000000ee").status_code == 404
        other.replace(archive)
        assert httpx.get(url + TILE).content == b"b" * 10
        assert httpx.get(url + "mesh/00000000000000ee").content == b"new"
        batch = httpx.post(url + "batch", json=[TILE, BIG])
        assert frames(batch.content) == [b"b" * 10, b"b" * 2_000_000]
        second = next_event(lines)
    assert first["manifest"] != second["manifest"]
    assert httpx.get(url + KEY).json()["name"] == "b"


def test_an_answer_that_has_begun_stays_with_its_archive(real_world: Store, archive: Path, tmp_path: Path) -> None:
    store = write_archive(archive, {**values(real_world, "a"), BIG: b"a" * LARGE})
    write_archive(tmp_path / "next.farfield", {**values(real_world, "b"), BIG: b"b" * LARGE})
    with serving(store, ServeOptions(port=0)) as url:
        parts = urlsplit(url)
        assert parts.hostname
        connection = http.client.HTTPConnection(parts.hostname, parts.port)
        connection.request("GET", f"/{BIG}")
        answer = connection.getresponse()
        begun = answer.read(1000)
        (tmp_path / "next.farfield").replace(archive)
        assert httpx.get(url + TILE).content == b"b" * 10
        assert (begun + answer.read()).count(b"a") == LARGE
        connection.close()


def test_what_is_no_archive_changes_nothing_and_is_complained_of_once(
    url: str, archive: Path, other: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "broken").write_bytes(other.read_bytes()[:-100])
    (tmp_path / "broken").replace(archive)
    with caplog.at_level(logging.WARNING, "farfield.serve"):
        for _ in range(3):
            assert httpx.get(url + TILE).content == b"a" * 10
    assert len([record for record in caplog.records if "cut short" in record.getMessage()]) == 1
    archive.unlink()
    assert httpx.get(url + TILE).content == b"a" * 10
    other.replace(archive)
    assert httpx.get(url + TILE).content == b"b" * 10


def test_an_archive_that_is_written_over_is_not_read_until_it_is_whole(url: str, archive: Path, other: Path) -> None:
    """As `cp` does it: the file that is open is no longer what its directories say."""
    with other.open("rb") as source, archive.open("r+b") as target:
        target.write(source.read(1_500_000))
        target.flush()
        for key in (KEY, TILE, BIG):
            assert httpx.get(url + key).status_code == 503
        shutil.copyfileobj(source, target)
        target.truncate()
    assert httpx.get(url + TILE).content == b"b" * 10
    assert httpx.get(url + BIG).content == b"b" * 2_000_000


def test_folders_are_left_as_they_are(real_world: Store) -> None:
    assert Served(real_world).now() is real_world


def test_an_open_archive_that_is_written_over_gives_errors_and_no_bytes(archive: Path, real_world: Store) -> None:
    store = write_archive(archive, values(real_world, "a"))
    assert store.get_range(TILE, 0, 3) == b"aaa"
    with archive.open("r+b") as file:
        file.seek(0, 2)
        file.write(b"more")
    for read in (lambda: store.get(TILE), lambda: store.get_range(TILE, 0, 3)):
        with pytest.raises(StoreError, match="was changed while it was open"):
            read()
