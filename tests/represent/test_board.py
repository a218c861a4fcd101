"""Boards of impostors against what is worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.represent.geometry.board import (
    FULL_SINE,
    TILTS,
    TURNS,
    board_matrix,
    board_mesh,
    directions,
    dynamic_angle,
    side_angles,
    sines,
    squareness,
)
from farfield.scene.model import Texture

BOX = np.array([[-1.0, -2.0, 0.0], [3.0, 4.0, 5.0]])
"""4 x 6 x 5 m, the middle at (1, 1, 2.5)."""
MIDDLE = np.array([1.0, 1.0, 2.5])
SMALL = st.floats(-5, 5).map(lambda value: round(value, 3))


def side_directions(count: int) -> np.ndarray:
    """(count, 3) see `directions`."""
    return directions(side_angles(count))


def square(box: np.ndarray, count: int, *of: Any) -> np.ndarray:
    """Squareness of so many boards round about; see `sines`."""
    return squareness(sines(box, side_angles(count), *of))


def placed(matrix: np.ndarray, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(1, 3, 4)."""
    return np.column_stack([matrix, at])[None]


def seen(transform: np.ndarray, towards: list[float], count: int = 4) -> np.ndarray:
    """(count,) squareness from an eye that lies in that direction, mesh frame, 7 m before the middle."""
    point = MIDDLE + 7 * np.array(towards) / np.linalg.norm(towards)
    eye = transform[0, :, :3] @ point + transform[0, :, 3]
    return np.asarray(square(BOX, count, transform, eye[None])[0, 0])


