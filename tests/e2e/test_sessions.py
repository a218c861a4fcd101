"""Sessions in which the server decides what to send, in the page (spec/stream.md)."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from playwright.sync_api import WebSocketRoute

from e2e.browsing import Visit, differing
from e2e.conftest import Stream
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore

EYE, TARGET = (-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)
ELSEWHERE = (45.0, 10.0, 8.0), (0.0, 0.0, 2.0)
SETTINGS = {"supersampling": 1, "nearRadius": 20, "farGeometry": False, "fade": 0}


def in_session(page: Visit) -> None:
    """Waits until the server decides."""
    page.page.wait_for_function("farfield.stats().session", timeout=20_000)


def test_what_the_picture_needs_comes_by_a_session_and_the_picture_is_the_same(
    address: str, visit: Callable[..., Visit]
) -> None:
    pictures = []
    for query in ("", "?sessions=0"):
        page = visit(address + query)
        page.options(**SETTINGS)
        if not query:
            in_session(page)
        before = page.stats()
        page.look(EYE, TARGET)
        page.look(*ELSEWHERE)
        stats = page.stats()
        assert stats["tiles_missing"] == stats["tiles_pending"] == 0
        assert stats["session"] is (not query)
        came, pushed = stats["bytes"] - before["bytes"], stats["pushed_bytes"] - before["pushed_bytes"]
        # What adds least a session never brings.
        assert pushed > 0.3 * came if not query else pushed == 0, (pushed, came)
        # What both choose at the same time.
        assert len(page.fetched) <= 1.1 * len(set(page.fetched))
        pictures.append(page.picture())
    assert differing(*pictures) < 1e-4


def test_the_panel_tells_of_the_session(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.page.get_by_label("Show figures and controls").click()
    in_session(page)
    page.says("by a session")
    page.options(sessions=False)
    assert page.stats()["session"] is False
    page.says("ended")
    page.options(sessions=True)
    in_session(page)


def test_a_server_that_is_started_again_is_asked_for_what_is_not_held(
    world: DirectoryStore, visit: Callable[..., Visit]
) -> None:
    with serving(world, ServeOptions(port=0)) as url:
        page = visit(url, expect_errors=True)
        page.options(**SETTINGS)
        in_session(page)
        page.look(EYE, TARGET)
        before = page.stats()["pushed_bytes"]
        port = int(url.rstrip("/").rsplit(":", 1)[1])
    page.do("camera => farfield.setCamera(camera)", {"eye": ELSEWHERE[0], "target": ELSEWHERE[1]})
    assert before > 0
    with serving(world, ServeOptions(port=port)):
        page.complete()
        in_session(page)
        page.look(EYE, TARGET)
        assert page.stats()["tiles_missing"] == 0
        assert len(page.fetched) <= 1.1 * len(set(page.fetched)), "nothing of what was held comes again"


def test_nothing_is_sent_to_a_page_that_nobody_sees(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    in_session(page)
    hide = "hidden => { Object.defineProperty(document, 'hidden', {value: hidden, configurable: true}); "
    hide += "document.dispatchEvent(new Event('visibilitychange')); }"
    page.do(hide, True)
    assert page.stats()["session"] is False
    page.do(hide, False)
    in_session(page)


def _says_nothing(_: WebSocketRoute) -> None:
    """Takes all and answers nothing."""


def _refuses(socket: WebSocketRoute) -> None:
    socket.close(code=1008, reason="the token is another")


def _talks_nonsense(socket: WebSocketRoute) -> None:
    socket.on_message(lambda _: socket.send('{"type":"value","key":"../../secret","number":-1,"bytes":1e300}'))


def _welcomes_and_is_silent(socket: WebSocketRoute) -> None:
    socket.on_message(lambda message: _welcome(socket) if "hello" in str(message) else None)


def _welcome(socket: WebSocketRoute) -> None:
    socket.send('{"type":"welcome","version":1,"generation":1,"piece":16384}')


@pytest.mark.parametrize("serve", [_says_nothing, _refuses, _talks_nonsense, _welcomes_and_is_silent])
def test_a_page_goes_on_by_itself_whatever_a_session_does(
    address: str, visit: Callable[..., Visit], serve: Stream
) -> None:
    page = visit(address, stream=serve)
    page.options(**SETTINGS)
    page.look(EYE, TARGET)
    stats = page.stats()
    assert stats["tiles_missing"] == stats["tiles_pending"] == 0
    assert stats["splats"] + stats["triangles"] > 500


def test_damaged_values_are_asked_for(address: str, world: DirectoryStore, visit: Callable[..., Visit]) -> None:
    keys = sorted(world.list("orthoview/"))

    def serve(socket: WebSocketRoute) -> None:
        def hear(message: str | bytes) -> None:
            if "hello" in str(message):
                _welcome(socket)
            elif '"view"' in str(message):
                for number, key in enumerate(keys, 1):
                    socket.send(json.dumps({"type": "value", "number": number, "key": key, "bytes": 5}))
                    socket.send(number.to_bytes(4, "little") + bytes(4) + b"wrong")
                keys.clear()

        socket.on_message(hear)

    page = visit(address, stream=serve)
    page.options(**SETTINGS)
    page.look(EYE, TARGET)
    assert page.stats()["tiles_missing"] == page.stats()["tiles_pending"] == 0
    assert page.stats()["pushed_bytes"] > 0
