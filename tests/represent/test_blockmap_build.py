"""BlockMaps of houses of which everything is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from farfield.represent.blockmap.blockmap import SIZES, BlockMap
from farfield.represent.blockmap.build import TALL, Square, build_blockmap, fitted_to
from farfield.represent.blockmap.unfolding import DENSITIES
from farfield.represent.chunk import Chunk, merge
from represent.prisms import GROUND, SQUARE, WHITE, House, chunk_of, random_town

N = 32
WEST, EAST, SOUTH, NORTH = range(4)
LOW = House((30.7, 30.4), (40.0, 24.0), 6.0)
HIGH = House((90.3, 60.7), (22.0, 30.0), 41.0, color=(30, 80, 160))


def built(
    chunk: Chunk, by_area: bool = True, sloped: bool = True, number: int = 1, square: Square = SQUARE
) -> BlockMap:
    found = build_blockmap(chunk, WHITE, square, SIZES[number], by_area, sloped)
    assert found is not None
    return found


def middles(square: Square = SQUARE, n: int = N) -> NDArray[np.float64]:
    """(n n, 2) metres."""
    j, i = np.mgrid[:n, :n] + 0.5
    return np.stack([i.ravel() * square.width / n, j.ravel() * square.depth / n], axis=1)


def heights_of(houses: list[House]) -> NDArray[np.float64]:
    """(n, n) in the middle of each texel."""
    all_of_them = [house.height(middles()) for house in houses]
    return np.maximum(np.max(all_of_them, axis=0), 0.0).reshape(N, N)


@pytest.mark.parametrize("by_area", [False, True])
def test_heights_ids_and_colours_are_those_in_the_middle_of_a_texel(by_area: bool) -> None:
    houses = random_town(5, gables=False)
    found = built(chunk_of(houses), by_area)
    expected = heights_of(houses)
    assert (np.abs(found.heights - expected) <= found.step / 2 + 1e-3).all()
    assert found.low == 0
    assert found.step == pytest.approx(expected.max() / 254, rel=0.01)
    assert found.objects is not None
    owner = np.argmax([np.zeros(N * N), *(house.height(middles()) for house in houses)], axis=0).reshape(N, N)
    np.testing.assert_array_equal(found.objects, owner + 1)
    shown = found.colors[:, :N].astype(int)
    roof = [240, 100, 70]
    assert (np.abs(shown - np.where(owner[..., None] > 0, roof, GROUND)) <= 1).mean() > 0.995


def test_colours_of_a_top_are_the_mean_of_what_is_as_high() -> None:
    """Of half of a texel of ground and half of a low step, not of the wall beside it."""
    step = House((64.7, 33.0), (4.0, 100.0), 0.5, color=(210, 210, 210))
    found = built(chunk_of([step, HIGH]))
    assert found.codes[5, 16] > 0
    shown = found.colors[5, 16].astype(int)
    assert (shown > GROUND).all()
    assert (shown < 250).all()
    edge = np.flatnonzero(found.codes[20, :N] > 200)[0]
    assert (np.abs(found.colors[20, edge - 1].astype(int) - GROUND) <= 1).all()


def test_gables_slope_as_they_do() -> None:
    house = House((64.7, 48.0), (60.0, 40.0), 10.0, ridge=20.0)
    found = built(chunk_of([house]))
    assert found.slopes is not None
    inside = house.height(middles()).reshape(N, N) > 0
    south = inside & (np.arange(N)[:, None] < N // 2)
    np.testing.assert_array_equal(found.slopes[south], np.broadcast_to([0, 16], (south.sum(), 2)))
    north = inside & ~south
    np.testing.assert_array_equal(found.slopes[north], np.broadcast_to([0, -16], (north.sum(), 2)))
    assert not found.slopes[~inside].any()
    assert built(chunk_of([house]), sloped=False).slopes is None


def test_what_is_too_steep_is_flat() -> None:
    found = built(chunk_of([House((64.0, 48.0), (60.0, 6.0), 5.0, ridge=40.0)]))
    assert found.slopes is None


@pytest.mark.parametrize("by_area", [False, True])
def test_walls_have_their_colours_and_normals(by_area: bool) -> None:
    found = built(chunk_of([LOW, HIGH]), by_area)
    own, checked = found.unfolded, 0
    for j, i, k in np.argwhere(own.is_wall).tolist():
        house = HIGH if i > N // 2 else LOW
        column, top, rows = own.places[j, i, k].tolist()
        upper, lower = found.heights[j, i], 0.0
        if not by_area:
            # A column is as high as the range of heights: what is above the wall is nothing that is seen.
            first = int(np.ceil(rows * (1 - (upper - lower) / (254 * found.step))))
            top, rows = top + first, rows - first
        shown = found.colors[top : top + rows, N + column : N + column + own.across].reshape(-1, 3).astype(int)
        assert np.abs(shown - house.color).max() <= 2
        sides = own.is_wall[j, i]
        if by_area or sides.sum() == 1:
            outward = [(-1, 0), (1, 0), (0, -1), (0, 1)][k]
            angle = float(found.azimuths[j, i, k])
            assert (np.cos(angle), np.sin(angle)) == pytest.approx(outward, abs=1e-5)
            checked += 1
    assert checked > 30


def test_turned_walls_have_turned_normals() -> None:
    turn = 0.5
    found = built(chunk_of([House((64.0, 48.0), (60.0, 40.0), 30.0, turn=turn)]))
    faces = turn + np.arange(4) * np.pi / 2
    angles = found.azimuths[found.unfolded.is_wall]
    off = np.abs((angles[:, None] - faces + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    # 64ths of a turn; at corners two walls are seen together.
    assert np.median(off) <= np.pi / 64 + 1e-6
    assert (off < 0.06).mean() > 0.85


def test_walls_on_the_rim_are_walls_where_they_face_outwards() -> None:
    """One ends just at the rim, one goes on in the next cell, which has its wall."""
    ends = House((120.0, 20.5), (15.9, 15.0), 20.0)
    goes_on = chunk_of([House((120.0, 70.0), (16.0, 15.0), 20.0)], ground=None)
    # Without its east wall, which is beyond.
    eastern = (goes_on.positions[goes_on.triangles][:, :, 0] > 127.9).all(axis=1)
    kept = ~eastern
    open_one = Chunk(
        goes_on.positions, goes_on.normals, goes_on.uvs, goes_on.colors, goes_on.triangles[kept],
        goes_on.materials[kept], goes_on.objects[kept],
    )  # fmt: skip
    found = built(merge([chunk_of([ends]), open_one]))
    assert not found.border[[WEST, SOUTH, NORTH]].any()
    rows = np.flatnonzero(found.border[EAST]) * SQUARE.depth / N
    assert rows.min() >= 13 - 3
    assert rows.max() <= 28
    tall = found.codes[:, -1] > 1
    assert tall[N // 2 :].any()
    np.testing.assert_array_equal(found.unfolded.is_wall[: N // 2, -1, EAST][tall[: N // 2]], True)
    assert not found.unfolded.is_wall[N // 2 :, -1, EAST].any()


def test_what_goes_on_above_the_cell_is_inside_and_dark() -> None:
    square = Square(128.0, 96.0, 32.0)
    tower = House((64.0, 48.0), (30.0, 22.0), 90.0, turn=0.4)
    found = built(chunk_of([LOW, tower], square), square=square)
    inside = tower.height(middles()).reshape(N, N) > 0
    assert (np.abs(found.heights[inside] - 32.0) <= found.step).all()
    assert found.objects is not None
    assert (found.objects[inside] == 3).all()
    assert (found.objects[~inside] != 3).all()
    assert (found.colors[:, :N][inside] == found.colors[N // 2, N // 2]).all()
    assert found.slopes is None


def test_what_goes_on_above_the_cell_and_beside_it_is_inside_to_the_rim() -> None:
    """A body that covers the western half of the cell, of which only one wall stands in it."""
    square = Square(128.0, 96.0, 32.0)
    chunk = chunk_of([House((64.3, 48.0), (129.0, 96.0), 90.0)], square)
    corners = chunk.positions[chunk.triangles]
    kept = (corners[:, :, 2] == 0).all(axis=1) | (corners[:, :, 0] > 128).all(axis=1)
    moved = replace(
        chunk, positions=chunk.positions - np.float32([64.5, 0, 0]) * (chunk.positions[:, :1] > 128),
        triangles=chunk.triangles[kept], materials=chunk.materials[kept], objects=chunk.objects[kept],
    )  # fmt: skip
    found = built(moved, square=square)
    inside = middles()[:, 0].reshape(N, N) < 64
    np.testing.assert_array_equal(found.heights > 31, inside)


def test_walls_that_are_objects_of_their_own_are_a_body_together() -> None:
    square, tower = Square(128.0, 96.0, 32.0), House((64.3, 48.0), (30.0, 22.0), 90.0, turn=0.4)
    chunk = chunk_of([tower], square)
    found = built(replace(chunk, objects=np.arange(1, len(chunk.objects) + 1, dtype=np.uint32)), square=square)
    np.testing.assert_array_equal(found.heights > 31, tower.height(middles()).reshape(N, N) > 0)


def test_what_is_a_sheet_is_no_body() -> None:
    """A sign that reaches through the cell's upper side, with one side, has nothing behind it."""
    square, sign = Square(128.0, 96.0, 32.0), House((64.3, 48.0), (30.0, 22.0), 90.0)
    chunk = chunk_of([sign], square)
    corners = chunk.positions[chunk.triangles]
    for axis, at in ((0, 79.3), (0, 49.3), (1, 59.0), (1, 37.0)):
        kept = (corners[:, :, 2] == 0).all(axis=1) | (np.abs(corners[:, :, axis] - at) < 0.01).all(axis=1)
        one = replace(
            chunk, triangles=chunk.triangles[kept], materials=chunk.materials[kept], objects=chunk.objects[kept]
        )
        assert kept.sum() == 4
        assert built(one, square=square).codes.max() == 1


