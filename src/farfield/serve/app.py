"""The ASGI application: a world's values and the viewer under one root, laid out as in the folder itself."""

from __future__ import annotations

import logging
from collections.abc import MutableMapping
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from farfield.errors import MissingKeyError, StoreError
from farfield.serve.batch import batch_response
from farfield.serve.events import GenerationFeed, events_response
from farfield.serve.public import is_page_key, is_world_key
from farfield.serve.push.endpoint import Push, PushLimits
from farfield.serve.push.messages import PATH
from farfield.serve.served import Served
from farfield.serve.throttle import Link, Throttle
from farfield.serve.values import value_response
from farfield.store import Store

MAX_TARGET = 16 * 1024
"""Bytes of path and query together: a batch of 128 of the longest keys in use takes 13 kB."""

_EXPOSED = "Content-Length", "Content-Range", "ETag", "Farfield-Batch", "Farfield-Events", "Farfield-Stream"
"""Headers that pages of other origins may read."""

_EVERY_ANSWER = [
    (b"access-control-allow-origin", b"*"),
    (b"access-control-expose-headers", ", ".join(_EXPOSED).encode()),
    (b"cross-origin-resource-policy", b"cross-origin"),
    (b"timing-allow-origin", b"*"),
    (b"x-content-type-options", b"nosniff"),
]

_PREFLIGHT = {
    "Access-Control-Allow-Methods": "GET, HEAD, POST",
    "Access-Control-Allow-Headers": "Content-Type, If-None-Match, If-Range, Range",
    "Access-Control-Max-Age": "86400",
    "Allow": "GET, HEAD, POST, OPTIONS",
}

_NO_VIEWER = "The viewer is not built into this farfield. In a clone of the repository: make viewer\n"

_log = logging.getLogger("farfield.serve")


def create_app(world: Store, page: Store, link: Link | None = None, limits: PushLimits | None = None) -> ASGIApp:
    """The application that serves `world` and the viewer's files in `page`.

    link: what its answers go through; None for nothing that would slow them. limits: of its sessions.
    """

    served = Served(world)
    feed = GenerationFeed(served)

    def value(request: Request) -> Response:
        return _value(served.now(), page, request)

    async def batch(request: Request) -> Response:
        return await batch_response(await run_in_threadpool(served.now), request)

    async def events(request: Request) -> Response:
        return events_response(feed, request)

    push = Push(served, limits or PushLimits(), (link or Link()).clock.now)
    routes: list[BaseRoute] = [
        WebSocketRoute(PATH, push.serve),
        Route("/batch", batch, methods=["GET", "POST"]),
        Route("/events", events, methods=["GET"]),
        Route("/{key:path}", value, methods=["GET"]),
    ]
    app: ASGIApp = _Gate(Starlette(routes=routes))
    return Throttle(app, link) if link and link.is_slow else app


def _value(world: Store, page: Store, request: Request) -> Response:
    # Not the route's own parameter: its pattern lets a line feed at the end go unseen.
    key = str(request.scope["path"])[1:] or "index.html"
    if is_page_key(key):
        # A world copied from elsewhere may bring a viewer of its own; the one of this version comes first.
        stores = [page, world]
    elif is_world_key(key):
        stores = [world]
    else:
        stores = []
    for store in stores:
        try:
            return value_response(store, key, request)
        except MissingKeyError:
            continue
        except StoreError as error:
            _log.warning("%s", error)
            return PlainTextResponse("the store failed", 503)
    return PlainTextResponse(_NO_VIEWER if key == "index.html" else "not found", 404)


class _Gate:
    """Refuses what is too long, answers preflights, and adds the headers that every answer carries."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_EVERY_ANSWER]
            await send(message)

        await self._answerer(scope)(scope, receive, send_with_headers)

    def _answerer(self, scope: MutableMapping[str, Any]) -> ASGIApp:
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > MAX_TARGET:
            return PlainTextResponse("the address is too long", 414)
        if scope["method"] == "OPTIONS":
            return Response(status_code=204, headers=_PREFLIGHT)
        return self._app
