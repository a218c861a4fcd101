"""Which objects are one, and what is told of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from farfield.scene.cityjson import objects
from farfield.scene.cityjson.objects import columns_of
from scene.cityjson.small_city import City, box, load, notes


def test_a_building_and_its_parts_are_one_object(tmp_path: Path) -> None:
    city = City()
    city.add("part 1", city.cube(), kind="BuildingPart", parents=["b"], attributes={"roof": "flat", "height": 6})
    city.add("b", kind="Building", children=["part 1", "part 2"], attributes={"height": 9, "id": "own"})
    city.add("part 2", city.cube(corners=box(x=20)), kind="BuildingPart", attributes={"roof": "shed"})
    city.add("balcony", city.cube(corners=box(x=10, width=1)), kind="BuildingInstallation", parents=["part 1"])
    city.add("road", city.geometry([[[0, 1, 2, 3]]]), kind="Road")
    scene = city.read(tmp_path)
    mesh = load(scene)
    assert scene.object_count == 2
    assert mesh.object_count == 2
    row = scene.attributes["id"].tolist().index("b")
    assert {name: column.tolist()[row] for name, column in scene.attributes.items()} == {
        "id": "b", "type": "Building", "height": 9, "attributes.id": "own", "roof": "flat",
    }  # fmt: skip
    assert mesh.triangle_object is not None
    assert np.bincount(mesh.triangle_object)[row] == 36


def test_parents_that_are_missing_or_go_in_a_circle(tmp_path: Path) -> None:
    city = City()
    cube = city.cube()
    city.add("orphan", cube, parents=["gone", 3])
    for name, above in (("x", "y"), ("y", "z"), ("z", "x"), ("below", "z"), ("self", "self")):
        city.add(name, cube, parents=[above])
    city.json["CityObjects"]["text"] = "no object"
    scene = city.read(tmp_path)
    assert scene.attributes["id"].tolist() == ["orphan"]
    assert notes(scene) == ["left out 1 object that cannot be read", "left out 5 objects whose parents go in a circle"]


def test_a_long_chain_of_parents(tmp_path: Path) -> None:
    city = City()
    cube = city.cube()
    for k in range(5000):
        city.add(str(k), *([cube] if k % 1000 == 0 else []), parents=[str(k + 1)] if k < 4999 else [])
    assert city.read(tmp_path).attributes["id"].tolist() == ["4999"]


def test_members_of_a_group_stay_themselves(tmp_path: Path) -> None:
    city = City()
    cube = city.cube()
    city.add("group", kind="CityObjectGroup", children=["a", "b"])
    city.add("a", cube, parents=["group"])
    city.add("b", cube, parents=["group"], kind="+Shed")
    scene = city.read(tmp_path)
    assert sorted(scene.attributes["type"].tolist()) == ["+Shed", "Building"]
    assert scene.warnings == ()


def test_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [{"a": 1, "b": 1.5, "c": "x", "d": True}, {"a": 2, "b": None, "d": False}, {"a": 3, "e": 1}]
    columns = columns_of(rows, Counter())
    assert columns["a"].dtype == np.int64
    np.testing.assert_array_equal(columns["b"], [1.5, np.nan, np.nan])
    assert columns["c"].tolist() == ["x", None, None]
    assert columns["d"].tolist() == [True, False, None]
    monkeypatch.setattr(objects, "MOST_COLUMNS", 2)
    faults: Counter[str] = Counter()
    assert list(columns_of(rows, faults)) == ["a", "b"]
    assert faults["attribute beyond the most frequent"] == 3


def test_nested_attributes_are_json(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube(), attributes={"tags": ["x", {"y": 1}], "huge": 10**400, "big": 2**60}, address=[{"no": 3}])
    scene = city.read(tmp_path)
    assert scene.attributes["tags"].tolist() == ['["x", {"y": 1}]']
    assert scene.attributes["address"].tolist() == ['[{"no": 3}]']
    assert scene.attributes["big"].tolist() == [float(2**60)]
