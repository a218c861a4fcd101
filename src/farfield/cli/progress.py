"""Progress on stderr: a moving bar on a terminal, else a plain line every few seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from farfield.cli.output import in_time
from farfield.progress import Progress

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

SECONDS_BETWEEN_LINES = 5.0
"""A log of an hour's bake then has some 700 lines."""


@contextmanager
def shown_progress() -> Iterator[Progress]:
    """A Progress shown on stderr in the way that suits it, ended tidily whatever happens inside."""
    progress = TerminalProgress() if sys.stderr.isatty() else PlainProgress(sys.stderr)
    try:
        yield progress
    finally:
        progress.finish()


class PlainProgress:
    """Writes lines such as `leaf cells 120/900, 13 %, 4.1/s, 3 min 10 s left`."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._what = ""
        self._total: int | None = None
        self._done = 0
        self._begun = self._spoke = 0.0

    def start(self, total: int | None, what: str) -> None:
        """See `Progress.start`."""
        self.finish()
        self._what, self._total, self._done = what, total, 0
        self._begun = self._spoke = self._clock()

    def advance(self, count: int = 1) -> None:
        """See `Progress.advance`."""
        self._done += count
        now = self._clock()
        if now - self._spoke >= SECONDS_BETWEEN_LINES:
            self._spoke = now
            self._line(self._state(now - self._begun))

    def note(self, text: str) -> None:
        """See `Progress.note`."""
        self._line(text)

    def finish(self) -> None:
        """See `Progress.finish`."""
        if self._what:
            elapsed = self._clock() - self._begun
            self._line(f"{self._what}: {self._done:,} in {in_time(elapsed)}{_rate(self._done, elapsed)}")
        self._what = ""

    def _state(self, elapsed: float) -> str:
        rate = _rate(self._done, elapsed)
        if not self._total:
            return f"{self._what} {self._done:,}{rate}"
        left = elapsed / max(self._done, 1) * max(self._total - self._done, 0)
        share = f"{100 * self._done // self._total} %"
        return f"{self._what} {self._done:,}/{self._total:,}, {share}{rate}, {in_time(left)} left"

    def _line(self, text: str) -> None:
        print(f"farfield: {text}", file=self._stream, flush=True)


class TerminalProgress:
    """The same on a terminal, as a bar that moves."""

    def __init__(self) -> None:
        self._bar: RichProgress | None = None
        self._task: TaskID | None = None
        self._done = 0
        self._begun = time.monotonic()

    def start(self, total: int | None, what: str) -> None:
        """See `Progress.start`."""
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        if self._bar is None:
            columns = (
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}", markup=False),
                TimeRemainingColumn(compact=True),
            )
            self._bar = Progress(*columns, console=Console(stderr=True))
            self._bar.start()
        self._done, self._begun = 0, time.monotonic()
        self._task = self._bar.add_task(what, total=total, rate="")

    def advance(self, count: int = 1) -> None:
        """See `Progress.advance`."""
        self._done += count
        if self._bar is not None and self._task is not None:
            rate = _rate(self._done, time.monotonic() - self._begun).lstrip(", ")
            self._bar.update(self._task, advance=count, rate=rate)

    def note(self, text: str) -> None:
        """See `Progress.note`."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(f"farfield: {text}", file=sys.stderr)

    def finish(self) -> None:
        """See `Progress.finish`."""
        if self._bar is not None:
            self._bar.stop()
        self._bar = self._task = None


def _rate(done: int, elapsed: float) -> str:
    if elapsed <= 0 or done == 0:
        return ""
    rate = done / elapsed
    return f", {rate:,.0f}/s" if rate >= 100 else f", {rate:.1f}/s"
