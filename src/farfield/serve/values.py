"""One value of a store as an HTTP response: conditional requests, one byte range, gzip for what is not packed."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from functools import lru_cache

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse

from farfield.serve.public import MANIFEST, cache_control, content_type, is_compressible, is_permanent, tag_of
from farfield.store import Store

CHUNK = 256 * 1024
"""Bytes read and sent at a time, so that a slow client of a large mesh holds no more memory than that."""

SMALLEST_GZIP = 512
"""Bytes below which gzip saves nothing that matters."""

_RANGE = re.compile(r"bytes=([0-9]{0,18})-([0-9]{0,18})")


def value_response(store: Store, key: str, request: Request) -> Response:
    """The answer to a GET or HEAD of `key`.

    Raises MissingKeyError: nothing is stored there. StoreError: it cannot be read.
    """
    if not is_permanent(key):
        return _small(store.get(key), key, request)
    kind = content_type(key, store.get_range(key, 0, 12))
    if is_compressible(kind):
        return _small(store.get(key), key, request)
    return _permanent(store, key, kind, request)


def _small(body: bytes, key: str, request: Request) -> Response:
    """A value that is read as a whole: it is text, or its ETag has to be computed."""
    kind = content_type(key, body)
    tag = tag_of(body)
    headers = _headers(key, f'"{tag}"') | ({"Vary": "Accept-Encoding"} if is_compressible(kind) else {})
    if _is_known(request, headers["ETag"]) or _is_known(request, f'"{tag}-gz"'):
        return Response(status_code=304, headers=headers)
    part = _range_of(request, len(body), headers["ETag"])
    if part is not None:
        return _part_response(part, len(body), kind, headers, iter([body[part[0] : part[0] + part[1]]]))
    if is_compressible(kind) and len(body) >= SMALLEST_GZIP and _takes_gzip(request):
        body = _gzipped(body)
        headers |= {"Content-Encoding": "gzip", "ETag": f'"{tag}-gz"'}
    headers["Content-Length"] = str(len(body))
    return Response(b"" if request.method == "HEAD" else body, headers=headers, media_type=kind)


def _permanent(store: Store, key: str, kind: str, request: Request) -> Response:
    """A value whose name is its ETag: nothing is read that is not sent."""
    headers = _headers(key, f'"{key[-16:]}"')
    size = store.size(key)
    if _is_known(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    part = _range_of(request, size, headers["ETag"])
    if part is not None:
        return _part_response(part, size, kind, headers, chunks(store, key, *part))
    headers["Content-Length"] = str(size)
    if request.method == "HEAD":
        return Response(headers=headers, media_type=kind)
    return StreamingResponse(chunks(store, key, 0, size), headers=headers, media_type=kind)


def chunks(store: Store, key: str, start: int, length: int) -> Iterator[bytes]:
    """`length` bytes of a value from byte `start`, a CHUNK at a time.

    Raises MissingKeyError or StoreError when the value goes away meanwhile.
    """
    for offset in range(start, start + length, CHUNK):
        yield store.get_range(key, offset, min(CHUNK, start + length - offset))


def _headers(key: str, tag: str) -> dict[str, str]:
    headers = {"Cache-Control": cache_control(key), "ETag": tag, "Accept-Ranges": "bytes"}
    if key == MANIFEST:
        headers |= {"Farfield-Batch": "batch", "Farfield-Events": "events", "Farfield-Stream": "stream"}
    return headers


def _part_response(
    part: tuple[int, int], size: int, kind: str, headers: dict[str, str], body: Iterator[bytes]
) -> Response:
    start, length = part
    if length == 0:
        return PlainTextResponse("no such range", 416, headers | {"Content-Range": f"bytes */{size}"})
    headers |= {"Content-Range": f"bytes {start}-{start + length - 1}/{size}", "Content-Length": str(length)}
    return StreamingResponse(body, 206, headers, media_type=kind)


def _range_of(request: Request, size: int, tag: str) -> tuple[int, int] | None:
    """(start, length) that a GET asks for; None for the whole; length 0 when there is no such part.

    Lists of ranges and malformed ones are ignored, as RFC 9110 (14.2) allows: the answer is the whole value.
    """
    found = _RANGE.fullmatch(request.headers.get("range", ""))
    if request.method != "GET" or found is None or request.headers.get("if-range", tag) != tag:
        return None
    first, last = found.groups()
    if not first and not last:
        return None
    if not first:
        length = min(int(last), size)
        return size - length, length
    start, end = int(first), int(last) if last else size - 1
    if last and end < start:
        return None
    return (start, min(end, size - 1) - start + 1) if start < size else (0, 0)


def _is_known(request: Request, tag: str) -> bool:
    given = request.headers.get("if-none-match", "")
    return given == "*" or tag in {one.strip().removeprefix("W/") for one in given.split(",")}


def _takes_gzip(request: Request) -> bool:
    for offer in request.headers.get("accept-encoding", "").lower().split(","):
        name, _, weight = offer.partition(";")
        if name.strip() in ("gzip", "*"):
            return re.fullmatch(r"\s*q=0(\.0*)?\s*", weight) is None
    return False


@lru_cache(maxsize=16)
def _gzipped(body: bytes) -> bytes:
    # The same few files are asked for again and again: the page, its scripts, the manifest.
    return gzip.compress(body, 6, mtime=0)
