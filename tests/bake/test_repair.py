"""What is damaged in a world is baked again from its source, to the same bytes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from farfield.cli import main
from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape
from farfield.store.directory import DirectoryStore

BAKE = ["--leaf-size", "64", "--resolution", "32", "--directions", "5", "--workers", "1"]


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A world with textures, shared meshes, attributes and near geometry, beside its source."""
    make_landscape(tmp_path / "scene", LandscapeOptions(side=200.0, step=20.0, tree_triangles=200, towns=1))
    assert main(["bake", str(tmp_path / "scene"), "-o", str(tmp_path / "world"), *BAKE]) == 0
    return tmp_path / "world"


def contents(place: Path) -> dict[str, bytes]:
    """Everything in a world."""
    store = DirectoryStore(place)
    return {key: store.get(key) for key in store.list()}


def test_one_of_each_kind_damaged(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = contents(place)
    kinds = ("orthoview", "objects", "geometry", "index", "mesh", "texture", "attributes")
    for number, kind in enumerate(kind for kind in kinds if any(key.startswith(kind + "/") for key in whole)):
        key = sorted(key for key in whole if key.startswith(kind + "/"))[0]
        path = place / key
        if number % 2:
            path.unlink()
        else:
            path.write_bytes(path.read_bytes()[:-2])
    assert contents(place) != whole
    assert main(["verify", str(place)]) == 1
    capsys.readouterr()
    assert main(["verify", str(place), "--repair", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]
    assert contents(place) == whole


def test_without_its_source_it_is_said(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tile = next((place / "orthoview").rglob("*-*"))
    tile.unlink()
    (tmp_path / "scene").rename(tmp_path / "moved")
    assert main(["verify", str(place), "--repair"]) == 1
    assert "the source is not there any more" in capsys.readouterr().err
    (place / "record/order.json").unlink()
    assert main(["verify", str(place), "--repair"]) == 1
    assert "does not tell what it was baked from" in capsys.readouterr().err
