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


def town(folder: Path) -> Path:
    """A world of footprints with attributes, whose scene is values of its store."""
    folder.mkdir()
    square = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]
    feature = {"type": "Feature", "properties": {"height": 9, "name": "A"},
               "geometry": {"type": "Polygon", "coordinates": [square]}}  # fmt: skip
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::6677"}}
    (folder / "town.geojson").write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
    assert main(["bake", str(folder / "town.geojson"), "-o", str(folder / "world"), *BAKE]) == 0
    return folder / "world"


def spoil(path: Path) -> None:
    """One bit is another; the length stays."""
    value = path.read_bytes()
    path.write_bytes(value[:-9] + bytes([value[-9] ^ 1]) + value[-8:])


@pytest.mark.parametrize("folder", ["record/chunk", "attributes"])
@pytest.mark.parametrize("repair", ["verify", "bake"])
def test_a_damaged_part_of_the_scene_is_put_right(
    tmp_path: Path, folder: str, repair: str, capsys: pytest.CaptureFixture[str]
) -> None:
    place = town(tmp_path / "town")
    whole = contents(place)
    bad = [path for path in (place / folder).iterdir() if b"parts" not in path.read_bytes()]
    for path in bad:
        spoil(path)
    capsys.readouterr()
    assert main(["verify", str(place), "--json"]) == 1
    assert {fault["key"] for fault in json.loads(capsys.readouterr().out)["bad"]} == {
        path.relative_to(place).as_posix() for path in bad
    }
    if repair == "verify":
        assert main(["verify", str(place), "--repair"]) == 0
    else:
        assert main(["bake", str(tmp_path / "town" / "town.geojson"), "-o", str(place), *BAKE]) == 0
    assert contents(place) == whole


@pytest.mark.parametrize("folder", ["record/chunk", "attributes"])
def test_who_reads_a_damaged_part_of_the_scene_is_told_its_key(
    tmp_path: Path, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    place = town(tmp_path / "town")
    for path in (place / folder).iterdir():
        spoil(path)
    capsys.readouterr()
    assert main(["update", str(place), "--region", "0,0,4,4"]) == 1
    assert f"{folder}/" in capsys.readouterr().err


@pytest.mark.parametrize("key", ["record/scene", "record/scene.json"])
def test_a_damaged_note_of_the_scene_is_put_right(tmp_path: Path, key: str, capsys: pytest.CaptureFixture[str]) -> None:
    place = town(tmp_path / "town")
    whole = contents(place)
    (place / key).write_bytes(b"[")
    assert main(["verify", str(place)]) == 1
    assert f"{key}: " in capsys.readouterr().out
    assert main(["verify", str(place), "--repair"]) == 0
    assert contents(place) == whole


def test_a_scene_that_is_kept_is_not_baked_without_its_parts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After an update by region from other sources nothing else tells of them: they come from everything again."""
    place = town(tmp_path / "town")
    source = tmp_path / "town" / "town.geojson"
    other = tmp_path / "other.geojson"
    other.write_bytes(source.read_bytes())
    assert main(["update", str(place), str(other), "--region", "0,0,10,10"]) == 0
    for path in (place / "record/chunk").iterdir():
        spoil(path)
    assert main(["verify", str(place), "--repair"]) == 1
    assert "update it once from everything" in capsys.readouterr().err
    assert main(["update", str(place), str(source)]) == 0
    assert main(["verify", str(place)]) == 0