def test_sides_go_round_from_x() -> None:
    assert np.allclose(side_directions(4), [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    assert np.allclose(np.linalg.norm(side_directions(7), axis=1), 1)


def test_boards_stand_across_their_directions() -> None:
    # Along x one sees y to the right, 6 m of it.
    assert np.allclose(board_matrix(BOX, side_angles(4)[0]), np.array([[0, 6, 0, 1], [6, 0, 0, 1], [0, 0, 5, 2.5]]))
    # Along y one sees x to the left, 4 m of it.
    assert np.allclose(board_matrix(BOX, side_angles(4)[1]), np.array([[-4, 0, 0, 1], [0, 4, 0, 1], [0, 0, 5, 2.5]]))
    half = 0.5**0.5
    corner = board_matrix(BOX, side_angles(8)[1])
    assert np.allclose(corner[:, 0], [-half * half * 10, half * half * 10, 0])
    assert np.allclose(corner[:, 1], [half * half * 10, half * half * 10, 0])


def test_boards_lean_towards_eyes_above() -> None:
    # From 45 degrees above along x: y to the right; of x and z together 9 / sqrt 2 m, upwards and away from the eye.
    half = 0.5**0.5
    leaning = board_matrix(BOX, dynamic_angle(0, 6))
    assert np.allclose(leaning[:, 0], [0, 6, 0])
    assert np.allclose(leaning[:, 1], [6 * half, 0, 6 * half])
    assert np.allclose(leaning[:, 2], [-half * 9 * half, 0, half * 9 * half])
    # From straight above, x points down the image.
    flat = board_matrix(BOX, dynamic_angle(0, TILTS))
    assert np.allclose(flat[:, :3], [[0, 0, -4], [6, 0, 0], [0, 6, 0]])
    assert np.allclose(board_matrix(BOX, dynamic_angle(TURNS // 4, TILTS // 2)), board_matrix(BOX, side_angles(4)[1]))


@given(SMALL, SMALL, SMALL)
def test_one_of_the_dynamic_boards_is_as_good_as_head_on(x: float, y: float, z: float) -> None:
    length = np.linalg.norm([x, y, z])
    if length > 0.01:
        every = [directions(dynamic_angle(turn, tilt)) for turn in range(TURNS) for tilt in range(TILTS + 1)]
        assert np.max(np.array(every) @ [x, y, z]) / length > np.cos(np.radians(16)) > FULL_SINE


@given(st.one_of(st.integers(1, 32), st.none()), st.data())
def test_boards_cover_their_boxes(count: int | None, data: st.DataObject) -> None:
    angle = dynamic_angle(data.draw(st.integers(0, TURNS - 1)), data.draw(st.integers(0, TILTS)))
    if count is not None:
        angle = side_angles(count)[data.draw(st.integers(0, count - 1))]
    lower = np.array(data.draw(st.tuples(SMALL, SMALL, SMALL)))
    box = np.stack([lower, lower + data.draw(st.tuples(*[st.floats(0.01, 9)] * 3))])
    matrix = board_matrix(box, angle)
    assert np.allclose(matrix[:, 3], box.mean(axis=0))
    assert np.linalg.det(matrix[:, :3]) < 0
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
    own = np.linalg.solve(matrix[:, :3], (corners - matrix[:, 3]).T)
    # Corners of the box reach to the edges of the rectangle, and not beyond.
    assert np.allclose([own[0].min(), own[0].max(), own[2].min(), own[2].max()], [-0.5, 0.5, -0.5, 0.5])
    assert np.allclose(matrix[:, 1] / np.linalg.norm(matrix[:, 1]), directions(angle))


def test_squareness_by_hand() -> None:
    still = placed(np.eye(3))
    assert np.allclose(seen(still, [1, 0, 0]), [1, 0, 0, 0])
    # 45 degrees to two of them, then 60 degrees and 30 degrees.
    half = (0.5 / 0.75) ** 1.5
    assert np.allclose(seen(still, [1, 1, 0]), [half, half, 0, 0])
    sixth = (0.5 / 0.75**0.5) ** 3
    assert np.allclose(seen(still, [-(0.75**0.5), -0.5, 0]), [0, 0, 1, sixth])
    # Half way up to the zenith, and from there.
    assert np.allclose(seen(still, [0, -1, 1]), [0, 0, 0, half])
    assert np.allclose(seen(still, [0, 0, 1]), 0)
    assert (square(BOX, 4, still, MIDDLE[None]) == 0).all()


def test_squareness_is_of_the_meshs_frame() -> None:
    """Turned, mirrored and stretched: an eye sees the side that it lies before in there."""
    mirrored = placed(np.diag([-2.0, 0.5, 3.0]) @ np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]), (9, -4, 1))
    assert np.allclose(seen(mirrored, [0, -1, 0]), [0, 0, 0, 1])
    # Straight before the turned and mirrored mesh, from afar: at -x of the world.
    eye = np.array([[-1e6, -4.0, 1.0]])
    towards = np.linalg.solve(mirrored[0, :, :3], [-1.0, 0, 0])
    sine = np.clip(side_directions(4) @ towards / np.linalg.norm(towards), 0, 0.75**0.5)
    assert np.allclose(square(BOX, 4, mirrored, eye)[0, 0], (sine / 0.75**0.5) ** 3, atol=1e-4)


def test_many_at_once() -> None:
    transforms = np.concatenate([placed(np.eye(3), (n, 0, 0)) for n in range(3)])
    eyes = np.random.default_rng(1).normal(size=(5, 3)) * 9
    found = square(BOX, 8, transforms, eyes)
    assert found.shape == (3, 5, 8)
    one = square(BOX, 8, transforms[2:], eyes[3:4])
    assert np.allclose(found[2, 3], one[0, 0])
    assert square(BOX, 8, transforms[:0], eyes).shape == (0, 5, 8)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.ones((3, 3)) * 0.3])
def test_what_is_flattened_shows_nothing(matrix: np.ndarray) -> None:
    found = square(BOX, 4, np.concatenate([placed(matrix), placed(np.eye(3))]), np.array([[9.0, 1.0, 2.5]]))
    assert (found[0] == 0).all()
    assert np.allclose(found[1], [1, 0, 0, 0])


@given(st.lists(SMALL, min_size=12, max_size=12), st.tuples(SMALL, SMALL, SMALL), st.integers(1, 32))
def test_squareness_is_a_share(transform: list[float], eye: tuple[float, float, float], count: int) -> None:
    found = square(BOX, count, np.array(transform).reshape(1, 3, 4), np.array([eye]))
    assert ((found >= 0) & (found <= 1)).all()


def test_the_mesh_of_a_board() -> None:
    texture = Texture(np.zeros((2, 2, 4), np.uint8))
    mesh = board_mesh(texture)
    assert mesh.uvs is not None
    for (x, y, z), (u, v), normal in zip(mesh.positions, mesh.uvs, mesh.normals, strict=True):
        assert (abs(x), y, abs(z)) == (0.5, 0, 0.5)
        assert (u, v) == (x + 0.5, 0.5 - z)
        assert np.allclose(normal, np.array([1.2 * x, 1, 1.2 * z]) / (1 + 0.72) ** 0.5)
    corners = mesh.positions[mesh.triangles]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(outwards, [[0, 1, 0]] * 2)
    material = mesh.materials[0]
    assert (material.texture, material.alpha_cutoff, material.double_sided) == (texture, 0.5, True)
