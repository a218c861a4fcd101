"""Leaves drawn from triangles: no speckles, no gaps, the right layers."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.geometry import normals
from farfield.geometry.directions import PRINCIPAL, TOP, principal
from farfield.octree.grid import CellKey, Grid
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.leaf import draw_leaf
from farfield.scene.model import Material, Mesh, Texture
from represent.shapes import chunk_of, chunks_of, mesh_of, rectangle

GRID = Grid(10.0, 32, (-3.0, 5.0, 0.0), (2, 2, 2))
LOWER = np.array(GRID.corner)
TABLE = MaterialTable.build([Material(base_color=(0.5, 0.25, 0.75, 1.0))])
SEEN_FROM_ABOVE = [n for n, d in enumerate(PRINCIPAL) if d[2] > 0]


def painted(
    meshes: list[Mesh], direction: int, samples: int = 2, layers: int = 1
) -> tuple[dict[tuple[int, int], int], list[OrthoLayer]]:
    """Coverage summed over the layers of all cells, per lattice pixel."""
    total: dict[tuple[int, int], int] = {}
    drawn = []
    for cell, chunk in chunks_of(meshes, GRID, -2, 2).items():
        for layer in draw_leaf(chunk, TABLE, GRID, CellKey(0, *cell), principal(direction), samples, layers):
            drawn.append(layer)
            for j, i in np.argwhere(layer.valid):
                place = int(layer.x + i), int(layer.y + j)
                total[place] = total.get(place, 0) + int(layer.coverage[j, i])
    return total, drawn


def interior(corners: NDArray[np.float64], direction: int) -> list[tuple[int, int]]:
    """Lattice pixels that lie in a parallelogram (3 corners, metres from the grid's corner) as a whole."""
    axes, pitch = principal(direction).axes, GRID.pitch(0)
    o, a, b = (corners @ axes[:2].T) / pitch
    low, high = np.floor([o, a, b, a + b - o]).min(0), np.ceil([o, a, b, a + b - o]).max(0)
    inverse = np.linalg.inv(np.stack([a - o, b - o], 1))
    inside = []
    for y in range(int(low[1]), int(high[1])):
        for x in range(int(low[0]), int(high[0])):
            share = [inverse @ (np.array([x + i, y + j]) - o) for i in (0, 1) for j in (0, 1)]
            if (np.array(share) > 1e-6).all() and (np.array(share) < 1 - 1e-6).all():
                inside.append((x, y))
    return inside


@pytest.mark.parametrize("direction", SEEN_FROM_ABOVE)
@pytest.mark.parametrize("height", [0.0, 10.0, -10.0])
def test_ground_on_a_cell_plane_is_covered_once(direction: int, height: float) -> None:
    corners = np.array([[-17.3, -13.1, height], [19.7, -13.1, height], [-17.3, 18.9, height]])
    ground = rectangle(corners[0] + LOWER, corners[1] - corners[0], corners[2] - corners[0])
    total, drawn = painted([ground], direction)
    inside = interior(corners, direction)
    assert len(inside) > 3000
    assert [total.get(p, 0) for p in inside] == [16] * len(inside)
    for layer in drawn:
        assert {tuple(n) for n in layer.normal[layer.valid]} == {tuple(normal_code(direction, (0, 0, 1)))}
        assert set(layer.length[layer.valid]) == {8}


def normal_code(direction: int, normal: tuple[float, float, float]) -> NDArray[np.uint8]:
    return normals.encode(principal(direction).axes @ np.array(normal) * [1, 1, -1])


@pytest.mark.parametrize("direction", [n for n, d in enumerate(PRINCIPAL) if d[0] != 0])
@pytest.mark.parametrize("x", [0.0, 10.0, -10.0])
def test_a_wall_on_cell_corners_is_covered_once(direction: int, x: float) -> None:
    corners = np.array([[x, -20.0, -20.0], [x, 20, -20], [x, -20, 20]])
    wall = rectangle(corners[0] + LOWER, corners[1] - corners[0], corners[2] - corners[0])
    total, _ = painted([wall], direction)
    inside = interior(corners, direction)
    assert len(inside) > 3000
    assert [total.get(p, 0) for p in inside] == [16] * len(inside)


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_boxes_on_a_ground_leave_no_hole_from_any_direction(samples: int) -> None:
    ground = rectangle(LOWER - [20, 20, 0], [40, 0, 0], [0, 40, 0])
    boxes = []
    for origin, size in (((0, 0, 0), (10, 10, 10)), ((-10, 0, 0), (5, 10, 20)), ((3, -17, 0), (7, 7, 10))):
        box = trimesh.creation.box(size)
        box.apply_translation(LOWER + np.array(origin) + np.array(size) / 2)
        boxes.append(mesh_of(box, flat=True))
    for direction in (TOP, *SEEN_FROM_ABOVE[:3]):
        total, _ = painted([ground, *boxes], direction, samples, 2)
        inside = interior(np.array([[-20.0, -20, 0], [20, -20, 0], [-20, 20, 0]]), direction)
        assert min(total.get(p, 0) for p in inside) >= 16 - (samples == 3)  # ninths do not add up in sixteenths


def test_the_second_layer_holds_what_lies_behind() -> None:
    pitch = GRID.pitch(0)
    top = rectangle(LOWER + [2, 2, 5], [4, 0, 0], [0, 4, 0])
    floor = rectangle(LOWER + [1, 1, 5 - 9 * pitch], [6, 0, 0], [0, 6, 0])
    chunk = chunks_of([top, floor], GRID, 0, 0)[0, 0, 0]
    near, far = draw_leaf(chunk, TABLE, GRID, CellKey(0, 0, 0, 0), principal(TOP))
    step = pitch / 8
    assert set(np.unique((near.depth_base + near.depth[near.valid].astype(int)) * step)) == {-5.0, -5.0 + 9 * pitch}
    assert set(np.unique((far.depth_base + far.depth[far.valid].astype(int)) * step)) == {-5.0 + 9 * pitch}
    assert far.valid.sum() == pytest.approx((4 / pitch) ** 2, rel=0.1)
    assert set(near.objects[near.valid]) == {1, 2}
    assert set(far.objects[far.valid]) == {2}
    assert len(draw_leaf(chunk, TABLE, GRID, CellKey(0, 0, 0, 0), principal(TOP), layers=1)) == 1


def test_samples_that_miss_the_first_layer_count_for_the_second() -> None:
    pitch = GRID.pitch(0)
    half = rectangle(LOWER + [6.5 * pitch, 2, 5], [4, 0, 0], [0, 4, 0])
    floor = rectangle(LOWER + [1, 1, 5 - 9 * pitch], [6, 0, 0], [0, 6, 0])
    chunk = chunks_of([half, floor], GRID, 0, 0)[0, 0, 0]
    near, far = draw_leaf(chunk, TABLE, GRID, CellKey(0, 0, 0, 0), principal(TOP))
    edge = 6 - near.x
    row = near.shape[0] // 2
    assert near.coverage[row, edge - 1 : edge + 2].tolist() == [16, 8, 16]
    column = 6 - far.x
    assert far.coverage[row + near.y - far.y, column] == 16


def test_surfaces_closer_than_the_separation_share_a_layer() -> None:
    pitch = GRID.pitch(0)
    sheets = [rectangle(LOWER + [2, 2, 5 - k * pitch], [4, 0, 0], [0, 4, 0]) for k in range(4)]
    chunk = chunks_of(sheets, GRID, 0, 0)[0, 0, 0]
    assert len(draw_leaf(chunk, TABLE, GRID, CellKey(0, 0, 0, 0), principal(TOP))) == 1


@pytest.mark.parametrize("direction", range(26))
def test_a_ball_has_the_depth_and_normals_of_a_ball(direction: int) -> None:
    ball = trimesh.creation.icosphere(5, radius=4.0)
    middle = LOWER + np.array([25.0, -5, 15])
    ball.apply_translation(middle)
    chunk = chunk_of(mesh_of(ball), GRID, (2, -1, 1))
    assert chunk is not None
    near, far = draw_leaf(chunk, TABLE, GRID, CellKey(0, 2, -1, 1), principal(direction))
    axes, pitch = principal(direction).axes, GRID.pitch(0)
    for layer, side in ((near, -1), (far, 1)):
        j, i = np.nonzero(layer.valid & (layer.coverage == 16))
        u, v = (layer.x + i + 0.5) * pitch, (layer.y + j + 0.5) * pitch
        w = (layer.depth_base + layer.depth[j, i].astype(int)) * pitch / 8
        offset = np.stack([u, v, w], 1) - axes @ (middle - LOWER)
        steep = np.abs(offset[:, 2]) > 1.5
        assert np.abs(np.linalg.norm(offset[steep], axis=1) - 4).max() < pitch / 4
        assert (np.sign(offset[steep][:, 2]) == side).all()
        decoded = normals.decode(layer.normal[j, i][steep])
        expected = offset[steep] / 4 * np.array([1, 1, -1]) * (1 if side < 0 else -1)
        assert np.degrees(np.arccos(np.clip((decoded * expected).sum(1), -1, 1))).max() < 6
    area = near.coverage.sum() / 16 * pitch**2
    assert area == pytest.approx(np.pi * 16, rel=0.01)


def test_colours_come_from_textures_and_unlit_is_flagged() -> None:
    pixels = np.zeros((2, 2, 4), dtype=np.uint8)
    pixels[...] = [[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 255]]]
    square = rectangle(LOWER + [1, 1, 5], [8, 0, 0], [0, 8, 0])
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 1], [1, 0], [0, 0]], dtype=np.float32)
    textured = Mesh(
        square.positions, square.triangles, square.normals, square.materials, square.triangle_material, uvs=uvs
    )
    chunk = chunk_of(textured, GRID, (0, 0, 0))
    assert chunk is not None
    table = MaterialTable.build([Material(texture=Texture(pixels), unlit=True)])
    (layer,) = draw_leaf(chunk, table, GRID, CellKey(0, 0, 0, 0), principal(TOP), layers=1)
    rows, columns = layer.shape
    quarter = [layer.color[r * rows // 4, c * columns // 4].tolist() for r in (1, 3) for c in (1, 3)]
    # v grows downwards in the picture, as do rows of the top view: row 0 of the texture is to the north.
    assert np.abs(np.array(quarter) - [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]).max() <= 60
    assert set(layer.connected[layer.valid]) == {2}


def test_bad_options_are_refused() -> None:
    chunk = chunk_of(rectangle(LOWER + [1, 1, 5], [8, 0, 0], [0, 8, 0]), GRID, (0, 0, 0))
    assert chunk is not None
    for samples, layers in ((0, 1), (9, 1), (2, 3), (2, 0)):
        with pytest.raises(OptionError):
            draw_leaf(chunk, TABLE, GRID, CellKey(0, 0, 0, 0), principal(TOP), samples, layers)
    with pytest.raises(OptionError):
        draw_leaf(chunk, MaterialTable.build([]), GRID, CellKey(0, 0, 0, 0), principal(TOP))
