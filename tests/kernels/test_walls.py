"""What is seen on walls of BlockMaps, against lines that are cut with every triangle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.walls import SAMPLES, find_walls, paint_walls
from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.represent.blockmap.build import Square, build_blockmap, ends_of
from farfield.represent.chunk import Chunk, merge
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material
from represent.blockmaps import EXTENT, town

MATERIALS = MaterialTable.build([Material("", (1.0, 1.0, 1.0, 1.0))])
SIZE = BlockMapSize(32, 192)
N = SIZE.side
NOTHING = np.float32(-3.0e38)


@dataclass(frozen=True, slots=True)
class Samples:
    """Of all walls of a map."""

    blockmap: BlockMap
    places: NDArray[np.int32]
    starts: NDArray[np.int32]
    heights: NDArray[np.float32]
    texel: NDArray[np.float32]
    nearest: NDArray[np.float32]
    found: NDArray[np.int32]

    @classmethod
    def of(cls, chunk: Chunk, by_area: bool) -> Samples:
        """As `find_walls` finds them in a chunk."""
        square = Square(*EXTENT)
        blockmap = build_blockmap(chunk, MATERIALS, square, SIZE, by_area)
        assert blockmap is not None
        places = blockmap.unfolded.places.reshape(-1, 3)
        across = blockmap.unfolded.across
        counts = places[:, 2] * SAMPLES * across * SAMPLES
        starts = (np.cumsum(counts) - counts).astype(np.int32)
        nearest, found = np.full(counts.sum(), NOTHING), np.full(counts.sum(), -1, np.int32)
        texel, heights = square.texel(N), ends_of(blockmap)
        find_walls(chunk.surface, places, starts, heights, N, across, texel, nearest, found)
        return cls(blockmap, places, starts, heights, texel, nearest, found)

    def line(self, side: int, number: int) -> tuple[int, float, float, float, float, int]:
        """Axis along which a sample is looked at, where it is along the other and up, from where to where, sense."""
        k, i, j = side & 3, (side >> 2) % N, (side >> 2) // N
        axis, across = k >> 1, self.blockmap.unfolded.across
        row, column = divmod(number, SAMPLES * across)
        upper, lower = self.heights[side].astype(float)
        along = ((j if axis == 0 else i) + (column + 0.5) / (SAMPLES * across)) * float(self.texel[1 - axis])
        up = upper - (row + 0.5) * (upper - lower) / (SAMPLES * self.places[side, 2])
        middle, beside = i if axis == 0 else j, (i if axis == 0 else j) + (1 if k & 1 else -1)
        first, last = sorted(((middle + 0.5) * self.texel[axis], (beside + 0.5) * self.texel[axis]))
        return axis, along, up, float(first), float(last), 1 if k & 1 else -1


def crossed(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def cuts(chunk: Chunk, axis: int, along: float, up: float) -> list[tuple[float, int]]:
    """Where a line parallel to an axis meets triangles, and which."""
    corners = chunk.positions[chunk.triangles].astype(np.float64)
    flat = corners[:, :, [1 - axis, 2]] - [along, up]
    area = crossed(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.stack([crossed(flat[:, (n + 1) % 3], flat[:, (n + 2) % 3]) for n in range(3)], axis=1)
        weights /= area[:, None]
    hit = np.flatnonzero((np.abs(area) > 1e-9) & (weights >= 0).all(axis=1))
    return [(float(weights[t] @ corners[t, :, axis]), int(t)) for t in hit]


@pytest.mark.parametrize("by_area", [False, True])
def test_samples_show_the_nearest_surface_between_two_texels(by_area: bool) -> None:
    chunk = town(3)
    samples = Samples.of(chunk, by_area)
    sides = np.flatnonzero(samples.places[:, 2])
    others = seen = 0
    for side in sides[::3].tolist():
        count = samples.places[side, 2] * SAMPLES * samples.blockmap.unfolded.across * SAMPLES
        for number in range(0, count, 5):
            axis, along, up, first, last, sense = samples.line(side, number)
            met = [(sense * at, t) for at, t in cuts(chunk, axis, along, up) if first <= at <= last]
            found = samples.nearest[samples.starts[side] + number]
            seen += bool(met)
            # Along edges of triangles either, or none, may be met.
            others += not np.isclose(found, max(met)[0], atol=1e-2) if met else found != NOTHING
    assert seen > 100
    assert others <= 0.02 * seen


def test_texels_are_the_mean_of_their_samples_and_normals_face_the_looker() -> None:
    chunk = town(3)
    samples = Samples.of(chunk, by_area=True)
    own = samples.blockmap.unfolded
    sums, normals = np.zeros((N, N + SIZE.columns, 4), np.float32), np.zeros((4 * N * N, 3), np.float32)
    sides = np.flatnonzero(samples.places[:, 2]).astype(np.int32)
    paint_walls(
        chunk.surface, MATERIALS.arrays, sides, samples.places, samples.starts, samples.heights, N, own.across,
        samples.texel, samples.nearest, samples.found, sums, normals,
    )  # fmt: skip
    expected = np.zeros_like(sums)
    corners = chunk.positions[chunk.triangles].astype(np.float64)
    unit = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    colors = LINEAR_OF_BYTE[chunk.colors[chunk.triangles[:, 0], :3]]
    for side in sides.tolist():
        column, top, rows = samples.places[side].tolist()
        total = np.zeros(3)
        for number in range(rows * SAMPLES * own.across * SAMPLES):
            at = samples.starts[side] + number
            if samples.found[at] < 0:
                continue
            row, across = number // (SAMPLES * own.across), number % (SAMPLES * own.across)
            texel = expected[top + row // SAMPLES, column + across // SAMPLES]
            texel[:3] += colors[samples.found[at]]
            texel[3] += 1
            axis, *_, sense = samples.line(side, number)
            total += unit[samples.found[at]] * (1 if unit[samples.found[at], axis] * sense > 0 else -1)
        np.testing.assert_allclose(normals[side], total, atol=1e-3)
        assert total[(side & 3) >> 1] * (1 if side & 1 else -1) >= 0
    np.testing.assert_allclose(sums, expected, atol=1e-3)


def prism(foot: NDArray[np.float64], low: float, high: float) -> Chunk:
    """Walls and roof over a convex foot, counter-clockwise; wall number k has the colour (40 k, 90, 200 - 40 k)."""
    count = len(foot)
    after = np.roll(foot, -1, axis=0)
    walls = [[[*a, low], [*b, low], [*b, high], [*a, high]] for a, b in zip(foot, after, strict=True)]
    positions = np.concatenate([np.array(walls).reshape(-1, 3), np.c_[foot, np.full(count, high)]])
    quads = (4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    fan = 4 * count + np.array([[0, k, k + 1] for k in range(1, count - 1)])
    colors = np.full((len(positions), 4), 255, np.uint8)
    colors[: 4 * count, :3] = np.array([[40 * k, 90, 200 - 40 * k] for k in range(count)]).repeat(4, axis=0)
    colors[4 * count :, :3] = (250, 240, 10)
    triangles = np.concatenate([quads, fan]).astype(np.uint32)
    return Chunk(
        positions.astype(np.float32), np.tile(np.float32([0, 0, 1]), (len(positions), 1)),
        np.empty((0, 2), np.float32), colors, triangles, np.zeros(len(triangles), np.uint32),
        np.full(len(triangles), 5, np.uint32),
    )  # fmt: skip


_WHOLE = prism(np.array([[0.0, 0.0], [128.0, 0.0], [128.0, 128.0], [0.0, 128.0]]), -0.001, 0.0)
FLOOR = replace(_WHOLE, triangles=_WHOLE.triangles[-2:], materials=_WHOLE.materials[:2], objects=_WHOLE.objects[:2])


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.1])
def test_walls_of_a_prism_have_its_colours_and_its_normals(turn: float) -> None:
    flat = np.array([[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, 20.0]])
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    chunk = prism(flat @ rotation + 64, 0.0, 40.0)
    blockmap = build_blockmap(merge([chunk, FLOOR]), MATERIALS, Square(*EXTENT), SIZE)
    assert blockmap is not None
    own, n = blockmap.unfolded, N
    outward = turn + np.array([-np.pi / 2, 0, np.pi / 2, np.pi])
    checked = 0
    for side in own.sides.tolist():
        j, i, k = side // 4 // n, side // 4 % n, side % 4
        angle = float(blockmap.azimuths[j, i, k])
        away = np.abs((angle - outward + np.pi) % (2 * np.pi) - np.pi)
        wall = int(np.argmin(away))
        column, top, rows = own.places[j, i, k].tolist()
        shown = blockmap.colors[top : top + rows, n + column : n + column + own.across].reshape(-1, 3).astype(int)
        # Near the corners of the house a texel may show two walls.
        if (np.abs(shown - [40 * wall, 90, 200 - 40 * wall]) <= 2).all():
            assert away[wall] < np.pi / 32
            checked += 1
    assert checked > 0.75 * len(own.sides)


@pytest.mark.parametrize("at", [64.0, 66.0, 65.0, 65.9])
def test_walls_are_seen_wherever_they_stand_in_a_texel(at: float) -> None:
    """In its middle too, where the surface belongs to both sides of it."""
    chunk = prism(np.array([[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, 20.0]]) + at, 0.0, 40.0)
    samples = Samples.of(merge([chunk, FLOOR]), by_area=True)
    walls = np.flatnonzero(samples.places[:, 2])
    first = np.append(samples.starts, len(samples.found))
    seen = [float((samples.found[first[side] : first[side + 1]] >= 0).mean()) for side in walls.tolist()]
    # At a corner the wall may end in the texel's middle, or nearly.
    assert min(seen) >= 0.25
    assert np.mean(np.array(seen) == 1) > 0.8
