"""Rays through BlockMaps, against rays that go through every texel on their way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera
from farfield.kernels.splat import LIGHT_STEPS
from farfield.represent.blockmap.blockmap import BlockMap
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.shading import Light
from kernels.plain_raycast import PlainCaster
from represent.random_maps import DEPTH, WIDTH, random_map

SIZE = (24, 18)


def random_camera(seed: int) -> Camera:
    """From outside, above, between the houses, or below."""
    random = np.random.default_rng(seed)
    eye = random.uniform([-60, -60, -30], [110, 90, 60])
    if seed % 3 == 0:
        eye = random.uniform([1, 1, -1], [WIDTH - 1, DEPTH - 1, 14])
    target = random.uniform([0, 0, -2], [WIDTH, DEPTH, 14])
    return Camera(tuple(eye.tolist()), tuple(target.tolist()), float(random.uniform(20, 90)))


def cast(
    blockmap: BlockMap, camera: Camera, box: NDArray[np.float64] | None = None, leaping: bool = True,
    size: tuple[int, int] = SIZE,
) -> Frame:  # fmt: skip
    """What the kernel draws."""
    castable = CastableMap.of(blockmap, np.array([WIDTH, DEPTH, 99.0]))
    if not leaping:
        castable = replace(castable, distances=np.zeros_like(castable.distances))
    frame = Frame.empty(camera, size, 1, normals=True, objects=True)
    draw_blockmap(frame, castable, np.zeros(3), Light(), box)
    return frame


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6), st.booleans(), st.booleans(), st.sampled_from([0.0, 0.5, 1.0]), st.booleans())
def test_as_the_plain_twin(seed: int, by_area: bool, sloped: bool, hanging: float, boxed: bool) -> None:
    blockmap, camera = random_map(seed, by_area, sloped, hanging=hanging), random_camera(seed)
    box = np.array([[WIDTH / 2, 0, 2.0], [WIDTH, DEPTH / 2, 9.0]]) if boxed else None
    frame = cast(blockmap, camera, box)
    caster, rays, eye = PlainCaster(blockmap, WIDTH, DEPTH), camera.rays(SIZE), np.array(camera.eye)
    light, others = Light(), 0
    for row in range(SIZE[1]):
        for column in range(SIZE[0]):
            hit = caster.cast(eye, rays[row, column], box)
            depth = frame.depth[row, column]
            if hit is None or not np.isclose(depth, hit.t, atol=2e-4, rtol=1e-5):
                others += hit is not None or np.isfinite(depth)
                continue
            surface, i, j = int(frame.surface[row, column]), *hit.texel
            shown = surface & 255, surface >> 8 & 255, surface >> 16 & 255
            lit = round(max(float(light.sun @ hit.normal), 0.0) * LIGHT_STEPS)
            same = shown == hit.color and abs((surface >> 24) - lit) <= 1
            same &= int(frame.objects[row, column]) == int(blockmap.objects[j, i])  # type: ignore[index]
            others += not same and not hit.is_close
    # Rays along edges may be told to be on either side.
    assert others <= 2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("sloped", [False, True])
@pytest.mark.parametrize("hanging", [0.0, 0.5])
def test_leaps_change_nothing(seed: int, sloped: bool, hanging: float) -> None:
    blockmap, camera = random_map(seed, True, sloped, number=2, holes=0.02, hanging=hanging), random_camera(seed)
    one, other = (cast(blockmap, camera, leaping=leaping, size=(160, 120)) for leaping in (True, False))
    same = (one.surface == other.surface) & np.isclose(one.depth, other.depth, rtol=1e-5)
    assert same.mean() > 0.9995


@pytest.mark.parametrize("by_area", [False, True])
def test_what_is_cut_to_a_box_looks_as_before(by_area: bool) -> None:
    """Walls too: where their texels lie does not depend on the box."""
    blockmap, camera = random_map(4, by_area, False), Camera((-30.0, -40.0, 22.0), (20.0, 14.0, 5.0), 40.0)
    whole, parts = cast(blockmap, camera), Frame.empty(camera, SIZE, 1)
    castable, seen = CastableMap.of(blockmap, np.array([WIDTH, DEPTH, 99.0])), 0
    for lower, upper in (((0, 0, 5.0), (WIDTH, DEPTH, 99)), ((0, 0, -9), (20.0, 13.0, 5.0))):
        parts.depth[:], parts.surface[:] = np.inf, 0
        draw_blockmap(parts, castable, np.zeros(3), Light(), np.array([lower, upper]))
        same = np.isfinite(whole.depth) & np.isclose(parts.depth, whole.depth, atol=1e-3)
        assert (parts.surface[same] == whole.surface[same]).all()
        seen += same.sum()
    assert seen > 30


def test_what_lies_behind_is_hidden_and_what_lies_before_is_kept() -> None:
    blockmap, camera = random_map(1, True, False), Camera((-30.0, -40.0, 32.0), (20.0, 14.0, 5.0), 40.0)
    castable, whole = CastableMap.of(blockmap, np.array([WIDTH, DEPTH, 99.0])), cast(blockmap, camera)
    middle = np.float32(np.median(whole.depth[np.isfinite(whole.depth)]))
    frame = Frame.empty(camera, SIZE, 1)
    frame.depth[:], frame.surface[:] = middle, 77
    draw_blockmap(frame, castable, np.zeros(3), Light())
    assert (frame.depth == np.minimum(whole.depth, middle)).all()
    assert ((frame.surface == 77) == (whole.depth >= middle)).all()
    # Again, elsewhere: with the eye it moves as one.
    far = np.array([1e6, -2e6, 500.0])
    moved = Frame.empty(Camera(tuple(far + camera.eye), tuple(far + camera.target), 40.0), SIZE, 1)
    draw_blockmap(moved, castable, far, Light())
    assert np.isclose(moved.depth, whole.depth, rtol=1e-4).mean() > 0.99


def test_no_ray_through_corners_is_lost() -> None:
    """Along diagonals rounding must not lead it to and fro between two texels."""
    n, size = 32, (320, 240)
    blockmap = random_map(5, True, False, number=1, holes=0.0)
    castable = CastableMap.of(blockmap, np.array([float(n), float(n), 99.0]))
    for eye in ((64.0, 64.0, 408.0), (-32.0, 64.0, 408.0), (16.0, 16.0, 200.0), (16.0, 16.0, 90.0)):
        camera = Camera(eye, (eye[0], eye[1], 0.0), 24.0)
        frame, rays = Frame.empty(camera, size, 1), camera.rays(size)
        draw_blockmap(frame, castable, np.zeros(3), Light())
        # What is within the map at both ends of its height.
        ends = [np.array(eye[:2]) + rays[..., :2] * (eye[2] - up) for up in (blockmap.low, blockmap.low + 16)]
        inside = np.all([(end > 0.1) & (end < n - 0.1) for end in ends], axis=(0, -1))
        assert inside.sum() > 500
        assert np.isfinite(frame.depth[inside]).all()
