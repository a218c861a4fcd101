"""BlockMaps cast by the reference renderer: without holes, and like the triangles that they were made from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bake.scenes import scene_of
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import psnr
from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.scene.model import Material, Mesh, Scene
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.picture import Picture
from farfield.view.shading import Light
from farfield.view.truth import TruthOptions, draw_truth
from represent.blockmaps import EXTENT, blockmap_of_town, town

SIDE, TEXEL = 16, 4.0
SIZE = (160, 120)
ROOFS = {200: ((16.0, 16.0), (48.0, 48.0)), 90: ((0.0, 0.0), (64.0, 16.0))}
"""Codes, and from where to where they reach."""
SUPERSAMPLING = 4
LEAST_PSNR = {"16:64": 15.0, "32:192": 19.0, "64:256": 22.5}
"""dB of what is seen of a town, a texel being 5.4, 2.7 and 1.4 pixels wide."""


def flat_roofs() -> CastableMap:
    """Ground and two roofs: the highest point and one of the heights that rays leap to."""
    codes = np.full((SIDE, SIDE), 1, np.uint8)
    for code, ((west, south), (east, north)) in ROOFS.items():
        codes[int(south / TEXEL) : int(north / TEXEL), int(west / TEXEL) : int(east / TEXEL)] = code
    size, colors = BlockMapSize(SIDE, 64), np.zeros((SIDE, SIDE + 64, 3), np.uint8)
    rim, turns = np.zeros((4, SIDE), np.uint8), np.empty(0, np.uint8)
    blockmap = BlockMap(size, 0.3, 0.1, codes, None, rim, 5, 3, 100, True, colors, turns)
    turns = np.zeros(len(blockmap.unfolded.sides), np.uint8)
    return CastableMap.of(replace(blockmap, turns=turns), np.full(3, SIDE * TEXEL))


def test_flat_roofs_have_no_holes() -> None:
    """Rays that come in by the upper face of the box, or leap down to a roof, end on it whatever the rounding."""
    castable, chance = flat_roofs(), np.random.default_rng(1)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    seen = 0
    for _ in range(12):
        eye = np.array([*chance.uniform(-100, 160, 2), chance.uniform(22, 300)])
        frame = Frame.empty(Camera(tuple(eye), (32, 32, 10), 40.0), SIZE, 1)
        draw_blockmap(frame, castable, np.zeros(3), Light())
        to_ray = np.linalg.inv(frame.camera.matrix(SIZE)[:, :3])
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ to_ray.T
        for code, (lower, upper) in ROOFS.items():
            depth = (castable.blockmap.low + (code - 1) * castable.blockmap.step - eye[2]) / rays[..., 2]
            place = (eye + depth[..., None] * rays)[..., :2]
            on_roof = ((place > np.array(lower) + 0.01) & (place < np.array(upper) - 0.01)).all(axis=-1) & (depth > 0)
            # The other roof may stand before it.
            shown = on_roof & (frame.depth > depth - 0.5)
            np.testing.assert_allclose(frame.depth[shown], depth[shown], atol=1e-2)
            seen += int(shown.sum())
    assert seen > 2000


def scene_of_town() -> Scene:
    """What BlockMaps of the town are made from."""
    chunk = town(1)
    mesh = Mesh(
        chunk.positions.astype(np.float64), chunk.triangles, chunk.normals, (Material("", (1.0, 1.0, 1.0, 1.0)),),
        np.zeros(len(chunk.triangles), np.uint16), colors=chunk.colors,
        triangle_object=chunk.objects - 1, object_count=int(chunk.objects.max()),
    )  # fmt: skip
    return scene_of((mesh, [(0.0, 0.0, 0.0)]))


def pixels_of(picture: Picture) -> np.ndarray:
    """(h, w, 3) uint8."""
    return picture.pixels(Light().sky_linear)[..., :3]


@pytest.mark.parametrize("azimuth", [0.4, 1.9])
def test_the_finer_a_map_and_the_more_it_tells_the_more_it_is_like_the_true_picture(azimuth: float) -> None:
    camera = Camera((64 + 300 * np.cos(azimuth), 64 + 300 * np.sin(azimuth), 140.0), (64.0, 64.0, 10.0), 30.0)
    truth = draw_truth(scene_of_town(), camera, SIZE, TruthOptions(SUPERSAMPLING))

    def likeness(size: str, by_area: bool = True, sloped: bool = True) -> float:
        blockmap, frame = blockmap_of_town(size, 1, by_area, sloped)[1], Frame.empty(camera, SIZE, SUPERSAMPLING)
        draw_blockmap(frame, CastableMap.of(blockmap, np.array(EXTENT)), np.zeros(3), Light())
        # Beside the town it is what stands in other cells that hides the sides of the ground.
        return psnr(pixels_of(truth), pixels_of(frame.develop(Light())), truth.alpha == 1)

    found = [likeness(size) for size in LEAST_PSNR]
    assert all(one > least for one, least in zip(found, LEAST_PSNR.values(), strict=True)), found
    assert found == sorted(found)
    assert likeness("64:256", by_area=False) < found[-1] - 1
    assert likeness("64:256", sloped=False) < found[-1] - 0.1
