"""Progress on stderr: plain lines without a terminal, a bar with one."""

from __future__ import annotations

import io
import sys

import pytest

from farfield.cli.options import numbers, size
from farfield.cli.progress import PlainProgress, TerminalProgress, shown_progress
from farfield.errors import OptionError


def test_plain_lines_say_rate_and_time_left() -> None:
    now = [0.0]
    stream = io.StringIO()
    progress = PlainProgress(stream, clock=lambda: now[0])
    progress.start(900, "leaf cells")
    for _ in range(30):
        now[0] += 1
        progress.advance(4)
    progress.note("careful")
    progress.finish()
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "farfield: leaf cells 20/900, 2 %, 4.0/s, 3 min 40 s left"
    assert len(lines) == 8
    assert lines[-2:] == ["farfield: careful", "farfield: leaf cells: 120 in 30 s, 4.0/s"]


def test_a_count_without_a_total() -> None:
    now = [0.0]
    stream = io.StringIO()
    progress = PlainProgress(stream, clock=lambda: now[0])
    progress.start(None, "triangles")
    now[0] = 10
    progress.advance(5_000_000)
    progress.start(0, "nothing")
    progress.finish()
    assert stream.getvalue().splitlines() == [
        "farfield: triangles 5,000,000, 500,000/s",
        "farfield: triangles: 5,000,000 in 10 s, 500,000/s",
        "farfield: nothing: 0 in 0.0 s",
    ]


def test_on_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with shown_progress() as progress:
        assert isinstance(progress, TerminalProgress)
        progress.note("before")
        progress.start(10, "leaf cells [1/2]")
        progress.advance(10)
        progress.note("while")
        progress.start(None, "parents")
        progress.advance()
    captured = capsys.readouterr()
    assert captured.out == ""
    for text in ("before", "while", "leaf cells [1/2]", "10/10", "parents"):
        assert text in captured.err


def test_numbers_and_sizes() -> None:
    assert numbers("1,-2.5,3e2", 3, "--eye") == (1.0, -2.5, 300.0)
    assert size("640x480", "--size") == (640, 480)
    for text in ("", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "1,2,inf", "1 2 3"):
        with pytest.raises(OptionError, match="--eye"):
            numbers(text, 3, "--eye")
    for text in ("", "640", "0x1", "640x", "x480", "640x480x3", "-1x5", "99999x1", "²x1"):
        with pytest.raises(OptionError, match="--size"):
            size(text, "--size")
