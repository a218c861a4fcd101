"""Distances of points from a surface: triangles in a grid, looked at in shells around each point."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F64_1, F64_2, I64_1, U32_1, U32_2


@device
def cell_along(value, low, size, count):  # type: ignore[no-untyped-def]
    """Cell of a grid along an axis that a value lies in, the nearest where it lies outside."""
    return min(max(np.int64(math.floor((value - low) / size)), 0), count - 1)


@device
def _range(points, triangles, t, axis, low, size, count):  # type: ignore[no-untyped-def]
    """First and last cell along an axis that a triangle's box reaches into."""
    a = points[triangles[t, 0], axis]
    b = points[triangles[t, 1], axis]
    c = points[triangles[t, 2], axis]
    return cell_along(min(a, b, c), low, size, count), cell_along(max(a, b, c), low, size, count)


@kernel(types.int64(F64_2, U32_2, F64_1, types.float64, I64_1, I64_1, U32_1))
def fill_cells(points, triangles, low, size, shape, start, inside):  # type: ignore[no-untyped-def]
    """Triangles by cells of a grid. Returns how many entries there are.

    points: (n, 3) float64. triangles: (m, 3) uint32. low: (3,) float64, lower corner of the grid. size: of a cell.
    shape: (3,) int64 cells along each axis. start: (cells + 1,) int64 out. inside: (entries,) uint32 out: the triangles
    whose boxes reach into cell i are inside[start[i] : start[i + 1]]; (0,): only start is wanted.
    """
    start[:] = 0
    for turn in range(2 if inside.shape[0] > 0 else 1):
        for t in range(triangles.shape[0]):
            x0, x1 = _range(points, triangles, t, 0, low[0], size, shape[0])
            y0, y1 = _range(points, triangles, t, 1, low[1], size, shape[1])
            z0, z1 = _range(points, triangles, t, 2, low[2], size, shape[2])
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    for z in range(z0, z1 + 1):
                        cell = (x * shape[1] + y) * shape[2] + z
                        if turn == 0:
                            start[cell + 1] += 1
                        else:
                            inside[start[cell]] = t
                            start[cell] += 1
        if turn == 0:
            for cell in range(1, start.shape[0]):
                start[cell] += start[cell - 1]
    total = start[start.shape[0] - 1]
    if inside.shape[0] > 0:
        for cell in range(start.shape[0] - 1, 0, -1):
            start[cell] = start[cell - 1]
        start[0] = 0
    return total


@device
def nearest_on(points, triangles, t, px, py, pz):  # type: ignore[no-untyped-def]
    """(squared distance, weight of the second corner, of the third) of a triangle's point nearest to another
    (Ericson, Real-Time Collision Detection, 5.1.5)."""
    a = np.uintp(triangles[t, 0])
    b = np.uintp(triangles[t, 1])
    c = np.uintp(triangles[t, 2])
    ax = points[a, 0]
    ay = points[a, 1]
    az = points[a, 2]
    ux, uy, uz = points[b, 0] - ax, points[b, 1] - ay, points[b, 2] - az
    vx, vy, vz = points[c, 0] - ax, points[c, 1] - ay, points[c, 2] - az
    wx, wy, wz = px - ax, py - ay, pz - az
    uu = ux * ux + uy * uy + uz * uz
    uv = ux * vx + uy * vy + uz * vz
    vv = vx * vx + vy * vy + vz * vz
    d1 = ux * wx + uy * wy + uz * wz
    d2 = vx * wx + vy * wy + vz * wz
    d3 = d1 - uu
    d4 = d2 - uv
    d5 = d1 - uv
    d6 = d2 - vv
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    s = 0.0
    r = 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        s = 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        r = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        r = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        r = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - r
    else:
        scale = 1.0 / (va + vb + vc)
        s = vb * scale
        r = vc * scale
    wx -= s * ux + r * vx
    wy -= s * uy + r * vy
    wz -= s * uz + r * vz
    return wx * wx + wy * wy + wz * wz, s, r


@kernel(types.void(F64_2, U32_2, F64_1, types.float64, I64_1, I64_1, U32_1, F64_2, F64_1))
def distances(points, triangles, low, size, shape, start, inside, samples, found):  # type: ignore[no-untyped-def]
    """Distance of each sample from the nearest triangle. Arguments as those of `fill_cells`, and its results.

    samples: (k, 3) float64. found: (k,) float64 out.
    """
    for n in range(samples.shape[0]):
        px = samples[n, 0]
        py = samples[n, 1]
        pz = samples[n, 2]
        x = np.int64(math.floor((px - low[0]) / size))
        y = np.int64(math.floor((py - low[1]) / size))
        z = np.int64(math.floor((pz - low[2]) / size))
        best = np.inf
        shell = 0
        # How far the cells looked at reach beyond the point, whichever way.
        reach = min(px - low[0] - x * size, low[0] + (x + 1) * size - px)
        reach = min(reach, py - low[1] - y * size, low[1] + (y + 1) * size - py)
        reach = min(reach, pz - low[2] - z * size, low[2] + (z + 1) * size - pz)
        most = max(abs(x), abs(y), abs(z), abs(x - shape[0]), abs(y - shape[1]), abs(z - shape[2]))
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
                                best = min(best, nearest_on(points, triangles, inside[e], px, py, pz)[0])
                        k += step
            far = reach + shell * size
            if far > 0.0 and best <= far * far:
                break
            shell += 1
        found[n] = math.sqrt(best)
