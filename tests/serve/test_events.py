"""Server-sent events: every new manifest, to many, slow and vanishing clients, and a clean end."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from typing import Any
from urllib.parse import urlsplit

import httpx2 as httpx
import msgspec
import pytest

from farfield.serve import events, watch
from farfield.serve.events import GenerationFeed
from farfield.serve.run import ServeOptions, serving
from farfield.serve.served import Served
from farfield.serve.watch import ManifestWatch
from farfield.store import CachedStore, DirectoryStore, MemoryStore, Store
from farfield.world.manifest import KEY, decode_manifest, encode_manifest
from serve.small_world import filled


def publish(world: Store, generation: int) -> None:
    """Replaces the manifest by one of that generation."""
    manifest = decode_manifest(world.get(KEY), world.location)
    world.put(KEY, encode_manifest(msgspec.structs.replace(manifest, generation=generation)))


@contextmanager
def listening(url: str) -> Iterator[Iterator[str]]:
    """The lines of an event stream."""
    with httpx.stream("GET", f"{url}events", timeout=10) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
        assert answer.headers["cache-control"] == "no-store"
        yield answer.iter_lines()


def next_event(lines: Iterator[str]) -> dict[str, Any]:
    for line in lines:
        if line.startswith("data: "):
            found: dict[str, Any] = json.loads(line[6:])
            return found
    raise AssertionError("the stream has ended")


def next_generation(lines: Iterator[str]) -> int:
    found: int = next_event(lines)["generation"]
    return found


@pytest.fixture
def url(real_world: Store) -> Iterator[str]:
    with serving(real_world, ServeOptions(port=0)) as address:
        yield address


def test_tells_the_generation_and_every_new_one(url: str, real_world: Store) -> None:
    manifest = httpx.get(url + "world.json")
    assert manifest.headers["farfield-events"] == "events"
    assert manifest.headers["cache-control"] == "no-cache"
    with listening(url) as lines:
        assert next_generation(lines) == 1
        for generation in (2, 3, 7):
            publish(real_world, generation)
            begun = time.monotonic()
            assert next_generation(lines) == generation
            assert time.monotonic() - begun < 1.5, "0.3 s on a machine of our own"
    publish(real_world, 8)
    with listening(url) as lines:
        assert next_generation(lines) == 8, "what happened while nobody listened"


def test_a_world_baked_from_nothing_is_another_of_the_same_generation(url: str, real_world: Store) -> None:
    manifest = decode_manifest(real_world.get(KEY), "")
    with listening(url) as lines:
        events = [next_event(lines)]
        for name in ("second", "third"):
            real_world.put(KEY, encode_manifest(msgspec.structs.replace(manifest, name=name)))
            events.append(next_event(lines))
            assert (
                httpx.get(url + "world.json").headers["etag"].removesuffix('-gz"').strip('"') == events[-1]["manifest"]
            )
    assert [event["generation"] for event in events] == [1, 1, 1]
    assert len({event["manifest"] for event in events}) == 3


def test_a_world_that_is_gone_for_a_while_is_complained_of_once(
    url: str, real_world: Store, caplog: pytest.LogCaptureFixture
) -> None:
    with listening(url) as lines:
        assert next_generation(lines) == 1
        manifest = real_world.get(KEY)
        real_world.delete(KEY)
        time.sleep(4 * watch.FILE_SECONDS)
        real_world.put(KEY, manifest)
        publish(real_world, 2)
        assert next_generation(lines) == 2
    assert [record.getMessage() for record in caplog.records if "nothing is stored" in record.getMessage()] == [
        f"{real_world.location}: {KEY}: nothing is stored there"
    ]


def test_a_manifest_that_cannot_be_read_is_no_news(url: str, real_world: Store) -> None:
    good = real_world.get(KEY)
    with listening(url) as lines:
        assert next_generation(lines) == 1
        real_world.put(KEY, b"{}")
        time.sleep(0.6)
        real_world.delete(KEY)
        time.sleep(0.6)
        real_world.put(KEY, good)
        publish(real_world, 2)
        assert next_generation(lines) == 2


def test_a_head_holds_no_connection(url: str) -> None:
    answer = httpx.head(url + "events")
    assert (answer.status_code, answer.content) == (200, b"")


def test_says_between_events_that_it_is_there(real_world: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GenerationFeed.__init__, "__kwdefaults__", {"max_listeners": 3, "heartbeat_seconds": 0.1})
    with serving(real_world, ServeOptions(port=0)) as url, listening(url) as lines:
        assert next_generation(lines) == 1
        assert [next(lines) for _ in range(4)] == ["", ": still here", "", ": still here"]


def test_listeners_are_limited_and_make_room_again(real_world: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GenerationFeed.__init__, "__kwdefaults__", {"max_listeners": 20, "heartbeat_seconds": 0.1})
    with serving(real_world, ServeOptions(port=0)) as url:
        with ExitStack() as stack:
            streams = [stack.enter_context(listening(url)) for _ in range(20)]
            assert [next_generation(lines) for lines in streams] == [1] * 20
            refused = httpx.get(url + "events")
            assert (refused.status_code, refused.headers["retry-after"]) == (503, "30")
            assert httpx.get(url + "world.json").status_code == 200
            publish(real_world, 2)
            assert [next_generation(lines) for lines in streams] == [2] * 20
        deadline = time.monotonic() + 5
        while httpx.head(url + "world.json") and time.monotonic() < deadline:
            with httpx.stream("GET", url + "events") as answer:
                if answer.status_code == 200:
                    return
        pytest.fail("those who left still count")


def test_a_client_that_does_not_read_hinders_nobody(url: str, real_world: Store) -> None:
    parts = urlsplit(url)
    with closing(socket.create_connection((parts.hostname, parts.port))) as deaf, listening(url) as lines:  # type: ignore[arg-type]
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        deaf.sendall(b"GET /events HTTP/1.1\r\nHost: a\r\n\r\n")
        assert next_generation(lines) == 1
        for generation in range(2, 5):
            publish(real_world, generation)
            assert next_generation(lines) == generation


def test_the_server_ends_at_once_while_somebody_listens(real_world: Store) -> None:
    with ExitStack() as stack:
        with serving(real_world, ServeOptions(port=0)) as url:
            streams = [stack.enter_context(listening(url)) for _ in range(3)]
            assert [next_generation(lines) for lines in streams] == [1, 1, 1]
            begun = time.monotonic()
        assert time.monotonic() - begun < 2
        with pytest.raises(httpx.TransportError):
            next_generation(streams[0])


def test_a_busy_listener_hears_the_newest_only_and_nobody_looks_for_nobody(real_world: Store) -> None:
    async def hear() -> list[bytes]:
        feed = GenerationFeed(Served(real_world))
        assert feed.join()
        lines = feed.lines()
        heard = [await anext(lines), await anext(lines)]
        for generation in (2, 3):
            publish(real_world, generation)
            await asyncio.sleep(0.6)
        heard.append(await anext(lines))
        feed.leave()
        await asyncio.sleep(0)
        assert (feed.listeners, len(asyncio.all_tasks())) == (0, 1)
        await lines.aclose()
        return heard

    # In a thread of its own: Playwright keeps a loop running in the main one once a browser has been open.
    with ThreadPoolExecutor(1) as thread:
        retry, first, last = thread.submit(asyncio.run, hear()).result()
    assert retry == b"retry: %d\n\n" % events.RETRY_MS
    for generation, event in ((1, first), (3, last)):
        number, kind, data, *rest = event.decode().split("\n")
        assert (kind, rest) == ("event: generation", ["", ""])
        facts = json.loads(data.removeprefix("data: "))
        assert facts == {"generation": generation, "manifest": number.removeprefix("id: ")}


def test_looks_at_a_folder_by_its_file_and_at_others_by_their_bytes(
    real_world: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = filled(MemoryStore(), {KEY: real_world.get(KEY)})
    # As `farfield serve` has buckets: everything is kept but the manifest.
    cached = CachedStore(far, frozenset({KEY}))
    for world, writer in ((real_world, real_world), (far, far), (cached, far)):
        publish(writer, 1)
        seen = ManifestWatch(Served(world))
        first, again = seen.look(), seen.look()
        assert (first and first.generation, again) == (1, None)
        publish(writer, 2)
        second, again = seen.look(), seen.look()
        assert (second and second.generation, again) == (2, None)
        seen.forget()
        assert seen.look() == second
    folder, bucket = ManifestWatch(Served(real_world)), ManifestWatch(Served(cached))
    assert folder.pause_seconds == watch.FILE_SECONDS < bucket.pause_seconds

    folder.look()
    monkeypatch.setattr(DirectoryStore, "get", lambda *_: pytest.fail("read although nothing has changed"))
    assert folder.look() is None
