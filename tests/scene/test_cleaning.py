"""Bad triangles go out and are counted; normals are complete."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.scene.cleaning import RawSurface, assemble, clean, merge
from farfield.scene.model import Material, Mesh
from farfield.scene.procedural.blobs import blob, cube_sphere
from farfield.scene.shading import face_vectors, unit

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
CUBE_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                       [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip


def facing(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("height", [0.01, 0.5, 3.0])
def test_a_flat_box_keeps_its_edges(height: float) -> None:
    """By area its top outweighs its sides at every corner."""
    mesh = assemble(RawSurface(CUBE * [1, 1, height], CUBE_FACES), "box")
    facets = unit(face_vectors(mesh.positions, mesh.triangles))
    for corner in range(3):
        np.testing.assert_allclose(mesh.normals[mesh.triangles[:, corner]], facets, atol=0.02)
    assert len(mesh.positions) == 24, "four corners a side and no more"


def test_a_tent_is_smooth_along_and_sharp_across() -> None:
    """A folded strip: flat at its ridge of 60 degrees, smooth where it bends by 20."""
    profile = np.array([[-2, 0], [-1, 1.2], [0, 1.6], [1, 1.2], [1.2, 0.0]])
    points = np.array([[x, y, z] for y in (0.0, 5.0) for x, z in profile])
    faces = np.array([t for i in range(4) for t in ((i, i + 1, i + 6), (i, i + 6, i + 5))], np.uint32)
    mesh = assemble(RawSurface(points, faces[:, [0, 2, 1]]), "tent")
    normals = {tuple(np.round(n, 6)) for p, n in zip(mesh.positions, mesh.normals, strict=True) if p[0] == 0}
    assert len(normals) == 2, "21.8 degrees on either side of the ridge are 43.6 apart: sharp"
    at_one = {tuple(np.round(n, 6)) for p, n in zip(mesh.positions, mesh.normals, strict=True) if p[0] == -1}
    assert len(at_one) == 1, "28.4 degrees: smooth"


def test_a_cube_keeps_its_edges() -> None:
    mesh = assemble(RawSurface(CUBE, CUBE_FACES), "cube")
    unit = facing(mesh)
    for corner in range(3):
        np.testing.assert_allclose(mesh.normals[mesh.triangles[:, corner]], unit, atol=1e-6)


def test_a_sphere_is_smooth() -> None:
    points, faces = cube_sphere(12)
    mesh = assemble(RawSurface(points, faces), "sphere")
    assert len(mesh.positions) == len(points)
    assert np.einsum("nc,nc->n", mesh.normals, mesh.positions).min() > 0.999


def test_each_kind_of_bad_triangle_is_counted() -> None:
    points = np.concatenate([CUBE, [[np.nan, 0, 0], [np.inf, 0, 0], [5e7, 0, 0]]])
    bad = np.array([[0, 1, 8], [9, 1, 2], [0, 1, 10], [3, 3, 4], [0, 1, 99], [-1, 0, 1]])
    mesh = assemble(RawSurface(points, np.concatenate([CUBE_FACES, bad])), "x.glb")
    assert len(mesh.triangles) == 12
    assert np.isfinite(mesh.positions).all()
    assert mesh.warnings == (
        "x.glb: left out 2 triangles with vertices that do not exist",
        "x.glb: left out 2 triangles with vertices that are NaN or infinite",
        "x.glb: left out 1 triangle more than 10,000 km from the rest",
        "x.glb: left out 1 triangle of zero area",
    )


def test_an_empty_mesh_says_so() -> None:
    mesh = assemble(RawSurface(np.full((3, 3), np.nan), np.array([[0, 1, 2]])), "x.glb")
    assert len(mesh.triangles) == 0
    assert mesh.warnings[-1] == "x.glb: has no usable triangles"


@pytest.mark.parametrize("bad", [[0, 0, 0], [np.nan, 0, 0]])
def test_normals_without_direction_are_replaced(bad: list[float]) -> None:
    points, faces = cube_sphere(6)
    normals = points.copy()
    normals[::3] = bad
    mesh = assemble(RawSurface(points, faces, normals=normals), "x")
    assert np.einsum("nc,nc->n", mesh.normals, mesh.positions).min() > 0.99


def test_cleaning_twice_changes_nothing() -> None:
    mesh = blob(600, 2.0, 1)
    again = clean(mesh, "x")
    assert again.warnings == ()
    np.testing.assert_array_equal(again.triangles, mesh.triangles)
    np.testing.assert_array_equal(again.positions, mesh.positions)


def test_merging_shares_materials_and_fills_what_is_missing() -> None:
    red, blue = Material("red"), Material("blue")
    plain = RawSurface(CUBE, CUBE_FACES, materials=(red,))
    textured = RawSurface(CUBE, CUBE_FACES, uvs=np.ones((8, 2), np.float32), materials=(blue, red),
                          triangle_material=np.arange(12, dtype=np.uint16) % 2)  # fmt: skip
    mesh = merge([assemble(plain, "a"), assemble(textured, "b")])
    assert mesh.materials == (red, blue)
    assert mesh.triangle_material.tolist() == [0] * 12 + [1, 0] * 6
    assert mesh.uvs is not None
    assert mesh.uvs[0].tolist() == [0, 0]
    assert mesh.uvs[-1].tolist() == [1, 1]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_rubbish_gives_a_mesh_to_rely_on(data: st.DataObject) -> None:
    number = st.floats(allow_nan=True, allow_infinity=True, width=32)
    count = data.draw(st.integers(1, 8))
    points = np.array(data.draw(st.lists(st.tuples(number, number, number), min_size=count, max_size=count)))
    index = st.integers(-2, count + 1)
    faces = np.array(data.draw(st.lists(st.tuples(index, index, index), max_size=12))).reshape(-1, 3).astype(np.int64)
    with np.errstate(all="ignore"):
        mesh = assemble(RawSurface(points.astype(np.float64), faces), "x")
    assert np.isfinite(mesh.positions).all()
    assert not len(mesh.triangles) or mesh.triangles.max() < len(mesh.positions)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert len(mesh.triangle_material) == len(mesh.triangles)
    assert (len(mesh.triangles) < len(faces)) <= bool(mesh.warnings)
