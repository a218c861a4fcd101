"""Rectangles of boxes on the screen against many points of the boxes, projected by a Camera."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from farfield.geometry.cameras import Camera
from farfield.kernels.boxes import see_boxes

SIZE = 64, 48
FOV = 50.0


def seen_by(camera: Camera, *boxes: tuple[float, ...]) -> np.ndarray:
    """(n, 3): pixels within the picture, pixels, height."""
    seen = np.full((len(boxes), 1, 3), np.nan, np.float32)
    eye = np.array([camera.eye], float)
    see_boxes(np.array(boxes, float), eye, camera.axes[None].copy(), 0, camera.focal(SIZE), *map(float, SIZE), seen)
    return seen[:, 0]


def test_a_cube_seen_head_on() -> None:
    camera = Camera((0, 0, 0), (0, 1, 0), FOV)
    found = seen_by(camera, (-1, 4, -1, 1, 6, 1))[0]
    side = 2 * camera.focal(SIZE) / 4
    np.testing.assert_allclose(found, [side * side, side * side, side], rtol=1e-6)


def test_half_outside_and_behind() -> None:
    camera = Camera((0, 0, 0), (0, 1, 0), 90.0)
    edge = SIZE[0] / SIZE[1] * 4
    half, behind = seen_by(camera, (edge - 1, 4, -1, edge + 1, 4, 1), (-1, -6, -1, 1, -4, 1))
    assert np.isclose(half[0], half[1] / 2)
    assert not behind.any()


def test_what_passes_the_eye_fills_the_picture() -> None:
    found = seen_by(Camera((0, 0, 0), (0, 1, 0), FOV), (-5, -5, -5, 5, 5, 5))[0]
    assert found[0] == SIZE[0] * SIZE[1]
    assert found[1] > found[0]


def test_each_has_a_pose_of_its_own() -> None:
    cameras = Camera((0, 0, 0), (0, 1, 0), FOV), Camera((0, 0, 0), (1, 0, 0), FOV)
    boxes = np.array([(-1, 4, -1, 1, 6, 1), (4, -1, -1, 6, 1, 1)], float)
    seen = np.zeros((2, 1, 3), np.float32)
    axes = np.stack([camera.axes for camera in cameras])
    see_boxes(boxes, np.zeros((2, 3)), axes, 1, cameras[0].focal(SIZE), *map(float, SIZE), seen)
    assert seen[0, 0, 0] > 0
    np.testing.assert_allclose(seen[0], seen[1], rtol=1e-5)


places = st.tuples(*[st.floats(-20, 20)] * 3)


@given(places, st.tuples(*[st.floats(0.1, 10)] * 3), places)
def test_is_the_rectangle_of_all_its_points(low: tuple[float, ...], size: tuple[float, ...], eye: tuple) -> None:
    camera = Camera(eye, (0.5, 0.25, 0.125), FOV)
    box = (*low, *(a + b for a, b in zip(low, size, strict=True)))
    found = seen_by(camera, box)[0]
    grid = itertools.product(*(np.linspace(box[a], box[a + 3], 9) for a in range(3)))
    points = camera.project(np.array(list(grid)), SIZE)
    if (points[:, 2] <= 1e-3 * np.linalg.norm(size)).any():
        # Cut off before the eye: at least what the points before it take.
        before = points[points[:, 2] > 0.02 * np.linalg.norm(size)]
        if len(before):
            assert found[2] >= np.ptp(before[:, 1]) * (1 - 1e-5)
        return
    width, height = np.ptp(points[:, 0]), np.ptp(points[:, 1])
    np.testing.assert_allclose(found[1:], [width * height, height], rtol=1e-4)
    clipped = [np.clip([points[:, a].min(), points[:, a].max()], 0, SIZE[a]) for a in (0, 1)]
    np.testing.assert_allclose(found[0], np.prod([b - a for a, b in clipped]), rtol=1e-3, atol=1e-2)
