"""Damage to bytes and to JSON: from single bits to numbers, nesting and lists that no writer makes."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random
from typing import Any

EXTREMES = (
    0,
    1,
    -1,
    127,
    128,
    255,
    256,
    4096,
    4097,
    2**15 - 1,
    2**15,
    2**16 - 1,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
)
"""Integers at which fields overflow, sizes become absurd and signs turn."""
HEADER = 64
"""Bytes at the beginning that are hit more often than others."""

Mutator = Callable[[bytearray, bytes, Random], None]
"""Changes the first in place; the second is another valid value."""


def _place(data: bytearray, rng: Random) -> int:
    """A byte of the data, one in two times of its header; 0 when there is none."""
    end = min(len(data), HEADER) if rng.random() < 0.5 else len(data)
    return rng.randrange(end) if end else 0


def _flip(data: bytearray, other: bytes, rng: Random) -> None:
    for _ in range(rng.choice((1, 1, 2, 8))):
        if data:
            data[_place(data, rng)] ^= 1 << rng.randrange(8)


def _overwrite(data: bytearray, other: bytes, rng: Random) -> None:
    at, length = _place(data, rng), rng.choice((1, 4, 16, 100))
    length = min(length, len(data) - at)
    data[at : at + length] = rng.choice((bytes(length), b"\xff" * length, rng.randbytes(length)))


def _extreme(data: bytearray, other: bytes, rng: Random) -> None:
    width = rng.choice((1, 2, 4, 4, 8))
    at = _place(data, rng) // width * width
    number = rng.choice(EXTREMES) % (1 << 8 * width)
    data[at : at + width] = number.to_bytes(width, "little")[: max(0, len(data) - at)]


def _truncate(data: bytearray, other: bytes, rng: Random) -> None:
    del data[rng.randrange(len(data) + 1) :]


def _extend(data: bytearray, other: bytes, rng: Random) -> None:
    length = rng.choice((1, 4, 300))
    data += rng.choice((bytes(length), rng.randbytes(length), data[:length]))


def _remove(data: bytearray, other: bytes, rng: Random) -> None:
    at = _place(data, rng)
    del data[at : at + rng.choice((1, 2, 4, 40))]


def _double(data: bytearray, other: bytes, rng: Random) -> None:
    at = _place(data, rng)
    data[at:at] = data[at : at + rng.choice((1, 8, 40))] * rng.choice((1, 1, 50))


def _splice(data: bytearray, other: bytes, rng: Random) -> None:
    at = _place(data, rng)
    data[at:] = other[at if rng.random() < 0.5 else rng.randrange(len(other) + 1) :]


def _bomb(data: bytearray, other: bytes, rng: Random) -> None:
    """A megabyte of one byte: a few hundred bytes where it is deflated afterwards."""
    data[:] = bytes([rng.choice((0, 1, 32, 91, 255))]) * rng.choice((1, 1 << 12, 1 << 20))


MUTATORS: tuple[Mutator, ...] = (
    _flip, _flip, _overwrite, _extreme, _extreme, _truncate, _extend, _remove, _double, _splice,
)  # fmt: skip


def mutated(data: bytes, other: bytes, rng: Random) -> bytes:
    """`data` damaged one to three times, mostly once: what is damaged a little gets furthest."""
    changed = bytearray(data)
    if rng.random() < 0.01:
        _bomb(changed, other, rng)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        rng.choice(MUTATORS)(changed, other, rng)
    return bytes(changed)


_MARK = "@@here@@"
_RAW = (
    b"1e999", b"-1e999", b"1e308", b"NaN", b"-Infinity", b"9" * 400, b"9" * 5000, b"-1", b"0", b"1e-320", b"-0", b"0.5",
    b"[" * 500 + b"]" * 500, b"[" * 100_000, b'{"a":' * 50_000,
    b'"\xff"', b'"\\ud800"', b'"\xed\xa0\x80"', b'""', b'"..\\/.."',
    b"null", b"true", b"[]", b"{}", b"[[]]", b'"' + b"x" * 10_000 + b'"',
    *(str(number).encode() for number in EXTREMES),
)  # fmt: skip
"""JSON that a node is replaced by; `json.dumps` would not write some of it."""


def mutated_json(text: bytes, rng: Random) -> bytes:
    """JSON with one to three of its nodes replaced, removed, doubled, moved or given another's value."""
    document = json.loads(text)
    raw = rng.choice(_RAW)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = list(_nodes(document))
        if places:
            _change(document, places, rng)
    # The mark stands where several nodes may have been replaced; all of them become the same.
    return json.dumps(document, ensure_ascii=False).encode("utf-8", "replace").replace(f'"{_MARK}"'.encode(), raw)


def _nodes(value: Any) -> Any:
    """(container, key) of every node below, in order."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        yield value, key
        yield from _nodes(child)


def _change(document: Any, places: list[tuple[Any, Any]], rng: Random) -> None:
    container, key = rng.choice(places)
    other, name = rng.choice(places)
    match rng.randrange(6):
        case 0 | 1 | 2:
            container[key] = _MARK
        case 3:
            del container[key]
        case 4 if isinstance(container, list):
            container[key:key] = [container[key]] * rng.choice((1, 30, 1000))
        case _:
            # A copy: a list moved below itself would have no end.
            container[key] = json.loads(json.dumps(other[name]))
