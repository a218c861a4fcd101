"""The surface kept behind the nearest one, against every fragment of every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from farfield.kernels.crowding import crowding, touching
from farfield.kernels.lanes import LANES
from farfield.kernels.surface import FAR, NOTHING
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview import visibility
from farfield.represent.orthoview.visibility import CROWD, surface_behind
from farfield.scene.model import Material
from kernels import plain_raster

SHAPE = 40, 70
"""Two rows and three columns of tiles, of which the last are cut."""


def scattered(
    seed: int, count: int, size: float, low: tuple[float, float] = (0, 0), high: tuple[float, float] = (70, 40)
) -> NDArray[np.float32]:
    """(3 count, 4) float32 corners of small triangles on the grid of 1/256 sample, each at a depth of its own."""
    r = np.random.default_rng(seed)
    middle = r.uniform(low, high, (count, 1, 2))
    corners = np.clip(middle + r.normal(0, size, (count, 3, 2)), 0, (70, 40))
    screen = np.empty((3 * count, 4), np.float32)
    screen[:, :2] = np.round(corners.reshape(-1, 2) * 256) / 256
    screen[:, 2] = np.repeat(r.permutation(count) * 0.5, 3)
    screen[:, 3] = 1
    return screen


def chunk_of(corners: int) -> Chunk:
    triangles = np.arange(corners, dtype=np.uint32).reshape(-1, 3)
    return Chunk(
        np.zeros((corners, 3), np.float32), np.zeros((corners, 3), np.float32), np.empty((0, 2), np.float32),
        np.empty((0, 4), np.uint8), triangles, np.zeros(len(triangles), np.uint32),
        np.arange(1, len(triangles) + 1, dtype=np.uint32),
    )  # fmt: skip


def found(screen: NDArray[np.float32], behind: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    wide = np.full((SHAPE[0], SHAPE[1] + LANES), np.nan, np.float32)
    wide[:, : SHAPE[1]] = behind
    depth, ids = surface_behind(screen, chunk_of(len(screen)), TABLE, SHAPE, wide)
    return depth.copy(), ids.copy()


def plain(
    screen: NDArray[np.float32], behind: NDArray[np.float32], last: bool
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    triangles = chunk_of(len(screen)).triangles
    if not last:
        return plain_raster.rasterise(screen, triangles, SHAPE[1], SHAPE[0], behind)
    away = screen * np.array([1, 1, -1, 1], np.float32)
    depth, ids = plain_raster.rasterise(away, triangles, SHAPE[1], SHAPE[0])
    missed = (ids == NOTHING) | (-depth <= behind)
    return np.where(missed, float(FAR), -depth), np.where(missed, NOTHING, ids)


TABLE = MaterialTable.build([Material(double_sided=True), Material(double_sided=False)])


def limits(seed: int) -> NDArray[np.float32]:
    """What lies in front: nothing here and there."""
    r = np.random.default_rng(seed)
    return np.where(r.random(SHAPE) < 0.2, FAR, r.uniform(0, 20, SHAPE)).astype(np.float32)


@pytest.mark.parametrize("key_below", [0.0, 1e9], ids=["visibility buffer", "key"])
@pytest.mark.parametrize(("count", "last"), [(60, False), (500, True)])
def test_a_crowd_shows_its_last_surface_else_the_next(
    count: int, last: bool, key_below: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(visibility, "KEY_BELOW", key_below)
    screen, behind = scattered(count, count, 9.0 if last else 4.0), limits(count)
    depth, ids = found(screen, behind)
    expected_depth, expected_ids = plain(screen, behind, last)
    assert (ids != NOTHING).sum() > 200
    assert np.array_equal(ids, expected_ids)
    assert np.allclose(depth, expected_depth)


def test_each_tile_decides_for_itself() -> None:
    """A crowd on the left, few surfaces on the right, sorted and drawn by one call."""
    left, right = scattered(1, 500, 8.0, (0, 0), (28, 40)), scattered(2, 30, 3.0, (36, 0), (70, 40))
    left[:, 0] = np.minimum(left[:, 0], 31)
    right[:, 0] = np.maximum(right[:, 0], 33)
    screen, behind = np.concatenate([left, right]), limits(3)
    _, ids = found(screen, behind)
    _, lasts = plain(screen, behind, last=True)
    _, nexts = plain(screen, behind, last=False)
    assert np.array_equal(ids[:, :32], lasts[:, :32])
    assert np.array_equal(ids[:, 32:], nexts[:, 32:])
    assert not np.array_equal(lasts[:, :32], nexts[:, :32])
    assert CROWD < 10


def test_the_inside_of_bodies_is_no_crowd() -> None:
    """One-sided triangles that turn away do not count; those of two-sided materials and the facing ones do."""
    # On the screen y runs down: counter-clockwise as the camera sees it turns from +y to +x.
    screen = np.array([[0, 0, 5, 1], [0, 8, 5, 1], [8, 0, 5, 1], [0, 0, 6, 1], [8, 0, 6, 1], [0, 8, 6, 1]], np.float32)
    triangles = np.arange(6, dtype=np.uint32).reshape(2, 3)
    share = 32 / 1024
    for material, surfaces, seen in ((1, share, [0]), (0, 2 * share, [0, 1])):
        materials = np.full(2, material, np.uint32)
        counted, names = np.empty((1, 1), np.float32), np.empty(2, np.uint32)
        crowding(screen, triangles, materials, TABLE.double_sided, 32, 32, 1, counted)
        assert np.isclose(counted[0, 0], surfaces)
        count = touching(screen, triangles, materials, TABLE.double_sided, counted, np.float32(0), True, names)
        assert names[:count].tolist() == seen


def test_a_sample_of_the_triangles_tells_crowds() -> None:
    screen = scattered(5, 4000, 2.0)
    triangles, materials = np.arange(len(screen), dtype=np.uint32).reshape(-1, 3), np.zeros(4000, np.uint32)
    every, some = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    crowding(screen, triangles, materials, TABLE.double_sided, *SHAPE, 1, every)
    crowding(screen, triangles, materials, TABLE.double_sided, *SHAPE, 4, some)
    assert np.allclose(every, some, rtol=0.25)
    assert np.isclose(every[0, :2].mean(), some[0, :2].mean(), rtol=0.1)


def test_a_crowd_shows_no_underside() -> None:
    """Behind a crowd of leaves lies the ground, a closed slab: its upper side is kept, not its lower one."""
    leaves = scattered(4, 500, 8.0)
    slab = np.array([[0, 0, 900], [0, 40, 900], [70, 0, 900], [0, 0, 950], [70, 0, 950], [0, 40, 950]])
    slab = np.concatenate([slab, np.ones((6, 1))], axis=1).astype(np.float32)
    screen = np.concatenate([leaves, slab])
    chunk = chunk_of(len(screen))
    chunk = replace(chunk, materials=np.repeat(np.array([0, 1], np.uint32), [500, 2]))
    behind = np.zeros((SHAPE[0], SHAPE[1] + LANES), np.float32)
    _, ids = surface_behind(screen, chunk, TABLE, SHAPE, behind)
    assert (ids[:20, :20] == 500).all()
    assert not (ids == 501).any()
