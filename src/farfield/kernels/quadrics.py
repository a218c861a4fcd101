"""Quadric errors of shape and attributes: how far a mesh is from its planes and slopes when a place moves.

Garland and Heckbert 1997 for the shape, Hoppe 1999 (New quadric metric for simplifying meshes with appearance
attributes) for the attributes. Places and wedges are those of `collapse`.
"""

from __future__ import annotations

import math

from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F64_1, F64_2, I64_1, U32_1, U32_2

HOLD = 1e-3
"""How much a place would rather stay where it is, in parts of the planes around it."""

SHAPE = 11
"""Numbers of a quadric: xx, yy, zz, xy, xz, yz, x, y, z, constant, weight."""

SLOPE = 5
"""Numbers of an attribute: weighted gradient (3), offset, weight."""

BORDER, SEAM, SMOOTH = 0, 1, 2
"""An edge with nothing across; with other attributes there; with the same."""


@device
def _add_plane(row, nx, ny, nz, d, weight):  # type: ignore[no-untyped-def]
    row[0] += weight * nx * nx
    row[1] += weight * ny * ny
    row[2] += weight * nz * nz
    row[3] += weight * nx * ny
    row[4] += weight * nx * nz
    row[5] += weight * ny * nz
    row[6] += weight * nx * d
    row[7] += weight * ny * d
    row[8] += weight * nz * d
    row[9] += weight * d * d


@device
def squared_error(row, x, y, z):  # type: ignore[no-untyped-def]
    """Weighted sum of squared distances of a point from the planes of a quadric."""
    second = row[0] * x * x + row[1] * y * y + row[2] * z * z
    mixed = row[3] * x * y + row[4] * x * z + row[5] * y * z
    return second + 2.0 * (mixed + row[6] * x + row[7] * y + row[8] * z) + row[9]


@kernel(types.void(U32_2, U32_1, I64_1, U32_1))
def triangles_around(triangles, places, start, around):  # type: ignore[no-untyped-def]
    """Triangles at each place, in their order.

    triangles: (m, 3) uint32 wedges. places: (w,) uint32 of the wedges. start: (p + 1,) int64 out, around: (3 m,) uint32
    out: those of place i are around[start[i] : start[i + 1]].
    """
    start[:] = 0
    for t in range(triangles.shape[0]):
        for k in range(3):
            start[places[triangles[t, k]] + 1] += 1
    for p in range(1, start.shape[0]):
        start[p] += start[p - 1]
    for t in range(triangles.shape[0]):
        for k in range(3):
            p = places[triangles[t, k]]
            around[start[p]] = t
            start[p] += 1
    for p in range(start.shape[0] - 1, 0, -1):
        start[p] = start[p - 1]
    start[0] = 0


@device
def corner_at(triangles, places, t, p):  # type: ignore[no-untyped-def]
    if places[triangles[t, 0]] == p:
        return triangles[t, 0]
    if places[triangles[t, 1]] == p:
        return triangles[t, 1]
    return triangles[t, 2]


@device
def _across(triangles, places, start, around, t, a, b):  # type: ignore[no-untyped-def]
    """What the edge between two wedges of a triangle is."""
    found = BORDER
    pa = places[a]
    pb = places[b]
    for i in range(start[pb], start[pb + 1]):
        other = around[i]
        if other == t:
            continue
        for k in range(3):
            wedge = triangles[other, k]
            if places[wedge] == pa:
                far = corner_at(triangles, places, other, pb)
                if wedge == a and far == b:
                    return SMOOTH
                found = SEAM
    return found


