"""The contract every store keeps; `tests/store/` runs one conformance suite against all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Protocol

from farfield.errors import StoreError


class Store(Protocol):
    """Maps keys (see `store.keys`) to bytes.

    - A reader sees the whole of a value or none of it, whatever happens to the writer.
    - A key that holds a value is never also the folder of other keys: such a `put` is refused (`BucketStore` excepted).
    - A store that cannot be changed (an archive) refuses `put` and `delete` with a StoreError and keeps the rest.
    - Safe to use from several threads, and (where the medium is shared) from several processes.
    - Every failure of the medium is a StoreError that names the store and the key and says what to try.
    """

    @property
    def location(self) -> str:
        """What a message calls this store: a path or a URL."""
        ...

    def get(self, key: str) -> bytes:
        """The value under `key`.

        Raises MissingKeyError: nothing is stored there. StoreError: it cannot be read.
        """
        ...

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """At most `length` bytes of the value from byte `start` (from 0); shorter, or empty, where the value ends.

        Raises MissingKeyError: nothing is stored there. OptionError: a negative number. StoreError: it cannot be read.
        """
        ...

    def put(self, key: str, data: bytes) -> None:
        """Store `data` under `key`, all at once, in place of what was there.

        Raises StoreError: no key, no room, no permission, or the key is the folder of other keys.
        """
        ...

    def writing(self) -> AbstractContextManager[None]:
        """Held by whoever changes what belongs together (a bake, an update): there is one at a time.

        Given back at the end, and when the process dies. Where the medium cannot say who writes (a bucket), everyone
        gets it. Raises StoreError: somebody else has it, or nothing can be written here.
        """
        ...

    def exists(self, key: str) -> bool:
        """Whether a value is stored under `key` (a folder of keys is none)."""
        ...

    def size(self, key: str) -> int:
        """Bytes of the value under `key`.

        Raises MissingKeyError: nothing is stored there.
        """
        ...

    def delete(self, key: str) -> None:
        """Remove the value under `key`; no error when there is none, so that an interrupted clean-up can be repeated.

        Raises StoreError: it cannot be removed.
        """
        ...

    def list(self, prefix: str = "") -> Iterator[str]:
        """Every key below the folder `prefix` (whole segments; "" for all), in order of their segments.

        The key `prefix` itself is not below it. What is written or removed meanwhile may or may not be listed.
        """
        ...


def busy(location: str) -> StoreError:
    """What `Store.writing` raises while somebody else has it."""
    return StoreError("another process is writing to this world", location, "wait until it is done, or end it")
