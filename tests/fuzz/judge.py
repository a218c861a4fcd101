"""One case: bytes are decoded, or refused with the project's own error, in time and within a bound of memory."""

from __future__ import annotations

import faulthandler
import signal
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from random import Random
from typing import Any

from farfield.errors import FarfieldError
from fuzz.mutate import mutated, mutated_json
from fuzz.table import Decoder

SECONDS = 2.0
"""Processor time within which every case must end; honest values of these sizes take milliseconds."""
STUCK = 60
"""Times as many seconds by the clock, after which compiled code that does not come back ends the process, with a
traceback."""


class Hang(BaseException):
    """Took too long. No Exception, so that no decoder can take it for damage."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What a decoder did that it must not."""

    decoder: str
    what: str
    data: bytes

    def __str__(self) -> str:
        return f"{self.decoder}: {self.what}; {len(self.data)} bytes: {self.data[:200].hex()}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a decoder did."""

    read: bool
    """False: refused."""
    share: float
    """Of the memory that it may take at most."""


def case(decoder: Decoder, rng: Random) -> bytes:
    """A damaged value."""
    value, other = rng.choice(decoder.corpus), rng.choice(decoder.corpus)
    shell = rng.choice(decoder.shells)
    part = shell.open(value)
    if part is None:
        return mutated(value, other, rng)
    if shell.json and rng.random() < 0.8:
        return shell.close(value, mutated_json(part, rng))
    return shell.close(value, mutated(part, shell.open(other) or other, rng))


@contextmanager
def watched() -> Iterator[None]:
    """The clocks that `judge` sets raise Hang in the main thread, and end the process.

    Not with `faulthandler.dump_traceback_later`: it starts a thread for every case, which on its way frees memory
    without the interpreter's lock, while tracemalloc exchanges the functions that do so: one of eight busy
    processes crashed within half a minute.
    """

    def ring(signum: int, frame: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGPROF, ring)
    faulthandler.register(signal.SIGALRM, chain=True)
    try:
        yield
    finally:
        signal.signal(signal.SIGPROF, before)
        faulthandler.unregister(signal.SIGALRM)


def judge(decoder: Decoder, data: bytes, seconds: float = SECONDS) -> Outcome | Fault:
    """Decodes the bytes and looks at what happens. Inside `watched` only."""
    bound = decoder.bound(data)
    signal.setitimer(signal.ITIMER_REAL, STUCK * seconds)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    tracemalloc.start()
    try:
        read, took = _tried(decoder, data)
    except Hang:
        return Fault(decoder.name, f"not done after {seconds} s", data)
    except Exception as error:
        return Fault(decoder.name, f"raises {type(error).__name__}: {str(error)[:200]}", data)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        tracemalloc.stop()
    if took > bound:
        return Fault(decoder.name, f"allocates {took} bytes, more than {bound}", data)
    return Outcome(read, took / bound)


def _tried(decoder: Decoder, data: bytes) -> tuple[bool, int]:
    """Whether the bytes were read, and the most memory that decoding took at a time."""
    try:
        found = decoder.decode(data)
    except FarfieldError:
        return False, tracemalloc.get_traced_memory()[1]
    took = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    decoder.use(found)
    return True, took
