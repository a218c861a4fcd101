"""Messages of viewers as they should not be: valid ones, to the limits of what is allowed, and damaged."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from typing import Any

JUNK: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, -1e308, 1 << 63, 1 << 200, "", "x" * 5000, "\u0000", [], {}, [[[[[]]]]], [1e12] * 3,
    "view", ["orthoview/0/0/0/0/0/0-0123456789abcdef"] * 5000, {"type": "view"}, 0.1,
)  # fmt: skip
TEXTS = (
    "",
    " ",
    "null",
    "[]",
    "{}",
    "NaN",
    '{"type":"view","eye":[NaN,0,0]}',
    "[" * 20_000,
    "\U0001f600",
    '{"a":' * 5000,
)


def valid(r: random.Random) -> dict[str, Any]:
    """Within the rules, if not within reason."""
    kind = r.choice(("view", "view", "view", "add", "drop", "ack"))
    if kind == "ack":
        return {"type": "ack", "pieces": r.choice((0, 0, 0, 1, 2, r.randrange(50)))}
    if kind != "view":
        return {"type": kind, "keys": [key(r) for _ in range(r.choice((0, 1, 30, 500)))]}
    view: dict[str, Any] = {
        "type": "view",
        "eye": [number(r, 1e12) for _ in range(3)],
        "forward": r.choice(([0, 0, 1], [0, 0, -1], [1, 0, 0], [0.6, 0.8, 0], [1.001, 1.001, 1.001], [0, 0.5, 0])),
        "fov": r.choice((0.1, 179, 60, r.uniform(0.1, 179))),
        "size": [r.choice((1, 16384, 640)), r.choice((1, 16384, 480))],
    }
    others = {
        "velocity": [number(r, 1e7) for _ in range(3)],
        "acceleration": [number(r, 1e7) for _ in range(3)],
        "turning": number(r, 100),
        "nearRadius": r.choice((None, 0, 1e-300, 10, 1e12)),
        "bias": r.choice((-4, 0, 8)),
        "leastGain": r.choice((0, 10, 1e6)),
    }
    return view | {name: value for name, value in others.items() if r.random() < 0.6}


def number(r: random.Random, most: float) -> float:
    """Often an extreme."""
    return r.choice((0.0, most, -most, 1e-300, r.uniform(-most, most), r.uniform(-100, 100), r.gauss(30, 30) % most))


def key(r: random.Random) -> str:
    """Of a tile, which may be there or not."""
    cell = "/".join(str(r.randrange(-2, 9)) for _ in range(3))
    return f"orthoview/{r.randrange(4)}/{cell}/{r.randrange(3)}/{r.randrange(2)}-0123456789abcdef"


def damaged(r: random.Random) -> str | bytes:
    """A valid message with something wrong, or no message at all."""
    message = valid(r)
    way = r.randrange(7)
    if way == 0:
        message[r.choice(list(message))] = r.choice(JUNK)
    elif way == 1:
        del message[r.choice(list(message))]
    elif way == 2:
        message[r.choice(("keys", "pieces", "holds", "version", "x", "type"))] = r.choice(JUNK)
    text = json.dumps(message)
    if way == 3:
        return text[: r.randrange(len(text))]
    if way == 4:
        return bytes(byte ^ (1 << r.randrange(8)) if r.random() < 0.02 else byte for byte in text.encode())
    if way == 5:
        return r.choice(TEXTS)
    if way == 6:
        return r.randbytes(r.choice((0, 1, 8, 1000, 20_000)))
    return text


def sessions(seed: int) -> Iterator[list[str | bytes]]:
    """What viewers say after their hello: some valid messages, then a damaged one; without end, always the same."""
    r = random.Random(seed)
    while True:
        yield [*(json.dumps(valid(r)) for _ in range(r.randrange(8))), damaged(r)]