def test_without_ground_there_is_nothing_beside_houses_and_walls_go_down_to_the_lowest_point() -> None:
    found = built(chunk_of([LOW, HIGH], ground=None))
    expected = heights_of([LOW, HIGH])
    np.testing.assert_array_equal(found.codes > 0, expected > 0)
    assert found.low == 0
    assert np.isnan(found.heights[expected == 0]).all()
    edge = found.unfolded.is_wall & (expected > 0)[..., None]
    assert edge[..., WEST].sum() == edge[..., EAST].sum() > 0


def with_roofs_apart(chunk: Chunk, overhang: float = 0.0) -> Chunk:
    """The same with roofs that are objects of their own, and larger by a part of their size."""
    corners = chunk.positions[chunk.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_roof = (across[:, 2] > 0.1 * np.linalg.norm(across, axis=1)) & (chunk.objects > 1)
    objects = np.where(is_roof, chunk.objects + 100, chunk.objects).astype(np.uint32)
    positions = chunk.positions.copy()
    for one in np.unique(objects[is_roof]):
        rows = np.unique(chunk.triangles[objects == one])
        middle = (positions[rows, :2].max(axis=0) + positions[rows, :2].min(axis=0)) / 2
        positions[rows, :2] += overhang * (positions[rows, :2] - middle)
    return replace(chunk, objects=objects, positions=positions)


@pytest.mark.parametrize("by_area", [False, True])
@pytest.mark.parametrize("overhang", [0.0, 0.05])
@pytest.mark.parametrize("ridge", [0.0, 12.0])
@pytest.mark.parametrize("ground", [0.0, None])
def test_walls_below_a_roof_that_is_an_object_of_its_own_are_walls(
    by_area: bool, overhang: float, ridge: float, ground: float | None
) -> None:
    chunk = chunk_of([replace(LOW, ridge=ridge), replace(HIGH, turn=0.4)], ground=ground)
    apart = with_roofs_apart(chunk, overhang)
    whole = built(replace(apart, objects=chunk.objects), by_area)
    found = built(apart, by_area)
    assert found.floors is None or found.floors.max() <= 2
    np.testing.assert_array_equal(found.unfolded.is_wall, whole.unfolded.is_wall)
    assert (found.colors == whole.colors).mean() > 0.99


def test_what_hangs_beside_a_house_has_a_floor() -> None:
    """A bridge from house to house, and a roof on nothing."""
    found = built(with_bridge([HIGH, replace(HIGH, middle=(46.0, 70.0))]))
    assert found.floors is not None
    hanging = found.objects == 52
    assert hanging.sum() >= 6
    np.testing.assert_allclose(found.undersides[hanging], 26.0, atol=found.step)
    assert (found.floors[~hanging] <= 2).all()


@pytest.mark.parametrize("ground", [0.0, None])
def test_what_is_wider_than_it_is_high_above_the_ground_stands_on_it(ground: float | None) -> None:
    """The stands of a stadium: below them one would see no ground."""
    stands = replace(LOW, middle=(64.0, 64.0), size=(60.0, 40.0), eaves=20.0)
    found = built(merge([chunk_of([LOW], ground=ground), raised(chunk_of([stands], ground=None), 12.0, 50)]))
    wide = found.objects == 52
    assert wide.sum() > 100
    if ground is None:
        assert found.floors is not None
        np.testing.assert_allclose(found.undersides[wide], 12.0, atol=found.step)
    else:
        assert found.floors is None


def with_bridge(houses: list[House]) -> Chunk:
    """And one between HIGH and what stands west of it: object 52, from 26 to 30 m."""
    bridge = replace(LOW, middle=(64.0, 70.0), size=(14.0, 8.0), eaves=30.0)
    return merge([chunk_of(houses), raised(chunk_of([bridge], ground=None), 26.0, 50)])


def raised(chunk: Chunk, lowest: float, objects: int) -> Chunk:
    """The same with walls that begin so high, and other object ids."""
    positions = np.maximum(chunk.positions, np.float32([-np.inf, -np.inf, lowest]))
    return replace(chunk, positions=positions, objects=chunk.objects + np.uint32(objects))


def test_a_roof_just_below_the_cell_s_upper_side_is_a_roof() -> None:
    under = replace(LOW, eaves=SQUARE.height * (1 - 1e-4))
    found = built(chunk_of([under]))
    inside = found.objects == 2
    assert (np.abs(found.colors[:, :N][inside].astype(int) - [240, 100, 70]) <= 1).mean() > 0.9


@pytest.mark.parametrize("span", [0.02, 0.1, 0.5, 3.0, 100.0])
def test_whatever_is_high_or_low_walls_have_room(span: float) -> None:
    """Of texels of 4 m; a chequerboard has the most walls."""
    codes = np.where(np.add.outer(np.arange(N), np.arange(N)) % 2, 255, 1).astype(np.uint8)
    frame = replace(built(chunk_of([LOW])), codes=codes, step=span / 254, floors=None, slopes=None)
    for finest in (1, 2):
        assert fitted_to(frame, 4.0, finest).unfolded.rows <= N


def test_of_what_is_not_seen_from_above_there_is_none() -> None:
    from_below = chunk_of([], ground=3.0)
    standing = House((64.0, 48.0), (30.0, 22.0), 9.0).faces(0.0, 64.0)[0][:2]
    wall = Chunk(
        np.array(standing).reshape(-1, 3).astype(np.float32), np.tile(np.float32([0, -1, 0]), (6, 1)),
        from_below.uvs, np.full((6, 4), 255, np.uint8), np.arange(6, dtype=np.uint32).reshape(-1, 3),
        np.zeros(2, np.uint32), np.ones(2, np.uint32),
    )  # fmt: skip
    assert build_blockmap(wall, WHITE, SQUARE, SIZES[0]) is None


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("seed", range(3))
def test_walls_have_the_finest_texels_that_there_is_room_for(number: int, seed: int) -> None:
    houses = random_town(seed, gables=False, count=40)
    found = built(chunk_of(houses), number=number)
    n = SIZES[number].side
    assert found.unfolded.rows <= n
    assert found.colors.shape == (n, n + SIZES[number].columns, 3)
    assert len(found.turns) == len(found.unfolded.sides)
    finer = found.density - 1
    texel = (SQUARE.width + SQUARE.depth) / 2 / n
    if finer >= 0 and DENSITIES[finer][0] <= 2:
        scale = round(256 * found.step * TALL[-1] * DENSITIES[finer][0] / DENSITIES[finer][1] / texel)
        other = BlockMap(**{**vars_of(found), "density": finer, "scale": scale})
        assert other.unfolded.rows > n
    assert fitted_to(found, texel).density == found.density


def vars_of(blockmap: BlockMap) -> dict[str, object]:
    """What it is made with."""
    return {name: getattr(blockmap, name) for name in BlockMap.__dataclass_fields__}


def shuffled(chunk: Chunk, seed: int) -> Chunk:
    """The same with the triangles of each object in another order."""
    order = np.lexsort((np.random.default_rng(seed).random(len(chunk.objects)), chunk.objects))
    np.testing.assert_array_equal(chunk.objects[order], chunk.objects)
    return replace(chunk, triangles=chunk.triangles[order], materials=chunk.materials[order])


@pytest.mark.parametrize("by_area", [False, True])
def test_it_is_the_same_whatever_the_order_of_triangles_in_one_object(by_area: bool) -> None:
    on_rim = House((8.1, 70.0), (16.0, 20.0), 12.0)
    chunk = with_bridge([HIGH, replace(HIGH, middle=(46.0, 70.0)), replace(LOW, ridge=14.0, turn=0.3), on_rim])
    one = built(chunk, by_area)
    assert one.floors is not None
    assert one.slopes is not None
    assert one.border.any()
    for seed in range(3):
        for name, other in vars_of(built(shuffled(chunk, seed), by_area)).items():
            np.testing.assert_array_equal(getattr(one, name), other, name)
