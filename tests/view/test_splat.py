"""The splatting kernel against its plain twin, and what it must do by itself."""

from __future__ import annotations

import numpy as np
import pytest

from farfield.geometry.cameras import Camera
from farfield.geometry.directions import TOP, parse, principal
from farfield.kernels.splat import FOOTPRINT
from farfield.octree.grid import Grid
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.view.frame import Frame
from farfield.view.shading import Light, lambert, seen_from
from farfield.view.splats import Splats
from view.plain_splat import PlainFrame, splat

GRID = Grid(16.0, 32, (1000.0, -2000.0, 10.0), (4, 4, 1))
DIRECTIONS = parse("26")


def random_layer(seed: int, number: int) -> OrthoLayer:
    """A layer about the middle of cell 0/0/0/0: every kind of pixel, some of them empty."""
    r = np.random.default_rng(seed)
    shape = 24, 20
    middle = DIRECTIONS[number].axes @ np.array([8.0, 8.0, 8.0]) / GRID.pitch(0)
    depth = np.where(r.random(shape) < 0.8, r.integers(1, 200, shape), 0)
    codes = np.clip(r.normal(32, 12, (*shape, 2)), 0, 63)
    return OrthoLayer(
        x=int(middle[0]) - 10,
        y=int(middle[1]) - 12,
        depth_base=int(middle[2] * 8) - 100,
        depth=depth.astype(np.uint16),
        color=r.integers(0, 256, (*shape, 3)).astype(np.uint8),
        normal=codes.astype(np.uint8),
        length=r.integers(1, 9, shape).astype(np.uint8),
        coverage=r.integers(1, 17, shape).astype(np.uint8),
        connected=r.integers(0, 4, shape).astype(np.uint8),
        objects=r.integers(1, 1 << 31, shape).astype(np.uint32),
    )


def camera_towards(number: int, away: float, off: float = 0.3) -> Camera:
    """Looks at the middle of the cell from about the direction of that number."""
    middle = np.array(GRID.corner) + 8
    eye = middle + away * (np.array(DIRECTIONS[number].vector) + np.array([off, 0.1, -off]))
    return Camera(tuple(eye), tuple(middle), 40.0)


@pytest.mark.parametrize("number", [0, 4, 13, 21, 25])
@pytest.mark.parametrize("away", [12.0, 30.0, 150.0])
@pytest.mark.parametrize("clipped", [False, True])
def test_equals_plain_twin(number: int, away: float, clipped: bool) -> None:
    compare_with_twin(number, away, clipped, Splats.COVERED)


@pytest.mark.parametrize("away", [12.0, 150.0])
@pytest.mark.parametrize("splats", list(Splats))
def test_shapes_equal_plain_twin(splats: Splats, away: float) -> None:
    compare_with_twin(13, away, False, splats)


def compare_with_twin(number: int, away: float, clipped: bool, splats: Splats) -> None:
    layer, size = random_layer(number, number), (160, 120)
    camera = camera_towards(number, away)
    box = np.array([GRID.corner, np.array(GRID.corner) + np.array([8.0, 16.0, 9.5])]) if clipped else None
    frame, plain = Frame.empty(camera, size, 1, objects=True), PlainFrame(camera, size)
    frame.splat(layer, DIRECTIONS[number], GRID, 0, Light(), box, splats)
    splat(plain, splats.applied(layer), DIRECTIONS[number], GRID, 0, box, splats)
    assert np.isfinite(plain.depth).sum() > 10
    objects = np.zeros(size[::-1], np.uint32)
    for at, pixel in plain.pixel.items():
        objects[at] = layer.objects[pixel]
    # Single precision decides differently where a sample lies on the rim of a splat.
    same = objects == frame.objects
    assert (~same).sum() <= 1 + 0.005 * np.isfinite(plain.depth).sum()
    seen = same & np.isfinite(plain.depth)
    assert np.allclose(frame.depth[seen], plain.depth[seen], rtol=1e-5)


def test_surface_holds_albedo_light_and_normal() -> None:
    layer = random_layer(3, 25)
    camera, light = camera_towards(25, 12.0), Light(azimuth=80.0, elevation=50.0)
    frame, plain = Frame.empty(camera, (160, 120), 1, normals=True), PlainFrame(camera, (160, 120))
    frame.splat(layer, DIRECTIONS[25], GRID, 0, light)
    splat(plain, layer, DIRECTIONS[25], GRID, 0)
    wrong = 0
    for (y, x), at in plain.pixel.items():
        surface = frame.surface[y, x]
        packed = np.array([surface & 255, surface >> 8 & 255, surface >> 16 & 255])
        wrong += not np.array_equal(packed, layer.color[at])
        if layer.connected[at] & 2:
            assert surface >> 24 == 255 or wrong
        elif np.array_equal(packed, layer.color[at]):
            n = np.array([frame.normal[y, x] >> s & 1023 for s in (0, 10, 20)]) / 511.0 - 1
            mean = n / np.linalg.norm(n) * layer.length[at] / 8
            if not layer.connected[at] & 1:
                mean = as_seen(mean, layer, at, camera)
            assert abs((surface >> 24) / 254 - lambert(mean, light)) < 0.006
    assert wrong <= 0.005 * len(plain.pixel) + 1


