"""Instances of geometry templates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from farfield.scene.cityjson import templates
from farfield.scene.model import Scene
from scene.cityjson.small_city import AT, CUBE, City, areas, box, load, notes, volume


def city_with_template() -> City:
    city = City()
    city.json["geometry-templates"] = {
        "templates": [city.geometry([CUBE], "Solid"), {"type": "MultiPoint", "boundaries": [0]}, None],
        "vertices-templates": (box(width=1, depth=1, height=2) + (0, 0, 0)).tolist(),
    }
    city.json["geometry-templates"]["templates"][0]["boundaries"] = [CUBE]
    return city


def instance(city: City, at: Any, matrix: Any = None, template: Any = 0) -> dict[str, Any]:
    matrix = np.eye(4) if matrix is None else matrix
    return {"type": "GeometryInstance", "template": template, "boundaries": [city.points([at])],
            "transformationMatrix": np.asarray(matrix).ravel().tolist()}  # fmt: skip


def placed(scene: Scene) -> list[np.ndarray]:
    """Points of every instance, in the CRS."""
    own = scene.instances
    return [
        scene.meshes[mesh].load().positions @ transform[:, :3].T + transform[:, 3] + scene.origin
        for mesh, transform in zip(own.mesh, own.transform, strict=True)
    ]


def test_trees_share_their_mesh(tmp_path: Path) -> None:
    city = city_with_template()
    turned = np.array([[0, -2, 0, 0.5], [2, 0, 0, 0], [0, 0, 3, 0], [0, 0, 0, 1]])
    city.add("a", instance(city, (1, 2, 3)), kind="SolitaryVegetationObject")
    city.add("b", instance(city, (10, 20, 30), turned), kind="SolitaryVegetationObject", attributes={"species": "oak"})
    city.add("c", instance(city, (5, 5, 5)), kind="CityFurniture")
    scene = city.read(tmp_path)
    assert scene.instances.mesh.tolist() == [0, 0, 1]
    assert scene.instances.first_object.tolist() == [1, 2, 3]
    assert scene.attributes["id"].tolist() == ["a", "b", "c"]
    first, second, _ = placed(scene)
    np.testing.assert_allclose([first.min(0), first.max(0)], AT + [(1, 2, 3), (2, 3, 5)])
    np.testing.assert_allclose([second.min(0), second.max(0)], AT + [(8.5, 20, 30), (10.5, 22, 36)])
    assert [mesh.name.split(", ")[1] for mesh in scene.meshes] == [
        "template 0 as tree", "template 0 as furniture"]  # fmt: skip


def test_buildings_and_mixed_objects_have_surfaces_of_their_own(tmp_path: Path) -> None:
    city = city_with_template()
    mirror = np.diag([-1.0, 1, 1, 1])
    city.add("house", instance(city, (0, 0, 0)))
    city.add("bench", instance(city, (5, 0, 0)), instance(city, (8, 0, 0), mirror), kind="CityFurniture")
    scene = city.read(tmp_path)
    mesh = load(scene)
    assert scene.object_count == 2
    assert len(mesh.triangles) == 36
    assert mesh.triangle_object is not None
    row = scene.attributes["id"].tolist().index("house")
    own = mesh.triangle_object == row
    outwards = (mesh.positions[mesh.triangles[own]].mean(1) * areas(mesh)[own]).sum() / 3
    assert outwards == pytest.approx(2)
    assert volume(mesh) == pytest.approx(2)  # The mirrored one faces inwards, and is seen from both sides.
    assert {material.double_sided for material in mesh.materials} == {False, True}


def test_what_cannot_be_placed_is_counted(tmp_path: Path) -> None:
    city = city_with_template()
    city.add("good", instance(city, (0, 0, 0)), kind="CityFurniture")
    bad: list[dict[str, Any]] = [instance(city, (0, 0, 0), template=number) for number in (1, 2, 3, -1, "0")]
    bad.append(instance(city, (0, 0, 0), np.full(16, np.nan)))
    bad.append({**instance(city, (0, 0, 0)), "boundaries": [10**6]})
    bad.append({**instance(city, (0, 0, 0)), "transformationMatrix": [1, 2]})
    for number, one in enumerate(bad):
        city.add(f"bad {number}", one, kind="CityFurniture")
    scene = city.read(tmp_path)
    assert scene.object_count == 1
    assert notes(scene) == ["left out 8 shapes that cannot be read", "left out 8 objects without geometry"]


def test_only_geometries_that_are_used_part_an_object_from_its_template(tmp_path: Path) -> None:
    city = city_with_template()
    nowhere = {**instance(city, (0, 0, 0)), "boundaries": [10**6]}
    city.add("gone", nowhere, nowhere, kind="CityFurniture")
    city.add("first", instance(city, (1, 0, 0)), kind="CityFurniture")
    city.add("second", instance(city, (3, 0, 0)), nowhere, kind="CityFurniture")
    scene = city.read(tmp_path)
    assert scene.attributes["id"].tolist() == ["first", "second"]
    assert scene.instances.mesh.tolist() == [0, 0]


def test_copies_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(templates, "MOST_CORNERS", 50)
    city = city_with_template()
    for number in range(4):
        city.add(f"{number}", instance(city, (number, 0, 0)))
    scene = city.read(tmp_path)
    assert scene.object_count == 2
    assert notes(scene)[0] == "left out 2 instances of a template beyond 50 million corners"
