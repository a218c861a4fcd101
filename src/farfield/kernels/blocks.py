"""Meshes in blocks of neighbouring triangles that carry their own vertices."""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import kernel
from farfield.kernels.surface import F32_2, F64_2, I64_1, U32_1, U32_2


@kernel(types.int64(U32_2, types.int64, types.int64, U32_2, U32_1, I64_1), allocates=True)
def split_vertices(triangles, vertices, size, local, origin, start):  # type: ignore[no-untyped-def]
    """Gives every block of `size` consecutive triangles its own vertices, numbered by first use.

    triangles: (m, 3) uint32 into `vertices` vertices. local: (m, 3) uint32 out, counted from the block's first vertex.
    origin: (at most 3 m,) uint32 out: the vertex each new vertex is a copy of. start: (blocks + 1,) int64 out: first
    vertex of each block. Returns the number of new vertices.
    """
    seen_in = np.full(vertices, -1, dtype=np.int64)
    number = np.zeros(vertices, dtype=np.uint32)
    count = 0
    for block in range(start.shape[0] - 1):
        start[block] = count
        for t in range(block * size, min((block + 1) * size, triangles.shape[0])):
            for k in range(3):
                v = np.uintp(triangles[t, k])
                if seen_in[v] != block:
                    seen_in[v] = block
                    number[v] = count - start[block]
                    origin[count] = v
                    count += 1
                local[t, k] = number[v]
    start[start.shape[0] - 1] = count
    return count


@kernel(types.void(I64_1, I64_1, types.int64, F64_2, F32_2, U32_2, F64_2, F64_2, F64_2, F32_2, U32_2, I64_1, I64_1))
def place_blocks(  # type: ignore[no-untyped-def]
    blocks, start, size, positions, normals, local, matrix, normal_matrix,
    out_positions, out_normals, out_triangles, out_vertex, out_triangle,
):  # fmt: skip
    """Copies some blocks of a mesh, transformed.

    blocks: (b,) int64. start: (blocks + 1,) int64 first vertices. size: triangles a block. positions (n, 3) float64,
    normals (n, 3) float32, local (m, 3) uint32: the mesh. matrix: (3, 4) float64; one that mirrors turns the winding.
    normal_matrix: (3, 3) float64, applied to normals, which are then made unit.
    out_positions (v, 3) float64, out_normals (v, 3) float32, out_triangles (t, 3) uint32: the copy. out_vertex (v,),
    out_triangle (t,) int64: what each is a copy of.
    """
    m = matrix
    determinant = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    second = 2 if determinant < 0 else 1
    third = 1 if determinant < 0 else 2
    v = 0
    t = 0
    for i in range(blocks.shape[0]):
        block = blocks[i]
        base = np.uint32(v)
        for vertex in range(start[block], start[block + 1]):
            x, y, z = positions[vertex, 0], positions[vertex, 1], positions[vertex, 2]
            for row in range(3):
                out_positions[v, row] = m[row, 0] * x + m[row, 1] * y + m[row, 2] * z + m[row, 3]
            a, b, c = normals[vertex, 0], normals[vertex, 1], normals[vertex, 2]
            n = normal_matrix
            nx = n[0, 0] * a + n[0, 1] * b + n[0, 2] * c
            ny = n[1, 0] * a + n[1, 1] * b + n[1, 2] * c
            nz = n[2, 0] * a + n[2, 1] * b + n[2, 2] * c
            squared = nx * nx + ny * ny + nz * nz
            scale = 1.0 / np.sqrt(squared) if squared > 0 else 0.0
            out_normals[v, 0] = nx * scale
            out_normals[v, 1] = ny * scale
            out_normals[v, 2] = nz * scale
            out_vertex[v] = vertex
            v += 1
        for triangle in range(block * size, min((block + 1) * size, local.shape[0])):
            out_triangles[t, 0] = base + local[triangle, 0]
            out_triangles[t, 1] = base + local[triangle, second]
            out_triangles[t, 2] = base + local[triangle, third]
            out_triangle[t] = triangle
            t += 1
