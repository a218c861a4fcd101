"""What only a bucket can meet: no bucket, no server, no credentials, no package."""

from __future__ import annotations

import pickle
import sys
import time
import urllib.request
from collections.abc import Callable

import pytest

from farfield.errors import FarfieldError, MissingExtraError, MissingKeyError, NotAWorldError, StoreError
from farfield.store import BucketStore, open_store
from farfield.store.bucket import fail
from s3_server import environment

PATIENCE = 20.0
"""Seconds within which a place that cannot be reached is given up; 1 s on an idle machine."""


def test_a_bucket_that_is_not_there(new_bucket: Callable[[], str]) -> None:
    new_bucket()
    store = open_store("s3://no-such-bucket/world")
    acts = (lambda: store.get("world.json"), lambda: store.put("a", b""), lambda: list(store.list()))
    for act in (*acts, lambda: open_store("s3://no-such-bucket/world", create=True)):
        with pytest.raises(StoreError, match=r"s3://no-such-bucket/world: there is no such bucket") as caught:
            act()
        assert not isinstance(caught.value, MissingKeyError)


def test_a_server_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("obstore")
    for name, value in environment("http://127.0.0.1:1").items():
        monkeypatch.setenv(name, value)
    begun = time.monotonic()
    with pytest.raises(StoreError, match=r"s3://some/world: world.json: cannot be read: .*127\.0\.0\.1:1") as caught:
        BucketStore("s3://some/world").get("world.json")
    assert "AWS_" in caught.value.hint
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begun < PATIENCE


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("Error performing PUT http://169.254.169.254/latest/api/token in 4ms - refused", "no credentials"),
        ("Generic MicrosoftAzure error: Account must be specified", "no credentials"),
        (
            "Server returned non-2xx status code: 500: oh\n\nDebug source:\nGeneric {",
            "cannot be read: .*: oh .check the",
        ),
    ],
)
def test_what_services_say_is_put_in_one_line(said: str, message: str) -> None:
    with pytest.raises(StoreError, match=message) as caught:
        fail(OSError(said), "az://some/world", "world.json", "cannot be read")
    assert "AZURE_" in caught.value.hint
    assert "Debug" not in str(caught.value)


def test_an_account_that_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("obstore")
    monkeypatch.delenv("AZURE_STORAGE_ACCOUNT_NAME", raising=False)
    with pytest.raises(StoreError, match="no credentials"):
        open_store("az://some/world")


@pytest.mark.parametrize("url", ["s3://", "s3:///world", "gs://"])
def test_urls_that_name_no_bucket(url: str) -> None:
    pytest.importorskip("obstore")
    with pytest.raises(StoreError, match="names no bucket"):
        open_store(url)


def test_urls_of_another_kind() -> None:
    with pytest.raises(NotAWorldError, match="not read from ftp://"):
        open_store("ftp://some/world")


def test_an_archive_in_a_bucket_is_for_the_page() -> None:
    for create in (False, True):
        with pytest.raises(NotAWorldError, match="archives are not read or written in buckets"):
            open_store("s3://some/world.farfield", create=create)


def test_the_extra_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "obstore.store", None)
    with pytest.raises(MissingExtraError, match=r"farfield\[cloud\]"):
        open_store("s3://some/world")


def test_a_worker_process_may_have_it(new_bucket: Callable[[], str]) -> None:
    store = BucketStore(new_bucket() + "/world")
    store.put("a/b", b"x")
    assert pickle.loads(pickle.dumps(store)).get("a/b") == b"x"


def test_a_bucket_cannot_say_who_writes(new_bucket: Callable[[], str]) -> None:
    store = BucketStore(new_bucket())
    with store.writing(), store.writing():
        store.put("a", b"")


def test_worlds_beside_each_other_do_not_mix(new_bucket: Callable[[], str]) -> None:
    bucket = new_bucket()
    one, other = BucketStore(f"{bucket}/one"), BucketStore(f"{bucket}/one-more/")
    one.put("a", b"1")
    other.put("b", b"2")
    assert list(one.list()) == ["a"]
    assert list(other.list()) == ["b"]
    assert other.location == f"{bucket}/one-more"


def test_what_others_put_there_is_no_key(new_bucket: Callable[[], str], s3_address: str) -> None:
    bucket = new_bucket()
    address = f"{s3_address}/{bucket.removeprefix('s3://')}/world/a%20name"
    urllib.request.urlopen(urllib.request.Request(address, method="PUT", data=b"x")).close()
    assert list(BucketStore(f"{bucket}/world").list()) == []


def test_a_browser_is_told_what_the_page_is(new_bucket: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    store = BucketStore(f"{new_bucket()}/world")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    from obstore.store import from_url

    for key, kind in (
        ("index.html", "text/html"),
        ("viewer/app.js", "text/javascript"),
        ("world.json", "application/json"),
    ):
        store.put(key, b"x")
        assert from_url(store.location).get(key).attributes["Content-Type"].startswith(kind)


def test_where_a_world_may_be_made(new_bucket: Callable[[], str]) -> None:
    bucket = new_bucket()
    open_store(f"{bucket}/new", create=True)
    for sign in ("world.json", "record/0/0/0/0", "index/0/0/0/0-aa"):
        place = f"{bucket}/{sign[:5]}"
        BucketStore(place).put(sign, b"{}")
        open_store(place, create=True)
    BucketStore(f"{bucket}/other").put("photos/cat.png", b"x")
    with pytest.raises(NotAWorldError, match="something other than a world"):
        open_store(f"{bucket}/other", create=True)


def test_nothing_is_asked_before_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("obstore")
    for name, value in environment("http://127.0.0.1:1").items():
        monkeypatch.setenv(name, value)
    with pytest.raises(FarfieldError, match="not a key"):
        BucketStore("s3://some/world").get("../x")
