"""A store on a web server: the values of a world are read by plain GET requests (spec/http.md)."""

from __future__ import annotations

import http.client
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing
from typing import Never
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from farfield.errors import MissingKeyError, OptionError, StoreError
from farfield.store.keys import check_key

SCHEMES = ("http", "https")

SILENT_SECONDS = 20
"""Within which a connection must be there, an answer begin, and each next part of it come."""

MAXIMUM_BYTES = 1 << 30
"""Of one value; a server that sends more is not believed."""

_PASSING = (408, 429)
"""Refusals that say nothing about the value, besides those from 500 on."""


class HttpStore:
    """Reads the values below a URL `http://…` or `https://…`; any server of files does. Keeps the contract of `Store`,
    but for `put`, `delete`, `writing` and `list`, which raise StoreError: servers of files do not tell what they have.

    One connection a value: for a look at a world elsewhere, and for copying it.
    """

    def __init__(self, url: str) -> None:
        """Opens no connection yet. Raises StoreError: a URL that cannot be used."""
        host = url.partition("://")[2].partition("/")[0]
        if not host or "@" in host or not url.isascii() or any(mark in url for mark in "?# "):
            raise StoreError("not the address of a folder on a web server", url[:200], "https://HOST/FOLDER")
        self._url = url.rstrip("/")

    @property
    def location(self) -> str:
        """The URL, without a slash at its end."""
        return self._url

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        return self._ask(key, "GET")

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`. Of a server that answers no ranges it reads the whole value."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        if length == 0:
            self.size(key)
            return b""
        return self._ask(key, "GET", (start, length))

    def put(self, key: str, data: bytes) -> None:
        """Raises StoreError."""
        self._refuse()

    def writing(self) -> AbstractContextManager[None]:
        """Raises StoreError."""
        self._refuse()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        try:
            self._ask(key, "HEAD")
        except MissingKeyError:
            return False
        return True

    def size(self, key: str) -> int:
        """See `Store.size`. Of a server that does not say so it reads the whole value."""
        try:
            with closing(self._open(key, "HEAD", {})) as answer:
                length = _length_of(answer)
        except (OSError, http.client.HTTPException) as error:
            self._fail(error, key)
        return len(self.get(key)) if length is None else length

    def delete(self, key: str) -> None:
        """Raises StoreError."""
        self._refuse()

    def list(self, prefix: str = "") -> Iterator[str]:
        """Raises StoreError."""
        raise StoreError("a web server does not tell what it has", self._url, "copy the world first: farfield copy")

    def _ask(self, key: str, method: str, part: tuple[int, int] | None = None) -> bytes:
        """The value, or `part` of it: start and length. Raises as `Store.get`."""
        headers = {"Range": f"bytes={part[0]}-{sum(part) - 1}"} if part else {}
        try:
            with closing(self._open(key, method, headers)) as answer:
                data: bytes = answer.read(MAXIMUM_BYTES + 1)
                whole, length = answer.status != 206, _length_of(answer)
        except HTTPError as error:
            if part and error.code == 416:
                return b""
            self._fail(error, key)
        except (OSError, http.client.HTTPException) as error:
            self._fail(error, key)
        if len(data) > MAXIMUM_BYTES:
            raise StoreError("the server sends more than a value can have", f"{self._url}/{key}")
        # `read` with a limit takes the end of a broken connection for the end of the value.
        if method == "GET" and length is not None and len(data) < length:
            raise StoreError("the answer is cut short", f"{self._url}/{key}", "try again")
        return data[part[0] : sum(part)] if part and whole else data

    def _open(self, key: str, method: str, headers: dict[str, str]) -> http.client.HTTPResponse:
        request = Request(f"{self._url}/{check_key(key)}", headers=headers, method=method)
        answer: http.client.HTTPResponse = urlopen(request, timeout=SILENT_SECONDS)
        return answer

    def _fail(self, error: Exception, key: str) -> Never:
        where = f"{self._url}/{key}"
        if isinstance(error, HTTPError):
            error.close()
            if error.code < 500 and error.code not in _PASSING:
                raise MissingKeyError(f"nothing is stored there: the server answers {error.code}", where) from error
            raise StoreError(f"the server answers {error.code}", where, "try again later") from error
        reason = error.reason if isinstance(error, URLError) else error
        raise StoreError(f"the server does not answer: {reason}", where, "check the address and the network") from error

    def _refuse(self) -> Never:
        raise StoreError("a world on a web server is only read", self._url, "farfield copy it to a folder")


def _length_of(answer: http.client.HTTPResponse) -> int | None:
    """Bytes of the body as the server says; None: it does not."""
    length = answer.headers.get("Content-Length", "")
    return int(length) if length.isascii() and length.isdigit() else None
