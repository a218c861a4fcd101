"""BlockMaps cast by the reference renderer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farfield.geometry.cameras import Camera
from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.shading import Light

SIDE, TEXEL = 16, 4.0
SIZE = (160, 120)
ROOFS = {200: ((16.0, 16.0), (48.0, 48.0)), 90: ((0.0, 0.0), (64.0, 16.0))}
"""Codes, and from where to where they reach."""


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
