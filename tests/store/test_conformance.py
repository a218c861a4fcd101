"""One suite for every store: what `store.contract` promises."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from farfield.errors import MissingKeyError, OptionError, StoreError
from farfield.store import BucketStore, CachedStore, DirectoryStore, LatencyStore, MemoryStore, Store, is_key
from store.archives import ArchiveOnDemand

KINDS: dict[str, Callable[[Path], Store]] = {
    "directory": DirectoryStore,
    "memory": lambda _: MemoryStore(),
    "latency": lambda _: LatencyStore(MemoryStore(), 0.0001),
    "cached": lambda _: CachedStore(MemoryStore(), frozenset({"world.json"}), 1000),
    "archive": ArchiveOnDemand,
}
"""Kind → how one is made; a bucket besides, which needs a server."""

TILE = "orthoview/3/-1/0/-12/17/0-9f86d081884c7d65"

BAD_KEYS = [
    "",
    "/",
    "/world.json",
    "world.json/",
    "a//b",
    ".",
    "..",
    "a/../b",
    "a/./b",
    ".incoming/x",
    "a/.hidden",
    "a b",
    "a\\b",
    "a\0b",
    "a\n",
    "ä",
    "a:b",
    "%2e%2e/b",
    "x" * 201,
    "/".join(["segment"] * 100),
]


@pytest.fixture(params=[*KINDS, "bucket"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    if request.param == "bucket":
        return BucketStore(request.getfixturevalue("new_bucket")() + "/some/world")
    return KINDS[request.param](tmp_path / "world")


def _needs(store: Store, *unfit: type) -> None:
    """Skips kinds of stores that a test is not about."""
    if isinstance(store, unfit):
        pytest.skip("the contract excepts it")


def test_a_value_comes_back_as_it_was_put(store: Store) -> None:
    for data in (b"", b"\0\xff", bytes(range(256)) * 1000):
        store.put(TILE, data)
        assert store.get(TILE) == data
        assert store.size(TILE) == len(data)
        assert store.exists(TILE)


def test_a_later_value_takes_the_place_of_an_earlier_one(store: Store) -> None:
    store.put("world.json", b"one, the longer")
    store.put("world.json", b"two")
    assert store.get("world.json") == b"two"
    assert list(store.list()) == ["world.json"]


def test_what_is_missing_is_said_to_be_missing(store: Store) -> None:
    for act in (store.get, store.size, lambda key: store.get_range(key, 0, 1)):
        with pytest.raises(MissingKeyError) as caught:
            act(TILE)
        assert TILE in str(caught.value)
    assert not store.exists(TILE)
    store.delete(TILE)
    assert list(store.list()) == []
    assert list(store.list("orthoview/3")) == []


def test_a_folder_of_keys_is_no_value(store: Store) -> None:
    store.put(TILE, b"x")
    assert not store.exists("orthoview/3")
    for act in (store.get, store.size, lambda key: store.get_range(key, 0, 1)):
        with pytest.raises(MissingKeyError):
            act("orthoview/3")
    store.delete("orthoview/3")
    assert store.exists(TILE)


def test_a_key_is_never_both_a_value_and_a_folder(store: Store) -> None:
    _needs(store, BucketStore, ArchiveOnDemand)
    store.put("a/b", b"1")
    for key in ("a", "a/b/c", "a/b/c/d"):
        with pytest.raises(StoreError, match="folder of other keys"):
            store.put(key, b"2")
    assert list(store.list()) == ["a/b"]
    assert store.get("a/b") == b"1"


def test_a_folder_whose_keys_are_gone_is_gone(store: Store) -> None:
    store.put("a/b/c", b"1")
    store.put("a/b/d", b"1")
    store.delete("a/b/c")
    assert store.get("a/b/d") == b"1"
    store.delete("a/b/d")
    store.put("a", b"2")
    assert store.get("a") == b"2"


def test_ranges_end_where_the_value_ends(store: Store) -> None:
    store.put(TILE, b"0123456789")
    assert store.get_range(TILE, 0, 4) == b"0123"
    assert store.get_range(TILE, 7, 100) == b"789"
    assert store.get_range(TILE, 10, 1) == b""
    assert store.get_range(TILE, 99, 1) == b""
    assert store.get_range(TILE, 3, 0) == b""
    for start, length in ((-1, 2), (0, -1)):
        with pytest.raises(OptionError):
            store.get_range(TILE, start, length)


def test_list_gives_what_is_below_a_folder_in_order(store: Store) -> None:
    keys = ["world.json", "a/b", "a-b/c", "a/c/d", "ab/c", "index/0/-1/0/0-aa", "index/0/1/0/0-bb"]
    for key in keys:
        store.put(key, b"")
    ordered = sorted(keys, key=lambda key: key.split("/"))
    assert list(store.list()) == ordered
    assert list(store.list("a")) == ["a/b", "a/c/d"]
    assert list(store.list("a/")) == ["a/b", "a/c/d"]
    assert list(store.list("index/0")) == ["index/0/-1/0/0-aa", "index/0/1/0/0-bb"]
    assert list(store.list("world.json")) == []


@pytest.mark.parametrize("key", BAD_KEYS)
def test_what_is_no_key_is_refused(store: Store, key: str) -> None:
    assert not is_key(key)
    for act in (store.get, store.size, store.exists, store.delete, lambda key: store.put(key, b"")):
        with pytest.raises(StoreError, match="not a key"):
            act(key)


def test_every_kind_of_key_of_the_format_is_one() -> None:
    digest = "0123456789abcdef" * 4
    for key in (
        "world.json",
        TILE,
        f"objects/0/-123456/0/5/25/1-{digest}",
        f"geometry/0/-1/0/2-{digest}",
        f"mesh/{digest}",
        f"texture/{digest}",
        f"index/12/-1/0/0-{digest}",
        "record/0/-1/0/0",
        "index.html",
        "viewer/app-ABC_1.min.js",
    ):
        assert is_key(key)


def test_a_reader_beside_a_writer_sees_whole_values(store: Store) -> None:
    """Values of one repeated byte each: a mixture or a wrong length would show a torn write."""
    _needs(store, ArchiveOnDemand)
    store.put(TILE, bytes([0]) * 20_000)
    done = threading.Event()
    torn: list[bytes] = []

    def read() -> None:
        while not done.is_set():
            value = store.get(TILE)
            if len(value) != 20_000 or len(set(value)) != 1:
                torn.append(value)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    for turn in range(150):
        store.put(TILE, bytes([turn]) * 20_000)
    done.set()
    for reader in readers:
        reader.join()
    assert not torn


def test_writers_and_removers_of_one_folder_do_not_disturb_each_other(store: Store) -> None:
    _needs(store, ArchiveOnDemand)
    failures: list[BaseException] = []

    def work(name: str) -> None:
        try:
            for _ in range(100):
                store.put(f"a/b/{name}", name.encode())
                store.delete(f"a/b/{name}")
            store.put(f"a/b/{name}", name.encode())
        except BaseException as error:
            failures.append(error)

    workers = [threading.Thread(target=work, args=(name,)) for name in ("x", "y", "z")]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not failures
    assert list(store.list()) == ["a/b/x", "a/b/y", "a/b/z"]


def test_one_writer_at_a_time(store: Store) -> None:
    _needs(store, BucketStore)
    with store.writing():
        store.put("a", b"1")
        with pytest.raises(StoreError, match="another process is writing"), store.writing():
            pass
    with store.writing():
        store.put("a", b"2")
    assert store.get("a") == b"2"
