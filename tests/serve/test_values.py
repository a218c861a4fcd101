"""Single values: types, caching, conditional requests, ranges, gzip; what is private stays private."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from farfield.errors import StoreError
from farfield.serve.app import create_app
from farfield.store import MemoryStore, Store
from serve.small_world import BIG, MANIFEST, PAGE, PNG, TILE, VALUES


def test_what_has_a_hash_may_be_kept_for_ever(client: TestClient) -> None:
    answer = client.get(f"/{TILE}")
    assert answer.status_code == 200
    assert answer.content == VALUES[TILE]
    assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert answer.headers["content-length"] == str(len(VALUES[TILE]))
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["access-control-allow-origin"] == "*"
    assert answer.headers["x-content-type-options"] == "nosniff"
    again = client.get(f"/{TILE}", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    assert again.content == b""


def test_the_manifest_is_asked_for_again_and_names_the_batch(client: TestClient, world: Store) -> None:
    answer = client.get("/world.json")
    assert answer.content == MANIFEST
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["cache-control"] == "no-cache"
    assert answer.headers["farfield-batch"] == "batch"
    assert "Farfield-Batch" in answer.headers["access-control-expose-headers"]
    tag = {"If-None-Match": f'"other", W/{answer.headers["etag"]}'}
    assert client.get("/world.json", headers=tag).status_code == 304
    world.put("world.json", b"{}")
    assert client.get("/world.json", headers=tag).content == b"{}"


def test_what_is_not_packed_is_for_those_who_can_unpack_it(client: TestClient) -> None:
    for address in ("/world.json", "/viewer/app.js", "/viewer/draco/decoder.wasm", "/attributes/3333333333333333"):
        plain = client.get(address, headers={"Accept-Encoding": "identity"})
        packed = client.get(address, headers={"Accept-Encoding": "br, gzip;q=0.5"})
        assert "content-encoding" not in plain.headers
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.content == plain.content
        assert int(packed.headers["content-length"]) < len(plain.content) / 4
        assert packed.headers["etag"] != plain.headers["etag"]
        assert packed.headers["vary"] == "Accept-Encoding"
        assert client.get(address, headers={"If-None-Match": packed.headers["etag"]}).status_code == 304
    for offer in ("gzip;q=0", "identity", "gzip;q=0.0, br", ""):
        assert "content-encoding" not in client.get("/world.json", headers={"Accept-Encoding": offer}).headers
    assert "content-encoding" not in client.get(f"/{TILE}", headers={"Accept-Encoding": "gzip"}).headers


@pytest.mark.parametrize(
    ("key", "kind"),
    [
        (PNG, "image/png"),
        ("texture/00000000000000bb", "application/octet-stream"),
        ("geometry/0/-1/0/0-1111111111111111", "application/octet-stream"),
        (BIG, "application/octet-stream"),
        ("index/3/-1/0/0-2222222222222222", "application/octet-stream"),
        ("attributes/3333333333333333", "application/json"),
        ("", "text/html; charset=utf-8"),
        ("index.html", "text/html; charset=utf-8"),
        ("viewer/app.js", "text/javascript; charset=utf-8"),
    ],
)
def test_types(client: TestClient, key: str, kind: str) -> None:
    assert client.get(f"/{key}").headers["content-type"] == kind


@pytest.mark.parametrize(
    ("wanted", "start", "end"),
    [
        ("bytes=0-0", 0, 1),
        ("bytes=5-9", 5, 10),
        ("bytes=2550-", 2550, 2560),
        ("bytes=-3", 2557, 2560),
        ("bytes=2000-999999", 2000, 2560),
        ("bytes=-99999", 0, 2560),
        ("bytes=0-999999999999999999", 0, 2560),
    ],
)
def test_one_range(client: TestClient, wanted: str, start: int, end: int) -> None:
    answer = client.get(f"/{TILE}", headers={"Range": wanted})
    assert answer.status_code == 206
    assert answer.content == VALUES[TILE][start:end]
    assert answer.headers["content-range"] == f"bytes {start}-{end - 1}/2560"
    assert answer.headers["content-length"] == str(end - start)


@pytest.mark.parametrize("wanted", ["bytes=2560-", "bytes=9999-10000", "bytes=-0"])
def test_a_range_beyond_the_end(client: TestClient, wanted: str) -> None:
    answer = client.get(f"/{TILE}", headers={"Range": wanted})
    assert answer.status_code == 416
    assert answer.headers["content-range"] == "bytes */2560"


@pytest.mark.parametrize(
    "wanted",
    [
        "bytes=5-4",
        "bytes=-",
        "bytes=a-b",
        "lines=0-1",
        "bytes=0-1,4-5",
        "bytes=" + ",".join(["0-"] * 1000),
        "bytes=0-0-0",
        b"bytes=\xd9\xa3-\xd9\xa4",
        "bytes=" + "9" * 30 + "-",
    ],
)
def test_what_is_no_single_range_gets_the_whole(client: TestClient, wanted: str) -> None:
    answer = client.get(f"/{TILE}", headers={"Range": wanted})
    assert answer.status_code == 200
    assert answer.content == VALUES[TILE]


def test_a_range_of_another_version_gets_the_whole(client: TestClient) -> None:
    tag = client.get("/world.json", headers={"Accept-Encoding": "identity"}).headers["etag"]
    same = client.get("/world.json", headers={"Range": "bytes=0-4", "If-Range": tag})
    assert (same.status_code, same.content) == (206, MANIFEST[:5])
    other = client.get("/world.json", headers={"Range": "bytes=0-4", "If-Range": '"other"'})
    assert (other.status_code, other.content) == (200, MANIFEST)


def test_head_tells_all_but_the_value(client: TestClient) -> None:
    for key in (TILE, BIG, "world.json", "index.html"):
        whole, head = client.get(f"/{key}"), client.head(f"/{key}")
        assert head.status_code == 200
        assert head.content == b""
        for name in ("content-length", "etag", "content-type", "cache-control"):
            assert head.headers[name] == whole.headers[name]
    assert client.head("/missing").status_code == 404


def test_large_values_arrive_whole(client: TestClient) -> None:
    assert client.get(f"/{BIG}").content == VALUES[BIG]
    part = client.get(f"/{BIG}", headers={"Range": "bytes=100000-900000"})
    assert part.content == VALUES[BIG][100000:900001]


@pytest.mark.parametrize(
    "address",
    [
        "/record/0/-1/0/0",
        "/notes.txt",
        "/missing",
        "/orthoview",
        "/orthoview/3/-1/0/-12/17/",
        "/orthoview/3/-1/0/-12/17/0-fedcba9876543210",
        "/.incoming/0123456789abcdef",
        "/../world/world.json",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2fetc%2fpasswd",
        "/%252e%252e%252fetc%252fpasswd",
        "/viewer/../record/0/-1/0/0",
        "/viewer/%2e%2e/record/0/-1/0/0",
        "/viewer/..%5c..%5cworld.json",
        "/.//world.json",
        "/.//etc/passwd",
        "/etc/passwd",
        "/world.json%00",
        "/world.json%00.png",
        "/world.json/",
        "/world.json%0a",
        "/world.json;x",
        "/w%C3%B6rld.json",
        "/%ff%fe",
        "/" + "a" * 3000,
        "/" + "a/" * 3000 + "0123456789abcdef",
        "/batch/",
        "/file:///etc/passwd",
    ],
)
def test_nothing_else_is_reachable(client: TestClient, address: str) -> None:
    answer = client.get(address)
    assert answer.status_code == 404
    assert b"private" not in answer.content


def test_links_out_of_the_world_lead_nowhere(client: TestClient, tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"private")
    name = "mesh/aaaaaaaaaaaaaaaa"
    os.symlink(tmp_path / "secret", tmp_path / "world" / name)
    os.symlink("/etc", tmp_path / "world/viewer")
    assert client.get(f"/{name}").status_code == 404
    assert client.get("/viewer/passwd").status_code == 404
    assert client.get(f"/batch?key={name}").content == b"\xff\xff\xff\xff"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "TRACE", "CONNECT", "BREW"])
def test_the_world_cannot_be_written(client: TestClient, method: str) -> None:
    answer = client.request(method, f"/{TILE}", content=b"x")
    assert answer.status_code == 405
    assert "GET" in answer.headers["allow"]


def test_pages_of_other_origins_may_read(client: TestClient) -> None:
    answer = client.options("/batch", headers={"Origin": "https://a.example", "Access-Control-Request-Method": "POST"})
    assert answer.status_code == 204
    assert answer.headers["access-control-allow-origin"] == "*"
    assert "POST" in answer.headers["access-control-allow-methods"]
    assert "Range" in answer.headers["access-control-allow-headers"]
    # Without an Origin too: what a browser caches for ever must do for a page elsewhere as well.
    for address in (f"/{TILE}", "/missing", "/" + "a" * 20000):
        assert client.get(address).headers["access-control-allow-origin"] == "*"


def test_an_address_too_long(client: TestClient) -> None:
    assert client.get("/batch?key=" + "a" * 20000).status_code == 414


def test_a_farfield_without_the_viewer_says_so(world: Store) -> None:
    client = TestClient(create_app(world, MemoryStore()))
    answer = client.get("/")
    assert answer.status_code == 404
    assert "make viewer" in answer.text
    world.put("index.html", b"the world's own")
    assert client.get("/").content == b"the world's own"


def test_the_viewer_of_this_version_comes_before_the_worlds_own(client: TestClient, world: Store) -> None:
    world.put("index.html", b"old")
    assert client.get("/").content == PAGE["index.html"]


def test_a_failing_store_is_not_told_to_the_public(caplog: pytest.LogCaptureFixture) -> None:
    class Broken(MemoryStore):
        def get(self, key: str) -> bytes:
            raise StoreError("cannot be read: input/output error", "/secret/place")

    answer = TestClient(create_app(Broken(), MemoryStore())).get("/world.json")
    assert answer.status_code == 503
    assert "secret" not in answer.text
    assert "/secret/place" in caplog.text
