"""What only a store on a disk can meet: full disks, permissions, links, killed writers."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from farfield.errors import MissingKeyError, NotAWorldError, StoreError
from farfield.store import DirectoryStore, open_store
from farfield.store.directory import INCOMING, STALE_SECONDS


def _failing(code: int):
    def fsync(_: int) -> None:
        raise OSError(code, os.strerror(code))

    return fsync


@pytest.mark.parametrize(
    ("code", "hint"),
    [
        (errno.ENOSPC, "free some space"),
        (errno.EROFS, "read-only"),
        (errno.EACCES, "who may read"),
        (errno.EIO, "fault"),
    ],
)
def test_a_failing_disk_says_what_where_and_what_to_try(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, hint: str
) -> None:
    store = DirectoryStore(tmp_path)
    store.put("a/b", b"kept")
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", _failing(code))
        for key in ("a/b", "a/c"):
            with pytest.raises(StoreError) as caught:
                store.put(key, b"lost")
            assert hint in caught.value.hint
            assert str(tmp_path) in caught.value.where
            assert key in caught.value.where
    assert store.get("a/b") == b"kept"
    assert list(store.list()) == ["a/b"]
    assert list((tmp_path / INCOMING).iterdir()) == []


def test_an_interrupted_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        DirectoryStore(tmp_path).put("a", b"lost")
    assert list((tmp_path / INCOMING).iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_really_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins

    ordinary = builtins.open
    monkeypatch.setattr(builtins, "open", lambda path, mode="r": ordinary("/dev/full" if "x" in mode else path, "wb"))
    with pytest.raises(StoreError, match="free some space"):
        DirectoryStore(tmp_path).put("a", b"x" * 100)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_one_may_not_write_in(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(StoreError, match="who may read and write"):
        DirectoryStore(tmp_path).put("a", b"x")
    tmp_path.chmod(0o700)


def test_links_below_the_folder_are_not_followed(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.mkdir()
    (secret / "file").write_bytes(b"secret")
    world = tmp_path / "world"
    store = DirectoryStore(world)
    store.put("real", b"shown")
    (world / "file").symlink_to(secret / "file")
    (world / "folder").symlink_to(secret)
    (world / "inside").symlink_to(world / "real")
    for key in ("file", "folder/file", "inside"):
        assert not store.exists(key)
        with pytest.raises(MissingKeyError):
            store.get(key)
        with pytest.raises(MissingKeyError):
            store.get_range(key, 0, 1)
    assert list(store.list()) == ["real"]


def test_the_folder_itself_may_be_reached_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    store = DirectoryStore(tmp_path / "link")
    store.put("a/b", b"x")
    assert store.get("a/b") == b"x"
    assert (tmp_path / "real/a/b").read_bytes() == b"x"


def test_what_killed_writers_left_is_cleared_when_it_is_old(tmp_path: Path) -> None:
    incoming = tmp_path / INCOMING
    incoming.mkdir()
    for name, age in (("old", STALE_SECONDS + 60), ("young", 60)):
        (incoming / name).write_bytes(b"half")
        os.utime(incoming / name, (time.time() - age,) * 2)
    DirectoryStore(tmp_path).put("a", b"x")
    assert [entry.name for entry in incoming.iterdir()] == ["young"]


def test_a_writer_killed_at_any_moment_leaves_whole_values(tmp_path: Path) -> None:
    code = (
        "import sys; from farfield.store import DirectoryStore; store = DirectoryStore(sys.argv[1]);\n"
        "for i in range(10**9): store.put(f'a/{i % 50}', bytes([i % 256]) * 30000); i or print('go', flush=True)"
    )
    for delay in (0.01, 0.05, 0.1):
        with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            time.sleep(delay)
            writer.send_signal(signal.SIGKILL)
        store = DirectoryStore(tmp_path)
        for key in store.list():
            value = store.get(key)
            assert len(value) == 30000
            assert len(set(value)) == 1


def test_open_store_refuses_what_is_no_place_for_a_world(tmp_path: Path) -> None:
    with pytest.raises(NotAWorldError, match="no such folder"):
        open_store(tmp_path / "missing")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(NotAWorldError, match="a world is a folder"):
        open_store(tmp_path / "file", create=True)
    with pytest.raises(NotAWorldError, match="something other than a world"):
        open_store(tmp_path, create=True)
    open_store(tmp_path / "new", create=True).put("record/0/0/0/0", b"begun")
    open_store(tmp_path / "new", create=True).put("world.json", b"{}")
    assert open_store(tmp_path / "new").get("world.json") == b"{}"
