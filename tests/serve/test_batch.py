"""Several values in one request."""

from __future__ import annotations

import struct

import pytest
from starlette.testclient import TestClient

from farfield.serve import batch
from farfield.store import Store
from serve.small_world import BIG, TILE, VALUES

INDEX = "index/3/-1/0/0-2222222222222222"


def frames(body: bytes) -> list[bytes | int]:
    """Values in order, or MISSING."""
    found: list[bytes | int] = []
    at = 0
    while at < len(body):
        (length,) = struct.unpack_from("<I", body, at)
        at += 4
        if length == batch.MISSING:
            found.append(length)
        else:
            assert at + length <= len(body)
            found.append(body[at : at + length])
            at += length
    return found


def test_values_in_the_order_of_their_keys(client: TestClient) -> None:
    keys = [TILE, "mesh/aaaaaaaaaaaaaaaa", INDEX, BIG, TILE]
    wanted = [VALUES[TILE], batch.MISSING, VALUES[INDEX], VALUES[BIG], VALUES[TILE]]
    for answer in (client.get("/batch", params={"key": keys}), client.post("/batch", json=keys)):
        assert answer.status_code == 200
        assert answer.headers["content-type"] == "application/vnd.farfield.batch"
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["content-length"] == str(len(answer.content))
        assert frames(answer.content) == wanted


def test_what_is_whole_and_hashed_may_be_kept(client: TestClient) -> None:
    assert "immutable" in client.get("/batch", params={"key": [TILE, INDEX]}).headers["cache-control"]
    assert client.get("/batch", params={"key": [TILE, "world.json"]}).headers["cache-control"] == "no-store"
    assert client.post("/batch", json=[TILE]).headers["cache-control"] == "no-store"


def test_empty_values_are_not_missing(client: TestClient, world: Store) -> None:
    world.put("mesh/bbbbbbbbbbbbbbbb", b"")
    assert frames(client.post("/batch", json=["mesh/bbbbbbbbbbbbbbbb"] * 2).content) == [b"", b""]


def test_private_and_impossible_keys_are_missing(client: TestClient) -> None:
    keys = ["record/0/-1/0/0", "notes.txt", "../world.json", "/world.json", "", "a\0b", "ü", "index.html", "x" * 9000]
    assert frames(client.post("/batch", json=keys).content) == [batch.MISSING] * len(keys)


def test_the_size_of_an_answer_is_limited(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "MAX_BYTES", 6000)
    assert client.post("/batch", json=[TILE, TILE]).status_code == 200
    refused = client.post("/batch", json=[TILE, TILE, TILE])
    assert refused.status_code == 413
    assert "7680 bytes" in refused.text
    assert frames(client.post("/batch", json=[BIG]).content) == [VALUES[BIG]]


def test_head(client: TestClient) -> None:
    head = client.head("/batch", params={"key": [TILE]})
    assert head.content == b""
    assert head.headers["content-length"] == str(4 + len(VALUES[TILE]))


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b"{}",
        b"null",
        b"[1]",
        b'["a',
        b"\xff",
        b'"world.json"',
        b"[" * 50000,
        b'["' + b"a" * 200_000 + b'"]',
        b"[" + b",".join([b'"a"'] * 129) + b"]",
    ],
)
def test_what_is_no_list_of_keys_is_refused(client: TestClient, body: bytes) -> None:
    assert client.post("/batch", content=body).status_code == 400


def test_the_number_of_keys_is_limited(client: TestClient) -> None:
    assert client.get("/batch").status_code == 400
    assert client.get("/batch", params={"key": ["a"] * 129}).status_code == 400
    assert len(frames(client.get("/batch", params={"key": [TILE] * 128}).content)) == 128


def test_other_methods_are_refused(client: TestClient) -> None:
    assert client.put("/batch", json=[TILE]).status_code == 405
