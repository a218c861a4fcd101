"""The grammar of keys: `segment/segment/…`, the same on every store and in every URL.

A segment is one or more of `A-Z a-z 0-9 . _ -` and does not begin with a dot, so `.` and `..` are no segments,
a key is never absolute, needs no escaping in a URL, and never names a hidden or temporary file.
"""

from __future__ import annotations

import re

from farfield.errors import StoreError

MAX_KEY_LENGTH = 512
"""Characters in a whole key. The longest the format makes is about 100; file systems stop at 4,096 with the root."""

MAX_SEGMENT_LENGTH = 200
"""Characters in one segment. File systems stop at 255, and temporary names need a few of them."""

_SEGMENT = rf"(?!\.)[A-Za-z0-9._-]{{1,{MAX_SEGMENT_LENGTH}}}"
_KEY = re.compile(rf"{_SEGMENT}(?:/{_SEGMENT})*")


def is_key(text: str) -> bool:
    """Whether `text` is a key by the grammar above."""
    return len(text) <= MAX_KEY_LENGTH and _KEY.fullmatch(text) is not None


def check_key(key: str) -> str:
    """`key` itself, if it is one.

    Raises StoreError: it is not a key.
    """
    if not is_key(key):
        shown = key if len(key) <= 80 else key[:77] + "…"
        raise StoreError("not a key of a store", repr(shown), "segments of A-Z a-z 0-9 . _ - joined by /")
    return key


def check_prefix(prefix: str) -> str:
    """`prefix` without a slash at its end, if it is empty or whole segments of a key.

    Raises StoreError: it is neither.
    """
    stem = prefix.removesuffix("/")
    return check_key(stem) if stem else ""


def ancestors(key: str) -> list[str]:
    """Every key that `key` lies below, shortest first: `a/b/c` gives `a` and `a/b`."""
    segments = key.split("/")
    return ["/".join(segments[:count]) for count in range(1, len(segments))]