def as_seen(mean: np.ndarray, layer: OrthoLayer, at: tuple[int, int], camera: Camera) -> np.ndarray:
    """The mean normal of a loose pixel of direction 25 from the eye; mean: turned to the eye already."""
    u, v, w = DIRECTIONS[25].axes
    j, i = at
    steps = layer.x + i + 0.5, layer.y + j + 0.5, (layer.depth_base + int(layer.depth[at])) / 8
    point = np.array(GRID.corner) + GRID.pitch(0) * (steps[0] * u + steps[1] * v + steps[2] * w)
    towards = camera.eye - point
    return seen_from(mean * (1 if mean @ w < 0 else -1), -w, towards / np.linalg.norm(towards))


def leaves(count: int, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals of leaves that face everywhere, turned to a camera, and how much of each it sees."""
    normals = np.random.default_rng(5).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = normals @ camera
    return normals * np.sign(facing)[:, None], np.abs(facing)


@pytest.mark.parametrize("flat", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("aside", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("azimuth", [0.0, 90.0, 180.0])
def test_leaves_are_lit_from_every_side_as_the_eye_sees_them(flat: float, aside: float, azimuth: float) -> None:
    """A view's mean normals tell an eye far aside how bright leaves are that face everywhere, a share of them flat."""
    light = Light(azimuth=azimuth, elevation=30.0)
    camera, surface = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    eye = np.array([0.0, np.sin(np.radians(aside)), np.cos(np.radians(aside))])
    pointed, area = leaves(200_000, camera)
    mean = (1 - flat) * (pointed * area[:, None]).sum(0) / area.sum() + flat * surface
    turned, seen = leaves(200_000, eye)
    bright = (np.maximum(turned @ light.sun, 0) * seen).sum() / seen.sum()
    expected = (1 - flat) * bright + flat * max(0.0, surface @ light.sun)
    assert lambert(seen_from(mean, camera, eye), light) == pytest.approx(expected, abs=0.06 if 0 < flat < 1 else 0.015)


def filled_by_discs(radius: float) -> float:
    """Share of a plane that discs of that radius about the points of the unit grid fill; radius up to the square root
    of a half. Each reaches into four neighbours' squares by a segment."""
    if radius <= 0.5:
        return float(np.pi * radius**2)
    segment = radius**2 * np.arccos(0.5 / radius) - 0.5 * np.sqrt(radius**2 - 0.25)
    return float(np.pi * radius**2 - 4 * segment)


def test_footprints_fill_the_share_they_stand_for() -> None:
    for sixteenths, shrunk in enumerate(FOOTPRINT):
        assert filled_by_discs(shrunk * np.sqrt(0.5)) == pytest.approx(sixteenths / 16, abs=2e-4)


def shown_share(coverage: int, samples: float) -> float:
    """Share that is drawn of a square of equal loose pixels, seen from above with so many samples across a pixel."""
    shape = 512, 512
    layer = OrthoLayer(
        0, 0, 0, np.full(shape, 8, np.uint16), np.full((*shape, 3), 128, np.uint8), np.full((*shape, 2), 32, np.uint8),
        np.full(shape, 8, np.uint8), np.full(shape, coverage, np.uint8), np.zeros(shape, np.uint8),
    )  # fmt: skip
    grid = Grid(512.0, 512, (0.0, 0.0, 0.0), (0, 0, 0))
    # Turned about the view axis, so that pixels and samples do not fall into step.
    camera = Camera((256.0, -256.0, 4000.0), (256.5, -255.0, 0.0), 2 * float(np.degrees(np.arctan(150 / 4000))))
    frame = Frame.empty(camera, (round(300 * samples), round(300 * samples)), 1)
    frame.splat(layer, principal(TOP), grid, 0, Light())
    return float(np.isfinite(frame.depth).mean())


@pytest.mark.parametrize("coverage", [1, 2, 5, 9, 13, 16])
@pytest.mark.parametrize("samples", [0.3, 0.6, 0.9, 2.3, 5.4])
def test_a_canopy_keeps_its_cover_at_any_distance(coverage: int, samples: float) -> None:
    """samples: of the frame across a pixel, so that splats are thinner than one or many wide."""
    # Pixels of nearly a sample leave a few samples of the turned grid without a middle of their own.
    tolerance = 0.06 if samples == 0.9 else 0.03
    assert shown_share(coverage, samples) == pytest.approx(coverage / 16, abs=tolerance)


def test_nothing_behind_the_eye() -> None:
    """From within the content: what lies behind is left out, what lies before is drawn in front of the eye."""
    camera = Camera((1008.0, -1992.0, 18.0), (1100.0, -1992.0, 18.0), 60.0)
    frame, plain = Frame.empty(camera, (64, 64), 1), PlainFrame(camera, (64, 64))
    drawn = frame.splat(random_layer(1, 0), DIRECTIONS[0], GRID, 0, Light())
    splat(plain, random_layer(1, 0), DIRECTIONS[0], GRID, 0)
    assert 0 < drawn < random_layer(1, 0).valid.sum()
    assert np.isfinite(frame.depth).sum() == pytest.approx(np.isfinite(plain.depth).sum(), abs=20)
