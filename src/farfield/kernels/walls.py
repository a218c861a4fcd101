"""What a viewer sees on the walls of a BlockMap: the surfaces between the middle of a texel and that of the lower one
beside it, looked at from there (BLK 3.3, figure 4).

`find_walls` cuts the triangles with a line across each column of samples, `paint_walls` takes their colours.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.shade import albedo, is_textured
from farfield.kernels.surface import F32_1, F32_2, F32_3, I32_1, I32_2, MATERIALS, SURFACE
from farfield.kernels.unfold import SOUTH

SAMPLES = 2
"""Of a texel on a wall, along each axis."""

_FLAT = 1e-4
"""Metres: what rises less between the ends of a cut is no wall."""
_HIDDEN = np.float32(-3.0e38)


@device
def _cut(a, b, at):  # type: ignore[no-untyped-def]
    """Where on the way from a to b `at` is, 0 to 1; -1: nowhere."""
    if a == b or (a < at) == (b < at):
        return -1.0
    return (at - a) / (b - a)


@kernel(types.void(SURFACE, I32_2, I32_1, F32_2, types.int64, types.int64, F32_1, F32_1, I32_1))
def find_walls(surface, places, starts, heights, n, across, texel, nearest, found):  # type: ignore[no-untyped-def]
    """Which triangle each sample of a wall shows.

    places: (4 n n, 3), rows 0 where a side is no wall. starts: (4 n n,) of each side its first sample. Those of a side
    are row by row, SAMPLES * rows of them from the top down, SAMPLES * across in each, along x or y.
    heights: (4 n n, 2) metres of the upper and of the lower end of each side. texel: (2,) metres along x and y.
    nearest: (samples,) float32 in and out, -3e38: nothing yet; towards the looker. found: (samples,) triangle.
    """
    positions = surface.positions
    for t in range(surface.triangles.shape[0]):
        ia = np.uintp(surface.triangles[t, 0])
        ib = np.uintp(surface.triangles[t, 1])
        ic = np.uintp(surface.triangles[t, 2])
        az, bz, cz = np.float64(positions[ia, 2]), np.float64(positions[ib, 2]), np.float64(positions[ic, 2])
        if max(az, max(bz, cz)) - min(az, min(bz, cz)) < _FLAT:
            continue
        for axis in range(2):
            p = np.uintp(axis)
            q = np.uintp(1 - axis)
            aq, bq, cq = np.float64(positions[ia, q]), np.float64(positions[ib, q]), np.float64(positions[ic, q])
            ap, bp, cp = np.float64(positions[ia, p]), np.float64(positions[ib, p]), np.float64(positions[ic, p])
            each = texel[q] / (SAMPLES * across)
            first = max(np.int64(math.ceil(min(aq, min(bq, cq)) / each - 0.5)), 0)
            last = min(np.int64(math.floor(max(aq, max(bq, cq)) / each - 0.5)), SAMPLES * across * n - 1)
            for line in range(first, last + 1):
                at = (line + 0.5) * each
                along = line // (SAMPLES * across)
                column = line - along * SAMPLES * across
                ends = 0
                p0 = z0 = p1 = z1 = 0.0
                for edge in range(3):
                    if edge == 0:
                        share = _cut(aq, bq, at)
                        x, z = ap + share * (bp - ap), az + share * (bz - az)
                    elif edge == 1:
                        share = _cut(bq, cq, at)
                        x, z = bp + share * (cp - bp), bz + share * (cz - bz)
                    else:
                        share = _cut(cq, aq, at)
                        x, z = cp + share * (ap - cp), cz + share * (az - cz)
                    if share < 0.0:
                        continue
                    if ends == 0:
                        p0, z0 = x, z
                    else:
                        p1, z1 = x, z
                    ends += 1
                if ends < 2 or abs(z1 - z0) < _FLAT:
                    continue
                # A wall in the middle of a texel is seen from both: that of an edge of the slabs belongs to either.
                low_slab = max(np.int64(math.ceil(min(p0, p1) / texel[p] - 0.5)) - 1, -1)
                high_slab = min(np.int64(math.floor(max(p0, p1) / texel[p] - 0.5)), n - 1)
                for slab in range(low_slab, high_slab + 1):
                    for sense in range(2):
                        # Sense 0: seen from below along the axis (west, south), of the texel above the slab.
                        own = slab + 1 if sense == 0 else slab
                        if own < 0 or own >= n:
                            continue
                        k = SOUTH * axis + sense
                        side = 4 * (n * along + own) + k if axis == 0 else 4 * (n * own + along) + k
                        rows = places[side, 2] * SAMPLES
                        if rows == 0:
                            continue
                        top = np.float64(heights[side, 0])
                        each_row = (top - np.float64(heights[side, 1])) / rows
                        if each_row <= 0.0:
                            continue
                        row0 = max(np.int64(math.ceil((top - max(z0, z1)) / each_row - 0.5)), 0)
                        row1 = min(np.int64(math.floor((top - min(z0, z1)) / each_row - 0.5)), rows - 1)
                        for row in range(row0, row1 + 1):
                            z = top - (row + 0.5) * each_row
                            x = p0 + (z - z0) / (z1 - z0) * (p1 - p0)
                            if x < (slab + 0.5) * texel[p] or x > (slab + 1.5) * texel[p]:
                                continue
                            towards = np.float32(-x if sense == 0 else x)
                            sample = starts[side] + row * SAMPLES * across + column
                            if towards > nearest[sample]:
                                nearest[sample] = towards
                                found[sample] = t


@device
def _between(positions, a, b):  # type: ignore[no-untyped-def]
    """(3,) the way from one position to another."""
    return (
        np.float64(positions[b, 0]) - positions[a, 0],
        np.float64(positions[b, 1]) - positions[a, 1],
        np.float64(positions[b, 2]) - positions[a, 2],
    )


@device
def _dot(u, v):  # type: ignore[no-untyped-def]
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@device
def _weights(u, v, p):  # type: ignore[no-untyped-def]
    """(b, c): weights of the second and third corner at a point of a triangle's plane.

    u, v: (3,) edges from the first corner to these. p: (3,) the point, from the first corner.
    """
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    pu, pv = _dot(p, u), _dot(p, v)
    area = uu * vv - uv * uv
    if area <= 0.0:
        return 0.0, 0.0
    return (pu * vv - pv * uv) / area, (pv * uu - pu * uv) / area


@device
def _footprint(surface, materials, material, ia, ib, ic, area):  # type: ignore[no-untyped-def]
    """Texels of the material's image for a square metre of a triangle. area: twice its own, square metres."""
    texture = materials.texture[material]
    u = surface.uvs
    du, dv = u[ib, 0] - u[ia, 0], u[ib, 1] - u[ia, 1]
    eu, ev = u[ic, 0] - u[ia, 0], u[ic, 1] - u[ia, 1]
    across = abs(np.float64(du) * ev - np.float64(dv) * eu) * materials.size[texture, 0] * materials.size[texture, 1]
    return across / max(area, 1e-12)


