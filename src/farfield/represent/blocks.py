"""Meshes sorted along a space-filling curve, in blocks with boxes: a leaf reads only the blocks that touch it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.geometry.morton import codes_along
from farfield.kernels.blocks import place_blocks, split_vertices
from farfield.octree.grid import Grid
from farfield.represent.chunk import Chunk
from farfield.represent.clipping import Triangles, clip_to_cell
from farfield.scene.model import Mesh

BLOCK = 512
"""Triangles a block: a mesh of a million triangles is 2,000 boxes to test against a cell."""


@dataclass(frozen=True, slots=True)
class BlockedMesh:
    """A mesh in blocks. Each block has its own vertices: those on its border are held once per block (about +20 %)."""

    positions: NDArray[np.float64]
    """(n, 3) float64, mesh frame."""
    normals: NDArray[np.float32]
    """(n, 3) float32."""
    uvs: NDArray[np.float32]
    """(n, 2) float32 or (0, 2)."""
    colors: NDArray[np.uint8]
    """(n, 4) uint8 or (0, 4)."""
    local: NDArray[np.uint32]
    """(m, 3) uint32, counted from the first vertex of the triangle's block; block b has triangles b * BLOCK and on."""
    materials: NDArray[np.uint32]
    """(m,) uint32 into the mesh's materials."""
    objects: NDArray[np.uint32]
    """(m,) uint32 object within the mesh."""
    start: NDArray[np.int64]
    """(b + 1,) int64: first vertex of each block."""
    boxes: NDArray[np.float64]
    """(b, 2, 3) float64: bounds of each block, inclusive, mesh frame."""

    @classmethod
    def from_mesh(cls, mesh: Mesh) -> BlockedMesh:
        """Sorts by the Morton code of the centroids. Raises InputError when a triangle refers to a missing vertex."""
        if len(mesh.triangles) and int(mesh.triangles.max()) >= len(mesh.positions):
            raise InputError("a triangle refers to a vertex that is not there")
        positions = np.ascontiguousarray(mesh.positions, dtype=np.float64)
        a, b, c = (positions[mesh.triangles[:, corner]] for corner in range(3))
        order = np.argsort(codes_along(a + b + c), kind="stable")
        triangles = mesh.triangles[order].astype(np.uint32)
        blocks = -(-len(triangles) // BLOCK)
        local, origin = np.empty_like(triangles), np.empty(3 * len(triangles), dtype=np.uint32)
        start = np.zeros(blocks + 1, dtype=np.int64)
        count = split_vertices(triangles, len(positions), BLOCK, local, origin, start)
        origin = origin[:count].copy()
        kept = positions[origin]
        boxes = np.zeros((blocks, 2, 3))
        if blocks:
            boxes[:, 0] = np.minimum.reduceat(kept, start[:-1])
            boxes[:, 1] = np.maximum.reduceat(kept, start[:-1])
        objects = (
            np.zeros(len(triangles), dtype=np.uint32) if mesh.triangle_object is None else mesh.triangle_object[order]
        )
        return cls(
            positions=kept,
            normals=np.asarray(mesh.normals, dtype=np.float32)[origin],
            uvs=np.empty((0, 2), dtype=np.float32) if mesh.uvs is None else mesh.uvs[origin].astype(np.float32),
            colors=np.empty((0, 4), dtype=np.uint8) if mesh.colors is None else mesh.colors[origin].astype(np.uint8),
            local=local,
            materials=mesh.triangle_material[order].astype(np.uint32),
            objects=objects.astype(np.uint32),
            start=start,
            boxes=boxes,
        )

    @property
    def all_blocks(self) -> NDArray[np.int64]:
        """(b,) int64: every block."""
        return np.arange(len(self.boxes), dtype=np.int64)

    def placed(
        self, transform: NDArray[np.float64], blocks: NDArray[np.int64], material_base: int = 0, object_base: int = 0
    ) -> Triangles:
        """Transformed copy of some blocks.

        transform: (3, 4) float64; normals go by its inverse transpose; one that mirrors turns the winding, so that
        counter-clockwise still is outside.
        """
        blocks = np.ascontiguousarray(blocks, dtype=np.int64)
        vertices = int((self.start[blocks + 1] - self.start[blocks]).sum())
        last = len(self.local) - (len(self.boxes) - 1) * BLOCK
        triangles = sum(last if b == len(self.boxes) - 1 else BLOCK for b in blocks.tolist())
        positions, normals = np.empty((vertices, 3)), np.empty((vertices, 3), dtype=np.float32)
        corners = np.empty((triangles, 3), dtype=np.uint32)
        vertex, triangle = np.empty(vertices, dtype=np.int64), np.empty(triangles, dtype=np.int64)
        matrix = np.ascontiguousarray(transform, dtype=np.float64)
        place_blocks(
            blocks, self.start, BLOCK, self.positions, self.normals, self.local, matrix, normal_matrix(matrix),
            positions, normals, corners, vertex, triangle,
        )  # fmt: skip
        return Triangles(
            positions,
            normals,
            self.uvs[vertex] if len(self.uvs) else self.uvs,
            self.colors[vertex] if len(self.colors) else self.colors,
            corners,
            self.materials[triangle] + np.uint32(material_base),
            self.objects[triangle] + np.uint32(object_base),
        )

    def cell_chunk(
        self,
        transform: NDArray[np.float64],
        grid: Grid,
        index: tuple[int, int, int],
        material_base: int = 0,
        object_base: int = 0,
        blocks: NDArray[np.int64] | None = None,
    ) -> Chunk | None:
        """What of an instance of the mesh lies in one leaf cell; None when nothing does.

        transform: (3, 4) float64, mesh frame to local metres. index: leaf index.
        material_base, object_base: added to the mesh's material and object numbers.
        blocks: (k,) int64, the blocks to look at; None: those whose boxes touch the cell.
        """
        relative = np.array(transform, dtype=np.float64)
        relative[:, 3] -= np.array(grid.corner)
        if blocks is None:
            blocks = touching(transformed_boxes(self.boxes, relative), grid.leaf_size, index)
        if len(blocks) == 0:
            return None
        return clip_to_cell(self.placed(relative, blocks, material_base, object_base), grid.leaf_size, index)


def transformed_boxes(boxes: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """(b, 2, 3) boxes around the transformed boxes; slightly larger than they need be, never smaller."""
    linear = transform[:, :3]
    middle = boxes.mean(1) @ linear.T + transform[:, 3]
    reach = (boxes[:, 1] - boxes[:, 0]) * 0.5 @ np.abs(linear).T
    reach += 1e-9 * (np.abs(middle) + reach)
    return np.stack([middle - reach, middle + reach], axis=1)


def touching(boxes: NDArray[np.float64], leaf_size: float, index: tuple[int, int, int]) -> NDArray[np.int64]:
    """(k,) int64: boxes (metres from the grid's corner) that may have something in a leaf cell, with rounding room."""
    room = leaf_size / 65536
    lower = np.array(index) * leaf_size
    near = (boxes[:, 1] >= lower - room) & (boxes[:, 0] <= lower + leaf_size + room)
    return np.flatnonzero(near.all(1)).astype(np.int64)


def normal_matrix(transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) float64: the inverse transpose up to a positive factor; finite for flattening transforms too."""
    a, b, c = transform[:, 0], transform[:, 1], transform[:, 2]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.ascontiguousarray(-cofactors if float(a @ cofactors[:, 0]) < 0 else cofactors)
