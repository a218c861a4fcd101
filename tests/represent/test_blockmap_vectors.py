"""The BlockMaps that Python and TypeScript share."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripts.write_blockmap_vectors import FOLDER, expectation, subjects, write

from farfield.errors import CorruptTileError
from farfield.represent.blockmap.coding import decode_blockmap, decode_objects, encode_blockmap, encode_objects

NAMES = sorted(path.stem for path in FOLDER.glob("*.json") if path.stem != "corrupt")
CORRUPT = json.loads((FOLDER / "corrupt.json").read_text(encoding="utf-8"))
DAMAGED = [(kind, name) for kind, values in CORRUPT.items() for name in values]


def read(path: Path) -> dict[str, Any]:
    """A vector."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def lossless(expected: dict[str, Any]) -> dict[str, Any]:
    """Without the colours, which depend on the version of libwebp, and what holds them."""
    return {key: value for key, value in expected.items() if key not in ("color", "blockmap", "object_ids")}


@pytest.mark.parametrize("name", NAMES)
def test_decodes_as_written(name: str) -> None:
    expected = read(FOLDER / f"{name}.json")
    found = expectation(base64.b64decode(expected["blockmap"]), base64.b64decode(expected["object_ids"]))
    assert lossless(found) == lossless(expected)
    assert np.abs(np.subtract(found["color"], expected["color"])).max() <= expected["color_tolerance"]


@pytest.mark.parametrize(("kind", "name"), DAMAGED)
def test_corrupt_ones_are_refused(kind: str, name: str) -> None:
    data = base64.b64decode(CORRUPT[kind][name])
    with pytest.raises(CorruptTileError):
        decode_blockmap(data, name) if kind == "blockmap" else decode_objects(data, name)


def test_the_script_writes_these(tmp_path: Path) -> None:
    write(tmp_path)
    assert sorted(path.name for path in tmp_path.glob("*.json")) == sorted(path.name for path in FOLDER.glob("*.json"))
    for name in NAMES:
        assert lossless(read(tmp_path / f"{name}.json")) == lossless(read(FOLDER / f"{name}.json"))


@pytest.mark.parametrize("name", NAMES)
def test_what_is_encoded_comes_back(name: str) -> None:
    made = subjects()[name]
    assert made.objects is not None
    found = decode_blockmap(encode_blockmap(made, 85), name)
    for part in ("codes", "border", "turns", "slopes", "floors"):
        np.testing.assert_array_equal(getattr(found, part), getattr(made, part))
    np.testing.assert_array_equal(decode_objects(encode_objects(made.objects), name), made.objects)
