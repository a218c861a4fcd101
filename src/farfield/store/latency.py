"""A store behind a slow link, for tests of everything that must not wait for one value at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass

from farfield.store.contract import Store


@dataclass(frozen=True, slots=True)
class LatencyStore:
    """Passes every call on to `inner` after `seconds` of delay."""

    inner: Store
    """The store that holds the values."""

    seconds: float
    """Delay before each call, in seconds; `list` waits once, not once a key."""

    @property
    def location(self) -> str:
        """The inner store's."""
        return self.inner.location

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        time.sleep(self.seconds)
        return self.inner.get(key)

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        time.sleep(self.seconds)
        return self.inner.get_range(key, start, length)

    def put(self, key: str, data: bytes) -> None:
        """See `Store.put`."""
        time.sleep(self.seconds)
        self.inner.put(key, data)

    def writing(self) -> AbstractContextManager[None]:
        """See `Store.writing`."""
        return self.inner.writing()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        time.sleep(self.seconds)
        return self.inner.exists(key)

    def size(self, key: str) -> int:
        """See `Store.size`."""
        time.sleep(self.seconds)
        return self.inner.size(key)

    def delete(self, key: str) -> None:
        """See `Store.delete`."""
        time.sleep(self.seconds)
        self.inner.delete(key)

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`."""
        time.sleep(self.seconds)
        yield from self.inner.list(prefix)