@kernel(types.void(U32_2, U32_1, U32_1, F64_2, F64_2, F64_1, I64_1, U32_1, types.float64, F64_2, F64_2))
def sum_quadrics(triangles, places, groups, points, attributes, weights, start, around, border, shapes, slopes):  # type: ignore[no-untyped-def]
    """Quadrics of shape of the places and of attributes of the wedges.

    triangles: (m, 3) uint32 wedges. places, groups: (w,) uint32, place of a wedge, and number of its material and
    object. points: (p, 3) float64. attributes: (w, k) float64. weights: (k,) float64: lengths that a difference of 1
    counts as, all in the unit of points; negative: the difference counts as the way on the surface over which the
    attribute changes as much, and as that length at most. start, around: of `triangles_around`. border: how much more a
    border counts than a face.
    shapes: (p, SHAPE) float64, slopes: (w, SHAPE + k * SLOPE) float64 out, of zeros.
    """
    for t in range(triangles.shape[0]):
        a = triangles[t, 0]
        b = triangles[t, 1]
        c = triangles[t, 2]
        pa = places[a]
        pb = places[b]
        pc = places[c]
        ux = points[pb, 0] - points[pa, 0]
        uy = points[pb, 1] - points[pa, 1]
        uz = points[pb, 2] - points[pa, 2]
        vx = points[pc, 0] - points[pa, 0]
        vy = points[pc, 1] - points[pa, 1]
        vz = points[pc, 2] - points[pa, 2]
        nx = uy * vz - uz * vy
        ny = uz * vx - ux * vz
        nz = ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length == 0.0:
            continue
        nx /= length
        ny /= length
        nz /= length
        # By the length of the sides, not the area: silhouettes keep their shape (as meshoptimizer does).
        weight = math.sqrt(length)
        d = -(nx * points[pa, 0] + ny * points[pa, 1] + nz * points[pa, 2])
        for k in range(3):
            row = shapes[places[triangles[t, k]]]
            _add_plane(row, nx, ny, nz, d, weight)
            row[10] += weight
        for k in range(3):
            p = places[triangles[t, k]]
            q = places[triangles[t, (k + 1) % 3]]
            across = _across(triangles, places, start, around, t, triangles[t, k], triangles[t, (k + 1) % 3])
            if across == SMOOTH:
                continue
            ex = points[q, 0] - points[p, 0]
            ey = points[q, 1] - points[p, 1]
            ez = points[q, 2] - points[p, 2]
            side = math.sqrt(ex * ex + ey * ey + ez * ez)
            fx = (ey * nz - ez * ny) / side
            fy = (ez * nx - ex * nz) / side
            fz = (ex * ny - ey * nx) / side
            far = -(fx * points[p, 0] + fy * points[p, 1] + fz * points[p, 2])
            firmness = (border if across == BORDER else 1.0) * side
            _add_plane(shapes[p], fx, fy, fz, far, firmness)
            _add_plane(shapes[q], fx, fy, fz, far, firmness)
        uu = ux * ux + uy * uy + uz * uz
        uv = ux * vx + uy * vy + uz * vz
        vv = vx * vx + vy * vy + vz * vz
        if length * length < 1e-4 * uu * vv:
            # A sliver says nothing about how attributes change across it.
            continue
        scale = 1.0 / (length * length)
        for k in range(attributes.shape[1]):
            s = attributes[a, k]
            du = (attributes[b, k] - s) * scale
            dv = (attributes[c, k] - s) * scale
            along = vv * du - uv * dv
            other = uu * dv - uv * du
            gx = along * ux + other * vx
            gy = along * uy + other * vy
            gz = along * uz + other * vz
            offset = s - (gx * points[pa, 0] + gy * points[pa, 1] + gz * points[pa, 2])
            factor = weights[k] * weights[k]
            if weights[k] < 0.0:
                factor = 1.0 / max(gx * gx + gy * gy + gz * gz, 1.0 / factor)
            factor *= weight
            for corner in range(3):
                row = slopes[triangles[t, corner]]
                _add_plane(row, gx, gy, gz, offset, factor)
                first = SHAPE + SLOPE * k
                row[first] += factor * gx
                row[first + 1] += factor * gy
                row[first + 2] += factor * gz
                row[first + 3] += factor * offset
                row[first + 4] += factor


@device
def misfit_of(slopes, attributes, wedge, target, x, y, z):  # type: ignore[no-untyped-def]
    """Weighted sum of squared differences when the triangles of a wedge have the attributes of another at (x, y, z)."""
    row = slopes[wedge]
    total = squared_error(row, x, y, z)
    for k in range(attributes.shape[1]):
        s = attributes[target, k]
        first = SHAPE + SLOPE * k
        expected = row[first] * x + row[first + 1] * y + row[first + 2] * z + row[first + 3]
        total += s * (s * row[first + 4] - 2.0 * expected)
    return total


@device
def best_point(points, shapes, p, q):  # type: ignore[no-untyped-def]
    """Point near q that is nearest to the planes of p and q, by Cramer's rule; no farther away than p is."""
    x = points[q, 0]
    y = points[q, 1]
    z = points[q, 2]
    one = shapes[p]
    two = shapes[q]
    xx = one[0] + two[0]
    yy = one[1] + two[1]
    zz = one[2] + two[2]
    xy = one[3] + two[3]
    xz = one[4] + two[4]
    yz = one[5] + two[5]
    gx = -(xx * x + xy * y + xz * z + one[6] + two[6])
    gy = -(xy * x + yy * y + yz * z + one[7] + two[7])
    gz = -(xz * x + yz * y + zz * z + one[8] + two[8])
    # On a plane any point will do: then it stays at q.
    hold = HOLD * (xx + yy + zz)
    xx += hold
    yy += hold
    zz += hold
    cxx = yy * zz - yz * yz
    cxy = xz * yz - xy * zz
    cxz = xy * yz - xz * yy
    whole = xx * cxx + xy * cxy + xz * cxz
    if not whole > 0.0:
        return x, y, z
    dx = (gx * cxx + gy * cxy + gz * cxz) / whole
    dy = (gx * cxy + gy * (xx * zz - xz * xz) + gz * (xy * xz - xx * yz)) / whole
    dz = (gx * cxz + gy * (xy * xz - xx * yz) + gz * (xx * yy - xy * xy)) / whole
    ex = points[p, 0] - x
    ey = points[p, 1] - y
    ez = points[p, 2] - z
    if dx * dx + dy * dy + dz * dz > ex * ex + ey * ey + ez * ez:
        return x, y, z
    return x + dx, y + dy, z + dz
