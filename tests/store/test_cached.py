"""A server in front of a far store asks it once for each value, and for the manifest each time."""

from __future__ import annotations

from starlette.testclient import TestClient

from farfield.serve.app import create_app
from farfield.store import CachedStore, MemoryStore


class Counted(MemoryStore):
    """Notes what is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[str] = []

    def get(self, key: str) -> bytes:
        self.asked.append(key)
        return super().get(key)


def test_a_served_value_is_one_request() -> None:
    inner = Counted()
    keys = [f"orthoview/0/{n}/0/0/22/0-000000000000000{n}" for n in range(8)]
    for key in keys:
        inner.put(key, b"x" * 600_000)
    inner.put("world.json", b"{}")
    client = TestClient(create_app(CachedStore(inner, frozenset({"world.json"})), MemoryStore()))
    assert client.get("/" + keys[0]).content == inner._values[keys[0]]
    assert len(client.get("/batch", params={"key": keys}).content) == 8 * 600_004
    assert sorted(inner.asked) == sorted(keys)
    for generation in (b"{}", b"{ }"):
        inner.put("world.json", generation)
        assert client.get("/world.json").content == generation


def test_what_is_kept_is_bounded_and_the_longest_unused_goes() -> None:
    inner = Counted()
    store = CachedStore(inner, frozenset(), 250)
    for key in "abcd":
        inner.put(key, key.encode() * 100)
    for key in "abacda":
        store.get(key)
    assert "".join(inner.asked) == "abcda"
    inner.put("large", b"x" * 251)
    assert [store.size("large"), store.size("large")] == [251, 251]
    assert inner.asked[-2:] == ["large", "large"]


def test_what_is_written_through_it_is_seen() -> None:
    store = CachedStore(MemoryStore(), frozenset())
    for data in (b"1", b"2"):
        store.put("a", data)
        assert store.get("a") == data
    store.delete("a")
    assert not store.exists("a")
