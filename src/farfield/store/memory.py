"""A store in memory: for tests, and for worlds too short-lived to be worth a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from farfield.errors import MissingKeyError, OptionError, StoreError
from farfield.store.contract import busy
from farfield.store.keys import ancestors, check_key, check_prefix


class MemoryStore:
    """Keeps the contract of `Store` with a dictionary."""

    def __init__(self, location: str = "memory") -> None:
        self._location = location
        self._values: dict[str, bytes] = {}
        self._folders: Counter[str] = Counter()
        self._lock = Lock()
        self._writer = Lock()

    @property
    def location(self) -> str:
        """The name given when it was made."""
        return self._location

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        try:
            return self._values[check_key(key)]
        except KeyError:
            raise MissingKeyError("nothing is stored there", f"{self._location}: {key}") from None

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        return self.get(key)[start : start + length]

    def put(self, key: str, data: bytes) -> None:
        """See `Store.put`."""
        above = ancestors(check_key(key))
        with self._lock:
            if key in self._folders or any(folder in self._values for folder in above):
                raise StoreError("a key cannot also be the folder of other keys", f"{self._location}: {key}")
            if key not in self._values:
                self._folders.update(above)
            self._values[key] = bytes(data)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """See `Store.writing`."""
        if not self._writer.acquire(blocking=False):
            raise busy(self._location)
        try:
            yield
        finally:
            self._writer.release()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        return check_key(key) in self._values

    def size(self, key: str) -> int:
        """See `Store.size`."""
        return len(self.get(key))

    def delete(self, key: str) -> None:
        """See `Store.delete`."""
        with self._lock:
            if self._values.pop(check_key(key), None) is not None:
                self._folders.subtract(ancestors(key))
                self._folders = +self._folders

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`."""
        folder = check_prefix(prefix)
        start = f"{folder}/" if folder else ""
        with self._lock:
            keys = [key for key in self._values if key.startswith(start)]
        yield from sorted(keys, key=lambda key: key.split("/"))
