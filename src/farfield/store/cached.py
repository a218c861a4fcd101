"""A store far away whose values are kept for a while: for a server that is asked for size, head and parts of one."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import AbstractContextManager
from threading import Lock

from farfield.errors import OptionError
from farfield.store.contract import Store

KEPT_BYTES = 256 << 20
"""Bytes of values kept."""


class CachedStore:
    """Reads values of `inner` as a whole, once, and keeps those last used; all but the keys in `changing`.

    What is written through it is not kept, and what others write under a key that is kept is not seen.
    """

    def __init__(self, inner: Store, changing: frozenset[str], kept_bytes: int = KEPT_BYTES) -> None:
        self._inner = inner
        self._changing = changing
        self._room = kept_bytes
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()

    @property
    def location(self) -> str:
        """The inner store's."""
        return self._inner.location

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        with self._lock:
            known = self._kept.get(key)
            if known is not None:
                self._kept.move_to_end(key)
                return known
        data = self._inner.get(key)
        if key not in self._changing:
            self._keep(key, data)
        return data

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        return self.get(key)[start : start + length]

    def put(self, key: str, data: bytes) -> None:
        """See `Store.put`."""
        self._forget(key)
        self._inner.put(key, data)

    def writing(self) -> AbstractContextManager[None]:
        """See `Store.writing`."""
        return self._inner.writing()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        return key in self._kept or self._inner.exists(key)

    def size(self, key: str) -> int:
        """See `Store.size`: whoever asks is about to read the value."""
        return len(self.get(key))

    def delete(self, key: str) -> None:
        """See `Store.delete`."""
        self._forget(key)
        self._inner.delete(key)

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`."""
        return self._inner.list(prefix)

    def _keep(self, key: str, data: bytes) -> None:
        with self._lock:
            if key in self._kept or len(data) > self._room:
                return
            self._kept[key] = data
            self._bytes += len(data)
            while self._bytes > self._room:
                self._bytes -= len(self._kept.popitem(last=False)[1])

    def _forget(self, key: str) -> None:
        with self._lock:
            self._bytes -= len(self._kept.pop(key, b""))
