"""The vectors of choices that Python and TypeScript share are what the code gives."""

from __future__ import annotations

from pathlib import Path

from scripts.write_stream_vectors import FOLDER, written


def test_the_script_writes_the_vectors() -> None:
    assert {path.name: path.read_text() for path in Path(FOLDER).glob("*.json")} == written()
