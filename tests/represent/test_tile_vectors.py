"""The tiles that Python and TypeScript share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from scripts.write_tile_vectors import FOLDER, expectation, write

from farfield.errors import CorruptTileError
from farfield.represent.orthoview.object_tile import decode_object_tile
from farfield.represent.orthoview.tile import decode_tile

TILES = sorted(FOLDER.glob("*.ffov"))
DEFLATED = sorted(FOLDER.glob("deflated/*.ffov"))
"""As farfield wrote them until 2026-11-25."""


def found_in(path: Path) -> dict[str, object]:
    """What is in a tile and the ids beside it, in the form of the JSON."""
    data = path.read_bytes()
    ids = path.with_suffix(".ffid")
    objects = decode_object_tile(ids.read_bytes(), decode_tile(data).layer) if ids.exists() else None
    return expectation(data, objects)


def lossless(expected: dict[str, object]) -> dict[str, object]:
    """Without the colours, which depend on the version of libwebp."""
    pixels = [{k: v for k, v in pixel.items() if k != "color"} for pixel in expected["pixels"]]  # type: ignore[attr-defined]
    return {**expected, "pixels": pixels}


@pytest.mark.parametrize("path", [*TILES, *DEFLATED], ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_decodes_as_written(path: Path) -> None:
    expected = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    found = found_in(path)
    assert lossless(found) == lossless(expected)
    for one, other in zip(found["pixels"], expected["pixels"], strict=True):  # type: ignore[call-overload]
        assert max(abs(a - b) for a, b in zip(one["color"], other["color"], strict=True)) <= expected["color_tolerance"]


@pytest.mark.parametrize("path", sorted(FOLDER.glob("**/corrupt/*.ffov")), ids=lambda p: p.stem)
def test_corrupt_ones_are_refused(path: Path) -> None:
    with pytest.raises(CorruptTileError):
        decode_tile(path.read_bytes(), path.name)


def test_the_script_writes_these(tmp_path: Path) -> None:
    """Those made of random integers the same; formulas may differ in the last bit between machines."""
    write(tmp_path)
    assert sorted(p.name for p in tmp_path.glob("*.ffov")) == [p.name for p in TILES]
    for name in ("noise", "row", "column", "pixel", "flat"):
        expected = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
        assert lossless(found_in(tmp_path / f"{name}.ffov")) == lossless(expected)
