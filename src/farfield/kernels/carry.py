"""Colours carried over from one surface to another: for each point that of the nearest of the triangles that fit.

Triangles are kept in a grid (kernels.nearest).

What fits is of the same group, and faces the same way: a thin wall is not to show on the outside what is inside. One
that faces another way counts as farther away, for all may have been turned by making the surface coarser.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.nearest import cell_along, nearest_on
from farfield.kernels.shade import albedo, is_textured
from farfield.kernels.surface import F32_2, F64_1, F64_2, I32_2, I64_1, MATERIALS, SURFACE, U8_1, U32_1

NO_TRIANGLE = np.int32(-1)
"""Of a sample that no triangle covers."""
LEAST_FACING = 0.26
"""Cosine of the angle between normals, 75 degrees, up to which two face the same way."""
_ZERO = np.float32(0.0)


@kernel(types.void(F64_2, I32_2))
def cover(corners, ids):  # type: ignore[no-untyped-def]
    """Triangles of a plane on a lattice of samples; the first of several that cover a sample keeps it.

    corners: (m, 6) float64 x and y of three corners, in samples: that of row j and column i is at (i + .5, j + .5).
    ids: (rows, columns) int32, NO_TRIANGLE in; out the triangle that covers each.
    """
    rows, columns = ids.shape
    for t in range(corners.shape[0]):
        ax, ay, bx, by, cx, cy = corners[t]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        sign = 1.0 if area > 0.0 else -1.0
        first_row = max(np.int64(math.ceil(min(ay, by, cy) - 0.5)), 0)
        last_row = min(np.int64(math.floor(max(ay, by, cy) - 0.5)), rows - 1)
        first_column = max(np.int64(math.ceil(min(ax, bx, cx) - 0.5)), 0)
        last_column = min(np.int64(math.floor(max(ax, bx, cx) - 0.5)), columns - 1)
        for j in range(first_row, last_row + 1):
            y = j + 0.5
            for i in range(first_column, last_column + 1):
                x = i + 0.5
                if (
                    ids[j, i] < 0
                    and sign * ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) >= 0.0
                    and sign * ((cx - bx) * (y - by) - (cy - by) * (x - bx)) >= 0.0
                    and sign * ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) >= 0.0
                ):
                    ids[j, i] = t


@device
def _distance(points, triangles, facing, groups, t, px, py, pz, nx, ny, nz, group, penalty):  # type: ignore[no-untyped-def]
    """Squared, of a triangle that faces another way made longer by the penalty; infinite of another group."""
    if groups[t] != group:
        return np.inf
    squared, _, _ = nearest_on(points, triangles, t, px, py, pz)
    same = facing[t, 0] * nx + facing[t, 1] * ny + facing[t, 2] * nz >= LEAST_FACING
    return squared if same else squared + penalty


@device
def _in_shells(  # type: ignore[no-untyped-def]
    points, triangles, facing, groups, low, size, shape, start, inside, px, py, pz, nx, ny, nz, group, penalty, best,
    found,
):  # fmt: skip
    """(squared distance, triangle) of the nearest; looks at cells in shells around the point, as nearest.distances."""
    x = np.int64(math.floor((px - low[0]) / size))
    y = np.int64(math.floor((py - low[1]) / size))
    z = np.int64(math.floor((pz - low[2]) / size))
    reach = min(px - low[0] - x * size, low[0] + (x + 1) * size - px)
    reach = min(reach, py - low[1] - y * size, low[1] + (y + 1) * size - py)
    reach = min(reach, pz - low[2] - z * size, low[2] + (z + 1) * size - pz)
    most = max(abs(x), abs(y), abs(z), abs(x - shape[0]), abs(y - shape[1]), abs(z - shape[2]))
    shell = 0
    while shell <= most:
        for i in range(max(x - shell, 0), min(x + shell, shape[0] - 1) + 1):
            for j in range(max(y - shell, 0), min(y + shell, shape[1] - 1) + 1):
                edge = abs(i - x) == shell or abs(j - y) == shell
                step = 1 if edge or shell == 0 else 2 * shell
                k = z - shell
                while k <= z + shell:
                    if 0 <= k < shape[2]:
                        cell = (i * shape[1] + j) * shape[2] + k
                        for e in range(start[cell], start[cell + 1]):
                            t = np.int64(inside[e])
                            away = _distance(
                                points, triangles, facing, groups, t, px, py, pz, nx, ny, nz, group, penalty
                            )
                            if away < best:
                                best = away
                                found = t
                    k += step
        far = reach + shell * size
        if far > 0.0 and best <= far * far:
            break
        shell += 1
    return best, found


@kernel(
    types.void(
        SURFACE, MATERIALS, F64_2, F64_2, U8_1, F64_1, F64_1, types.float64, I64_1, I64_1, U32_1,
        F64_2, F64_2, U8_1, F64_1, types.float64, F32_2, U32_1,
    )
)  # fmt: skip
def carry(  # type: ignore[no-untyped-def]
    surface, materials, points, facing, groups, density, low, size, shape, start, inside,
    samples, toward, wanted, footprint, penalty, colors, found,
):  # fmt: skip
    """Colour of a surface at the points of it that are nearest to others.

    surface, materials: what the colours are of; of each group that is wanted there must be a triangle.
    points: (n, 3) float64, its positions. facing: (m, 3) float64 unit normals of its triangles. groups: (m,) uint8.
    density: (m,) float64 texels a metre. low, size, shape, start, inside: the grid of its triangles (`fill_cells`).
    samples: (k, 3) float64 the other points, best with neighbours one after the other. toward: (k, 3) float64 unit
    normals there. wanted: (k,) uint8 groups. footprint: (k,) float64 metres along the side of what each stands for.
    penalty: square metres by which one that faces another way is farther away.
    colors: (k, 3) float32 out, linear light. found: (k,) uint32 out, the triangles.
    """
    last = 0
    for n in range(samples.shape[0]):
        px = samples[n, 0]
        py = samples[n, 1]
        pz = samples[n, 2]
        nx = toward[n, 0]
        ny = toward[n, 1]
        nz = toward[n, 2]
        group = wanted[n]
        triangles = surface.triangles
        # The one before is mostly near this one too, and then tells how far to look.
        best = _distance(points, triangles, facing, groups, last, px, py, pz, nx, ny, nz, group, penalty)
        near = last
        if best <= size * size:
            radius = math.sqrt(best)
            x0, x1 = cell_along(px - radius, low[0], size, shape[0]), cell_along(px + radius, low[0], size, shape[0])
            y0, y1 = cell_along(py - radius, low[1], size, shape[1]), cell_along(py + radius, low[1], size, shape[1])
            z0, z1 = cell_along(pz - radius, low[2], size, shape[2]), cell_along(pz + radius, low[2], size, shape[2])
            for i in range(x0, x1 + 1):
                for j in range(y0, y1 + 1):
                    for k in range(z0, z1 + 1):
                        cell = (i * shape[1] + j) * shape[2] + k
                        for e in range(start[cell], start[cell + 1]):
                            t = np.int64(inside[e])
                            away = _distance(
                                points, triangles, facing, groups, t, px, py, pz, nx, ny, nz, group, penalty
                            )
                            if away < best:
                                best = away
                                near = t
        else:
            best, near = _in_shells(
                points, triangles, facing, groups, low, size, shape, start, inside, px, py, pz, nx, ny, nz, group,
                penalty, best, near,
            )  # fmt: skip
        last = near
        _, s, r = nearest_on(points, triangles, near, px, py, pz)
        material = surface.materials[near]
        across = _ZERO
        if is_textured(surface, materials, material):
            across = np.float32(footprint[n] * density[near] / materials.size[materials.texture[material], 0])
        colors[n, 0], colors[n, 1], colors[n, 2] = albedo(
            surface, materials, material, np.uintp(triangles[near, 0]), np.uintp(triangles[near, 1]),
            np.uintp(triangles[near, 2]), np.float32(1.0 - s - r), np.float32(s), np.float32(r),
            across, _ZERO, _ZERO, _ZERO,
        )  # fmt: skip
        found[n] = near
