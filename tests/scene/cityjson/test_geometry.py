"""Types of geometries, levels of detail, and faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scene.cityjson.small_city import CUBE, City, areas, box, load, moved, notes, semantics, volume


@pytest.mark.parametrize("kind", ["Solid", "MultiSolid", "CompositeSolid", "MultiSurface", "CompositeSurface"])
def test_types(tmp_path: Path, kind: str) -> None:
    city = City()
    city.add("a", city.cube(kind), kind="GenericCityObject")
    mesh = load(city.read(tmp_path))
    assert len(mesh.triangles) == 12
    assert volume(mesh) == pytest.approx(480)
    assert {material.double_sided for material in mesh.materials} == {"Surface" in kind}
    vectors = areas(mesh)
    normals = mesh.normals[mesh.triangles]
    np.testing.assert_allclose(vectors / np.linalg.norm(vectors, axis=1)[:, None], normals[:, 0], atol=1e-6)
    assert (normals == normals[:, :1]).all()


def test_shells_inside_are_kept_as_they_are(tmp_path: Path) -> None:
    city = City()
    outer, inner = city.points(box()), city.points(box(2, 2, 2, 2, 2, 2))
    inwards = [[ring[::-1] for ring in surface] for surface in moved(CUBE, inner)]
    city.add("a", {"type": "Solid", "lod": 1, "boundaries": [moved(CUBE, outer), inwards]})
    assert volume(load(city.read(tmp_path))) == pytest.approx(480 - 8)


def test_what_is_no_surface_is_counted(tmp_path: Path) -> None:
    city = City()
    cube = city.cube()
    lines = {"type": "MultiLineString", "lod": "0", "boundaries": [[0, 1, 2]]}
    city.add("a", cube, lines, {"type": "MultiPoint", "lod": "0", "boundaries": [0, 1]}, {"type": "Blob"}, 7)
    city.add("b", lines, kind="Road")
    assert notes(city.read(tmp_path)) == [
        "left out 3 shapes of points or lines",
        "left out 2 shapes that cannot be read",
        "left out 1 object without geometry",
    ]


@pytest.mark.parametrize(("lod", "height"), [(None, 3), (9, 3), (2.1, 2), (2, 2), (1.9, 1), (0.5, 1)])
def test_levels_of_detail(tmp_path: Path, lod: float | None, height: int) -> None:
    city = City()
    shapes = [(1, "1"), (2, 2), (3, "2.2")]
    city.add("a", *(city.cube(lod=level, corners=box(height=high)) for high, level in shapes))
    assert np.ptp(load(city.read(tmp_path, lod=lod)).positions[:, 2]) == height


def test_of_one_level_the_one_that_says_most(tmp_path: Path) -> None:
    city = City()
    plain = city.cube("Solid", corners=box(height=3))
    told = city.cube("MultiSurface", corners=box(height=4), **semantics(nested=0))
    city.add("a", told, plain)
    city.add("b", city.cube(corners=box(x=20, height=2)), city.cube(corners=box(x=40, height=2)))
    mesh = load(city.read(tmp_path))
    assert np.ptp(mesh.positions[:, 2]) == 4
    assert len(mesh.triangles) == 3 * 12


@pytest.mark.parametrize(("lod", "triangles"), [(None, 12), (1, 2), (0, 2)])
def test_parts_that_are_more_detailed_stand_for_their_building(tmp_path: Path, lod: float, triangles: int) -> None:
    city = City()
    first = city.points(box())
    city.add("a", city.geometry(moved([[[0, 1, 2, 3]]], first), lod="0"), children=["p"])
    city.add("p", city.cube(lod="2.2"), kind="BuildingPart", parents=["a"])
    assert len(load(city.read(tmp_path, lod=lod)).triangles) == triangles


def test_holes_and_any_plane(tmp_path: Path) -> None:
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
    hole = np.array([[2, 2], [2, 4], [4, 4], [4, 2]], float)
    flat = np.c_[np.concatenate([square, hole, hole + (4, 4)]), np.zeros(12)]
    turns = [np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]], np.diag([1.0, -1, -1]),
             np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])]  # fmt: skip
    for turn in turns:
        city = City()
        city.points(flat @ turn.T)
        city.add("a", city.geometry([[[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]]))
        vectors = areas(load(city.read(tmp_path)))
        np.testing.assert_allclose(vectors.sum(0), 92 * turn[:, 2], atol=0.02)
        assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(92, abs=0.02)


def test_repeated_points_closed_rings_and_faces_without_area(tmp_path: Path) -> None:
    city = City()
    city.points([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [8, 0, 0], [0, 0, 0]])
    surfaces = [
        [[0, 0, 1, 2, 2, 3, 0]],  # closed, with repeats
        [[0, 1, 2, 3], [1, 1, 1]],  # with a hole that is a point
        [[0, 1, 4]],  # a line
        [[0, 5, 0]],  # a point under two numbers
        [[0, 1]],
        [[]],
        [[0, 1, 99]],
        [[0, 1, -1]],
        [[0, 1, 2.0]],
        [[0, 1, True]],
        [0, 1, 2],
        [],
        None,
    ]
    city.add("a", city.geometry(surfaces))
    scene = city.read(tmp_path)
    mesh = load(scene)
    assert np.linalg.norm(areas(mesh), axis=1).sum() == pytest.approx(32)
    assert notes(scene) == ["left out 8 surfaces with vertices that do not exist"]
    assert mesh.warnings == (f"{tmp_path}/a.city.json: left out 3 surfaces of zero area",)


def test_folded_and_concave_faces_are_covered(tmp_path: Path) -> None:
    city = City()
    city.points([[0, 0, 0], [4, 0, 0], [4, 4, 1], [0, 4, 0], [2, 1, 0]])
    city.add("a", city.geometry([[[0, 1, 2, 3]]]), kind="LandUse")
    city.add("b", city.geometry([[[0, 4, 1, 2, 3]]]), kind="LandUse")
    mesh = load(city.read(tmp_path))
    assert mesh.triangle_object is not None
    flat = areas(mesh)[:, 2]
    assert (flat > 0).all()
    np.testing.assert_allclose(np.bincount(mesh.triangle_object, flat), [16, 14])
