"""Records sorted on disk: more of them than fit into memory, in runs that are merged as they are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import StoreError

_LEAST = 1 << 10
"""Records of a run that are read at a time, however many runs there are."""


@contextmanager
def scratch(path: Path) -> Iterator[None]:
    """While a temporary file is written. Raises StoreError, for it is not the source that is at fault."""
    try:
        yield
    except OSError as error:
        what = f"a temporary file cannot be written: {error.strerror or error}"
        raise StoreError(what, str(path), "make room there, or set TMPDIR to a folder that has it") from error


class SortedRecords:
    """Records in the order of their first two fields, both int64; what comes of it is the same for any `rows`, as
    long as no two records are the same in both."""

    def __init__(self, path: Path, dtype: np.dtype[Any], rows: int = 1 << 19) -> None:
        """path: a file that it may use. rows: about how many records are held in memory at a time."""
        self._path, self._dtype, self._rows = path, dtype, rows
        self._waiting: list[NDArray[Any]] = []
        self._runs: list[_Run] = []
        self._written = 0
        with scratch(path):
            path.write_bytes(b"")

    def add(self, records: NDArray[Any]) -> None:
        """Takes records in any order."""
        for start in range(0, len(records), self._rows):
            self._waiting.append(records[start : start + self._rows])
            if sum(map(len, self._waiting)) >= self._rows:
                self._write()

    def batches(self) -> Iterator[NDArray[Any]]:
        """All of them, sorted, a part at a time. Nothing may be added any more."""
        self._write()
        share = max(_LEAST, self._rows // max(1, len(self._runs)))
        runs = self._runs
        while runs:
            for run in runs:
                run.fill(share)
            # Beyond the last record in hand of a run that goes on, records are not yet known.
            ends = [run.last for run in runs if run.more]
            parts = [run.take(min(ends) if ends else None) for run in runs]
            yield _sorted(np.concatenate(parts))
            runs = [run for run in runs if run.more or len(run.records)]

    def _write(self) -> None:
        if not self._waiting:
            return
        records = _sorted(np.concatenate(self._waiting))
        with scratch(self._path), self._path.open("ab") as file:
            file.write(records.tobytes())
        self._runs.append(_Run(self._path, self._dtype, self._written, self._written + len(records)))
        self._written += len(records)
        self._waiting = []


class _Run:
    """Sorted records that follow each other in the file."""

    def __init__(self, path: Path, dtype: np.dtype[Any], at: int, stop: int) -> None:
        self._path, self._dtype, self._at, self._stop = path, dtype, at, stop
        self.records: NDArray[Any] = np.empty(0, dtype)
        """In memory; those from `at` up to `stop`, counted from the beginning of the file, are not."""

    @property
    def more(self) -> bool:
        """Whether there are some that are not in memory."""
        return self._at < self._stop

    @property
    def last(self) -> tuple[int, int]:
        """The first two fields of the last record in memory."""
        last = self.records[-1]
        return int(last[0]), int(last[1])

    def fill(self, rows: int) -> None:
        """Reads on when none is left in memory."""
        if len(self.records) == 0 and self.more:
            rows = min(rows, self._stop - self._at)
            self.records = np.fromfile(self._path, self._dtype, rows, offset=self._at * self._dtype.itemsize)
            self._at += rows

    def take(self, end: tuple[int, int] | None) -> NDArray[Any]:
        """Those in memory up to and including `end`; None: all."""
        count = len(self.records) if end is None else _count_up_to(self.records, end)
        taken, self.records = self.records[:count], self.records[count:]
        return taken


def grouped(batches: Iterator[NDArray[Any]]) -> Iterator[tuple[int, NDArray[Any]]]:
    """Each value of the first field, ascending, and all records that have it; of sorted batches."""
    kept: list[NDArray[Any]] = []
    for batch in batches:
        first = batch[_keys(batch)[0]]
        starts = np.flatnonzero(np.append(True, first[1:] != first[:-1]))
        for part in np.split(batch, starts[1:]):
            if kept and kept[0][0][0] != part[0][0]:
                yield _closed(kept)
                kept = []
            kept.append(part)
    if kept:
        yield _closed(kept)


def _closed(parts: list[NDArray[Any]]) -> tuple[int, NDArray[Any]]:
    return int(parts[0][0][0]), np.concatenate(parts)


def _keys(records: NDArray[Any]) -> tuple[str, str]:
    first, second, *_ = records.dtype.names or ()
    return first, second


def _sorted(records: NDArray[Any]) -> NDArray[Any]:
    first, second = _keys(records)
    return records[np.lexsort((records[second], records[first]))]


def _count_up_to(records: NDArray[Any], end: tuple[int, int]) -> int:
    first, second = _keys(records)
    low, high = (int(np.searchsorted(records[first], end[0], side)) for side in ("left", "right"))
    return low + int(np.searchsorted(records[second][low:high], end[1], "right"))
