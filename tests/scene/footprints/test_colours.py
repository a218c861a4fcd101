"""Colours in words, and walls and roofs that have them."""

from __future__ import annotations

import numpy as np
import pytest

from farfield.geometry.color import LINEAR_OF_BYTE, linear_from_srgb
from farfield.scene.footprints.colours import colour_of, colours_of, materials_of
from farfield.scene.footprints.details import Details
from farfield.scene.footprints.facades import FACADES, VARIANTS, given_tints, pale_facade_material, pale_facade_pixels
from farfield.scene.footprints.features import Features, chunk_at
from farfield.scene.footprints.order import Square
from farfield.scene.footprints.rings import Rings
from farfield.scene.model import Mesh


@pytest.mark.parametrize(
    ("word", "color"),
    [
        ("red", (255, 0, 0)),
        ("Light Grey", (211, 211, 211)),
        ("light_grey", (211, 211, 211)),
        ("#abc", (170, 187, 204)),
        (" #b4C9b3 ", (180, 201, 179)),
        ("rgb(1,2,3)", (1, 2, 3)),
        ("rgb(300,0,0)", None),
        ("rgb(200%,0%,0%)", None),
        ("hsl(0,500%,50%)", None),
        ("beton", None),
        ("#12", None),
        ("", None),
        ("x" * 300, None),
    ],
)
def test_words_of_colours(word: str, color: tuple[int, int, int] | None) -> None:
    assert colour_of(word) == color


def test_columns_of_words() -> None:
    colors, unknown = colours_of(np.array(["red;white", None, "beton", 5, "", "beton", "rgb(300,0,0)"], object))
    assert colors.tolist() == [[255, 0, 0, 255]] + [[0] * 4] * 6
    assert unknown == 3
    materials, unknown = materials_of(np.array(["Brick", "roof tiles", "unobtainium"], object))
    assert (materials[:, 3] > 0).tolist() == [True, True, False]
    assert unknown == 1


@pytest.mark.parametrize("variant", range(VARIANTS))
def test_a_facade_has_the_given_colour_on_the_mean(variant: int) -> None:
    wanted = np.array([[150, 30, 20, 255], [40, 60, 120, 255], [90, 90, 90, 255], [180, 201, 179, 255]], np.uint8)
    tint = given_tints(wanted, np.full(4, variant), True)
    assert (tint[:, 3] == 255).all()
    mean = LINEAR_OF_BYTE[pale_facade_pixels(variant)[..., :3]].mean((0, 1), dtype=np.float64)
    got = linear_from_srgb(tint[:, :3] / 255.0) * mean
    aim = linear_from_srgb(wanted[:, :3] / 255.0)
    # A colour lighter than the façade keeps its hue.
    aim *= np.minimum(mean.max() / aim.max(1), 1.0)[:, None]
    np.testing.assert_allclose(got, aim, atol=0.004)
    assert mean.min() > 0.3
    assert pale_facade_material(variant).name == f"pale {FACADES[variant].name}"


def mesh_of(details: Details, facades: bool, bottom: tuple[float, float] = (0.0, 0.0)) -> Mesh:
    """Two boxes of 9 m x 7 m, both 20 m high."""
    box = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)])
    rings = Rings(np.concatenate([box, box + 20]), np.array([0, 4, 8]), np.arange(3), np.arange(2))
    features = Features(rings, np.array(bottom), np.full(2, 20.0), np.array([7, 8], np.uint32), details)
    return chunk_at(Square(20, 0), features, "a", facades).load()


RED, NONE = [200, 40, 30, 255], [0, 0, 0, 0]


def test_without_facades_the_colour_is_that_of_the_wall() -> None:
    mesh = mesh_of(
        Details(wall_color=np.array([RED, NONE], np.uint8), roof_color=np.array([NONE, RED], np.uint8)), False
    )
    plain = mesh_of(Details(), False)
    assert mesh.colors is not None
    assert plain.colors is not None
    roof, first = mesh.normals[:, 2] > 0.5, mesh.positions[:, 0] < 15
    assert (mesh.colors[~roof & first] == RED).all()
    assert (mesh.colors[roof & ~first] == RED).all()
    others = roof == first
    np.testing.assert_array_equal(mesh.colors[others], plain.colors[others])


def test_colours_tint_pale_facades_of_their_own_building_alone() -> None:
    mesh, plain = mesh_of(Details(wall_color=np.array([RED, NONE], np.uint8)), True), mesh_of(Details(), True)
    assert len(plain.materials) == 1 + VARIANTS
    assert len(mesh.materials) == 1 + 2 * VARIANTS
    walls = plain.triangle_material > 0
    first = mesh.triangle_object == 0
    np.testing.assert_array_equal(mesh.triangle_material, plain.triangle_material + VARIANTS * (walls & first))


def test_what_tells_nothing_changes_nothing() -> None:
    zeros = Details(np.zeros(2), np.zeros((2, 4), np.uint8), np.zeros((2, 4), np.uint8))
    assert zeros.told() == {}
    mesh, plain = mesh_of(zeros, True), mesh_of(Details(), True)
    assert mesh.materials == plain.materials
    for name in ("positions", "triangles", "normals", "triangle_material", "uvs", "colors", "triangle_object"):
        np.testing.assert_array_equal(getattr(mesh, name), getattr(plain, name))


def test_what_is_above_the_ground_has_a_floor() -> None:
    mesh = mesh_of(Details(lift=np.array([0.0, 6.0])), True, bottom=(0.0, 6.0))
    corners = mesh.positions[mesh.triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    floor = area[:, 2] < -1e-9
    assert area[floor, 2].sum() == pytest.approx(-63)
    assert (corners[floor][..., 2] == 6).all()
    assert mesh.triangle_object is not None
    own = mesh.triangle_object == 1
    assert (own[floor]).all()
    # Closed: all faces of the building together face nowhere.
    np.testing.assert_allclose(area[own].sum(0), 0, atol=1e-3)
    assert (np.einsum("mc,mc->m", area, mesh.normals[mesh.triangles[:, 0]]) > 0).all()


def test_a_slab_has_no_windows() -> None:
    mesh = mesh_of(Details(lift=np.array([0.0, 19.6])), True, bottom=(0.0, 19.6))
    assert mesh.uvs is not None
    wall = (mesh.positions[:, 0] > 15) & (mesh.normals[:, 2] == 0)
    u = mesh.uvs[wall].reshape(-1, 4, 2)[..., 0]
    assert (np.ptp(u, axis=1) < 0.01).all()
