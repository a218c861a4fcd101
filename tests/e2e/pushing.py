"""Pages that are sent just what a test says, whatever they look at."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from playwright.sync_api import Browser, Route, WebSocketRoute

from e2e.browsing import Visit

PIECE = 16384


@contextmanager
def opened_with(
    browser: Browser, server: str, allowed: set[str], pushed: Mapping[str, bytes], query: str = ""
) -> Iterator[Visit]:
    """A page; of values only those allowed are to be had, and of them those in `pushed` come in a session."""
    context = browser.new_context(viewport={"width": 640, "height": 480})
    page = context.new_page()
    page.set_default_timeout(60_000)

    def answer(route: Route) -> None:
        key = "/".join(route.request.url.split("#")[0].split("/")[3:])
        route.continue_() if key in allowed else route.fulfill(status=404)

    def alone(route: Route) -> None:
        response = route.fetch()
        headers = {name: value for name, value in response.headers.items() if name != "farfield-batch"}
        route.fulfill(response=response, headers=headers)

    page.route(re.compile(r"/(orthoview|objects|geometry|mesh|texture)/"), answer)
    page.route("**/world.json", alone)
    page.route_web_socket("**/stream", lambda socket: _push(socket, dict(pushed)))
    visit = Visit(page, expect_errors=True)
    page.goto(server + query)
    page.wait_for_function("window.farfield !== undefined && !!farfield.world.manifest")
    yield visit
    context.close()


def _push(socket: WebSocketRoute, values: dict[str, bytes]) -> None:
    """A session that brings these values, whatever is seen, and then nothing more."""

    def hear(message: str | bytes) -> None:
        if "hello" in str(message):
            socket.send(json.dumps({"type": "welcome", "version": 1, "generation": 1, "piece": PIECE}))
        elif '"view"' in str(message):
            for number, (key, value) in enumerate(values.items(), 1):
                socket.send(json.dumps({"type": "value", "number": number, "key": key, "bytes": len(value)}))
                for at in range(0, len(value), PIECE):
                    socket.send(number.to_bytes(4, "little") + at.to_bytes(4, "little") + value[at : at + PIECE])
            values.clear()
            socket.send('{"type":"idle"}')

    socket.on_message(hear)
