"""Decoders that do what none may do, and two that are well: what the judge finds in them is known."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable
from typing import Any, Never

from farfield.errors import CorruptTileError
from fuzz.table import Decoder


def hangs(_: bytes) -> Never:
    """Does not return."""
    while True:
        pass


def sticks(_: bytes) -> bytes:
    """In compiled code, which no error can interrupt."""
    return hashlib.pbkdf2_hmac("sha256", b"", b"", (1 << 31) - 1)


def fails(_: bytes) -> Never:
    """With an error that is not the project's."""
    raise IndexError("out of range")


def devours(_: bytes) -> bytes:
    """More memory than it may."""
    return bytes(10_000_000)


def dies(_: bytes) -> Never:
    """As a kernel does that writes where it must not."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def refuses(_: bytes) -> Never:
    """As it should."""
    raise CorruptTileError("damaged")


def reads(data: bytes) -> int:
    """As it should."""
    return len(data)


def _decoder(decode: Callable[[bytes], Any], use: Callable[[Any], None] = lambda _: None) -> Decoder:
    return Decoder("made up", decode, (b"",), (), lambda data: 1_000_000, use)


FAULTY = {decode.__name__: _decoder(decode) for decode in (hangs, sticks, fails, devours, dies, refuses, reads)} | {
    "unusable": _decoder(reads, fails)
}
"""By name; unusable: what it reads cannot be used."""
