"""Several values in one request (spec/http.md), so that a far-away server is asked once and not a hundred times."""

from __future__ import annotations

import asyncio
import logging
import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse

from farfield.errors import MissingKeyError, OptionError, StoreError
from farfield.serve.public import BROWSER_YEAR, is_permanent, is_world_key
from farfield.serve.values import chunks
from farfield.store import Store
from farfield.world.limits import DAMAGE

MEDIA_TYPE = "application/vnd.farfield.batch"

MAX_KEYS = 128
"""Keys in one request."""

MAX_BYTES = 32 << 20
"""Bytes of values in one answer, unless it is a single value. The index tells a reader how large each is."""

MAX_BODY = 96 * 1024
"""Bytes of the JSON list in a POST: MAX_KEYS of the longest keys fit."""

BODY_SECONDS = 15.0
"""Within which the body of a POST must have arrived."""

MISSING = 0xFFFFFFFF
"""In place of a length: nothing is stored there."""

_LENGTH = struct.Struct("<I")

_readers = ThreadPoolExecutor(16, "batch")
"""Ask for the lengths of a batch's values at once: where the store is a bucket, each takes its 20 to 100 ms."""

_log = logging.getLogger("farfield.serve")


@dataclass(frozen=True, slots=True)
class _Part:
    key: str
    length: int
    """Bytes, or MISSING."""

    @property
    def bytes_sent(self) -> int:
        return 0 if self.length == MISSING else self.length


async def batch_response(store: Store, request: Request) -> Response:
    """The answer to a GET or POST of `/batch`."""
    try:
        keys = await _keys_of(request)
    except OptionError as error:
        return PlainTextResponse(str(error), 400)
    except (TimeoutError, ClientDisconnect):
        return PlainTextResponse("the list of keys did not arrive in time", 408)
    if not 1 <= len(keys) <= MAX_KEYS:
        return PlainTextResponse(f"1 to {MAX_KEYS} keys, please", 400)
    parts = await run_in_threadpool(lambda: list(_readers.map(lambda key: _Part(key, _length_of(store, key)), keys)))
    total = sum(part.bytes_sent for part in parts)
    if total > MAX_BYTES and len(parts) > 1:
        return PlainTextResponse(f"these are {total} bytes; at most {MAX_BYTES} in one answer", 413)
    lasting = request.method == "GET" and all(part.length != MISSING and is_permanent(part.key) for part in parts)
    headers = {
        "Cache-Control": BROWSER_YEAR if lasting else "no-store",
        "Content-Length": str(total + _LENGTH.size * len(parts)),
    }
    if request.method == "HEAD":
        return Response(headers=headers, media_type=MEDIA_TYPE)
    return StreamingResponse(_frames(store, parts), headers=headers, media_type=MEDIA_TYPE)


async def _keys_of(request: Request) -> list[str]:
    """Raises OptionError: no list of keys. TimeoutError: it did not come in time."""
    if request.method != "POST":
        return request.query_params.getlist("key")
    body = b""
    async with asyncio.timeout(BODY_SECONDS):
        async for piece in request.stream():
            body += piece
            if len(body) > MAX_BODY:
                raise OptionError(f"the list of keys is longer than {MAX_BODY} bytes")
    return decode_keys(body)


def decode_keys(body: bytes) -> list[str]:
    """The keys in the body of a POST; allocates at most 32 bytes for each byte of it.

    Raises OptionError: it is no JSON list of strings.
    """
    try:
        return msgspec.json.decode(body, type=list[str])
    except DAMAGE:
        raise OptionError("expected a JSON list of keys") from None


def _length_of(store: Store, key: str) -> int:
    if not is_world_key(key):
        return MISSING
    try:
        length = store.size(key)
    except MissingKeyError:
        return MISSING
    except StoreError as error:
        # One tile that cannot be read must not take the others with it.
        _log.warning("%s", error)
        return MISSING
    return min(length, MISSING)


def _frames(store: Store, parts: list[_Part]) -> Iterator[bytes]:
    pending = b""
    for part in parts:
        pending += _LENGTH.pack(part.length)
        for chunk in chunks(store, part.key, 0, part.bytes_sent):
            yield pending + chunk
            pending = b""
    if pending:
        yield pending
