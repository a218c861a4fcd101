"""Meshes in blocks: nothing is lost on the way to cells, whatever the transform."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.octree.grid import Grid
from farfield.represent.blocks import BLOCK, BlockedMesh, normal_matrix, touching, transformed_boxes
from farfield.represent.chunk import Chunk, merge
from farfield.scene.model import Mesh
from represent.shapes import IDENTITY, PLAIN, mesh_of

GRID = Grid(0.5, 64, (-2.0, -1.5, -2.5), (3, 3, 3))
BALL = trimesh.creation.icosphere(5)

TRANSFORMS = {
    "identity": np.eye(3),
    "mirrored": np.diag([-1.0, 1, 1]),
    "squeezed": np.diag([0.5, 1.5, 0.2]),
    "sheared": np.array([[1, 0.6, 0], [0, 1, 0.3], [0, 0, -0.8]]),
}


def area_of(chunk: Chunk) -> NDArray[np.float64]:
    corners = chunk.positions[chunk.triangles].astype(np.float64)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2


def in_all_cells(blocked: BlockedMesh, transform: NDArray[np.float64]) -> dict[tuple[int, int, int], Chunk]:
    found = {}
    for x in range(9):
        for y in range(8):
            for z in range(10):
                chunk = blocked.cell_chunk(transform, GRID, (x, y, z), 3, 7)
                if chunk is not None:
                    found[x, y, z] = chunk
    return found


@pytest.mark.parametrize("name", TRANSFORMS)
def test_cells_share_a_transformed_ball(name: str) -> None:
    linear = TRANSFORMS[name]
    blocked = BlockedMesh.from_mesh(mesh_of(BALL))
    transform = np.concatenate([linear, [[0.05], [0.5], [-0.03]]], axis=1)
    found = in_all_cells(blocked, transform)
    placed = trimesh.Trimesh(BALL.vertices @ linear.T, BALL.faces, process=False)
    total = sum(float(np.linalg.norm(area_of(c), axis=1).sum()) for c in found.values())
    assert total == pytest.approx(placed.area, rel=1e-6)
    for cell, chunk in found.items():
        half_step = GRID.leaf_size / 65536 / 2  # vertices stay where they are, decisions are in fixed point
        assert chunk.positions.min() >= -half_step
        assert chunk.positions.max() <= GRID.leaf_size + half_step
        assert set(chunk.materials) == {3}
        assert set(chunk.objects) == {7}
        outward = (
            chunk.positions[chunk.triangles].mean(1) + np.array(cell) * 0.5 + np.array(GRID.corner) - transform[:, 3]
        )
        assert ((area_of(chunk) * (outward @ np.linalg.inv(linear @ linear.T))).sum(1) >= -1e-9).all()
        seen = chunk.normals[chunk.triangles].mean(1)
        assert ((area_of(chunk) * seen).sum(1) >= -1e-9).all()
        np.testing.assert_allclose(np.linalg.norm(chunk.normals, axis=1), 1, atol=0.01)


def test_blocks_hold_every_triangle_once_within_their_boxes() -> None:
    generator = np.random.default_rng(1)
    mesh = mesh_of(BALL)
    objects = generator.integers(0, 9, len(mesh.triangles), dtype=np.uint32)
    uvs = generator.random((len(mesh.positions), 2), dtype=np.float32)
    full = Mesh(
        mesh.positions, mesh.triangles, mesh.normals, (PLAIN, PLAIN), (objects % 2).astype(np.uint16), uvs=uvs,
        triangle_object=objects, object_count=9,
    )  # fmt: skip
    blocked = BlockedMesh.from_mesh(full)
    whole = Chunk.whole(blocked)
    assert len(blocked.boxes) == -(-len(mesh.triangles) // BLOCK)
    assert len(blocked.positions) < 1.4 * len(mesh.positions)

    def rows(
        positions: NDArray[np.floating], triangles: NDArray[np.uint32], *attributes: NDArray[np.generic]
    ) -> list[tuple[float, ...]]:
        corners = positions[triangles].reshape(len(triangles), -1)
        return sorted(map(tuple, np.column_stack([corners, *attributes]).tolist()))

    before = rows(mesh.positions.astype(np.float32), mesh.triangles, objects, objects % 2, uvs[mesh.triangles[:, 0]])
    after = rows(whole.positions, whole.triangles, whole.objects, whole.materials, whole.uvs[whole.triangles[:, 0]])
    assert before == after
    for block, box in enumerate(blocked.boxes):
        corners = whole.positions[whole.triangles[block * BLOCK : (block + 1) * BLOCK]].reshape(-1, 3)
        np.testing.assert_allclose(corners.min(0), box[0], atol=1e-7)
        np.testing.assert_allclose(corners.max(0), box[1], atol=1e-7)


def test_given_blocks_are_enough() -> None:
    blocked = BlockedMesh.from_mesh(mesh_of(BALL))
    relative = IDENTITY.copy()
    relative[:, 3] -= np.array(GRID.corner)
    chosen = touching(transformed_boxes(blocked.boxes, relative), GRID.leaf_size, (4, 3, 6))
    assert 0 < len(chosen) < len(blocked.boxes) / 2
    one = blocked.cell_chunk(IDENTITY, GRID, (4, 3, 6), blocks=chosen)
    other = blocked.cell_chunk(IDENTITY, GRID, (4, 3, 6), blocks=blocked.all_blocks)
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one.positions[one.triangles], other.positions[other.triangles])


def test_normal_matrices_stay_finite_when_a_transform_flattens() -> None:
    flat = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]])
    np.testing.assert_allclose(normal_matrix(flat) @ [0.3, 0, 1], [0, 0, 1])


def test_an_empty_mesh_has_no_blocks_and_a_broken_one_is_refused() -> None:
    none = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.uint32), np.zeros((0, 3), np.float32), (), np.zeros(0, np.uint16))
    blocked = BlockedMesh.from_mesh(none)
    assert blocked.boxes.shape == (0, 2, 3)
    assert blocked.cell_chunk(IDENTITY, GRID, (0, 0, 0)) is None
    broken = Mesh(
        np.zeros((2, 3)),
        np.array([[0, 1, 2]], np.uint32),
        np.zeros((2, 3), np.float32),
        (PLAIN,),
        np.zeros(1, np.uint16),
    )
    with pytest.raises(InputError):
        BlockedMesh.from_mesh(broken)


def test_merging_fills_what_some_parts_lack() -> None:
    plain = Chunk.whole(BlockedMesh.from_mesh(mesh_of(trimesh.creation.box())))
    colored = Chunk(
        plain.positions, plain.normals, np.ones((len(plain.positions), 2), np.float32),
        np.full((len(plain.positions), 4), 9, np.uint8), plain.triangles, plain.materials, plain.objects,
    )  # fmt: skip
    both = merge([plain, colored])
    count = len(plain.positions)
    assert (both.uvs[:count] == 0).all()
    assert (both.uvs[count:] == 1).all()
    assert (both.colors[:count] == 255).all()
    assert (both.colors[count:] == 9).all()
    np.testing.assert_array_equal(both.triangles[len(plain.triangles) :], plain.triangles + count)
    assert merge([plain]) is plain