@kernel(
    types.void(
        SURFACE, MATERIALS, I32_1, I32_2, I32_1, F32_2, types.int64, types.int64, F32_1, F32_1, I32_1, F32_3, F32_2
    )
)
def paint_walls(  # type: ignore[no-untyped-def]
    surface, materials, sides, places, starts, heights, n, across, texel, nearest, found, sums, normals
):
    """Adds the colours of all samples to the image of walls.

    sides: those that are walls. sums: (rows, columns, 4) float32 out, linear light and how many samples. normals:
    (4 n n, 3) float32 out, of each side the sum of unit normals that face the looker. The others: see `find_walls`.
    """
    positions = surface.positions
    for at in range(sides.shape[0]):
        side = np.int64(sides[at])
        k = side & 3
        i = (side >> 2) % n
        j = (side >> 2) // n
        axis = k >> 1
        rows = places[side, 2] * SAMPLES
        top = np.float64(heights[side, 0])
        each_row = (top - np.float64(heights[side, 1])) / max(rows, 1)
        each = np.float64(texel[1 - axis]) / (SAMPLES * across)
        along = (j if axis == 0 else i) * np.float64(texel[1 - axis])
        for row in range(rows):
            for column in range(SAMPLES * across):
                sample = starts[side] + row * SAMPLES * across + column
                if nearest[sample] == _HIDDEN:
                    continue
                t = np.uintp(found[sample])
                ia = np.uintp(surface.triangles[t, 0])
                ib = np.uintp(surface.triangles[t, 1])
                ic = np.uintp(surface.triangles[t, 2])
                seen = np.float64(nearest[sample]) if k & 1 else -np.float64(nearest[sample])
                beside = along + (column + 0.5) * each
                x, y = (seen, beside) if axis == 0 else (beside, seen)
                z = top - (row + 0.5) * each_row
                u, v = _between(positions, ia, ib), _between(positions, ia, ic)
                wb, wc = _weights(u, v, (x - positions[ia, 0], y - positions[ia, 1], z - positions[ia, 2]))
                b = np.float32(min(max(wb, 0.0), 1.0))
                c = np.float32(min(max(wc, 0.0), 1.0 - b))
                a = np.float32(1.0) - b - c
                gx, gy, gz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
                area = math.sqrt(gx * gx + gy * gy + gz * gz)
                material = surface.materials[t]
                across_texels = np.float32(0.0)
                if is_textured(surface, materials, material):
                    density = _footprint(surface, materials, material, ia, ib, ic, area)
                    texture = materials.texture[material]
                    across_texels = np.float32(math.sqrt(density * each * max(each_row, each)))
                    across_texels /= np.float32(materials.size[texture, 0])
                red, green, blue = albedo(
                    surface, materials, material, ia, ib, ic, a, b, c,
                    across_texels, np.float32(0.0), np.float32(0.0), np.float32(0.0),
                )  # fmt: skip
                image_column = places[side, 0] + column // SAMPLES
                image_row = places[side, 1] + row // SAMPLES
                sums[image_row, image_column, 0] += red
                sums[image_row, image_column, 1] += green
                sums[image_row, image_column, 2] += blue
                sums[image_row, image_column, 3] += np.float32(1.0)
                # On the side of the surface that the looker is on.
                facing = gx if axis == 0 else gy
                sense = 1.0 if (facing > 0.0) == (k & 1 == 1) else -1.0
                scale = sense / max(area, 1e-12)
                normals[side, 0] += np.float32(gx * scale)
                normals[side, 1] += np.float32(gy * scale)
                normals[side, 2] += np.float32(gz * scale)
