"""A process in which cases are judged, apart from the tests.

Tracing memory exchanges the interpreter's allocator, which threads of servers and clusters may be using without its
lock; and what a kernel does to memory that is not its own would end the tests.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import warnings
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from fuzz.decoders import decoders
from fuzz.faulty import FAULTY
from fuzz.judge import SECONDS, Fault, Outcome, judge, watched


class Apart:
    """Judges cases in a process that is begun when it is needed, and again when a case has ended it."""

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._line: Connection | None = None

    def judge(self, decoder: str, data: bytes, seconds: float = SECONDS) -> Outcome | Fault:
        """`judge` by the decoder's name; those of `fuzz.faulty` are known too."""
        line = self._line or self._begin()
        try:
            line.send((decoder, data, seconds))
            found: Outcome | Fault = line.recv()
        except (EOFError, OSError):
            return Fault(decoder, f"ends the process, exit code {self.end()}", data)
        return found

    def end(self) -> int | None:
        """Ends the process, if there is one; its exit code."""
        code = None
        if self._line is not None and self._process is not None:
            self._line.close()
            self._process.join()
            code = self._process.exitcode
        self._line = self._process = None
        return code

    def _begin(self) -> Connection:
        spawn = multiprocessing.get_context("spawn")
        self._line, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        return self._line


def _serve(line: Connection) -> None:
    faulthandler.enable()
    # As in the other tests: an overflow in numpy is a number that should have been refused.
    warnings.simplefilter("error")
    table = {**decoders(), **FAULTY}
    with watched():
        while True:
            try:
                decoder, data, seconds = line.recv()
            except EOFError:
                return
            line.send(judge(table[decoder], data, seconds))
