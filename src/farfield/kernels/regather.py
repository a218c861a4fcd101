"""The walls of a BlockMap from those of the finer ones that it stands for."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F32_2, F32_3, I32_1, I32_2

SAMPLES = 2
"""Rows of samples in a row of texels."""
FACING = np.float32(0.1)
"""Cosine of a finer wall's normal to a side, beyond which it tells how the side is turned. In six random towns 69 to
81 % are then turned to the right face; by finer walls of the same side alone 64 to 78 %, and by all 8 to 13 % faced in.
"""
_ZERO = np.float32(0.0)


@device
def _sample(colors, places, ends, child, side, z, n, across, out):  # type: ignore[no-untyped-def]
    """Adds the colour of a finer side at height z, mean over its columns."""
    rows = types.int64(places[child, side, 2])
    upper = ends[child, side, 0]
    lower = ends[child, side, 1]
    share = (upper - z) / max(upper - lower, np.float32(1e-9))
    row = types.int64(places[child, side, 1]) + min(max(types.int64(math.floor(share * rows)), 0), rows - 1)
    weight = np.float32(1.0) / np.float32(across)
    for column in range(across):
        at = n + types.int64(places[child, side, 0]) + column
        for c in range(3):
            out[c] += weight * LINEAR_OF_BYTE[colors[child, row, at, c]]
    out[3] += np.float32(1.0)


@kernel(
    types.void(
        types.int32[:, :, ::1], types.int32[:, :, ::1], F32_3, types.uint8[:, :, :, ::1], F32_3, I32_1,
        types.int64, types.int64, I32_1, I32_2, F32_2, types.int64, F32_3, F32_2,
    ),
    allocates=True,
)  # fmt: skip
def gather_walls(  # type: ignore[no-untyped-def]
    source, fine_places, fine_ends, fine_colors, fine_azimuths, fine_across,
    wide, deep, sides, places, ends, across, sums, normals,
):  # fmt: skip
    """Paints the walls of a coarser map.

    source: (layers, rows, columns) which finer map lies there, -1: none. fine_places: (maps, 4 n n, 3), fine_ends:
    (maps, 4 n n, 2), fine_colors: (maps, n, n + m, 3), fine_azimuths: (maps, 4 n n, 2) cosine and sine, fine_across:
    (maps,) of these. wide, deep: finer texels in one of the coarser map along x and y. sides, places, ends, across: its
    own, as kernels.walls takes them. sums, normals: out, see there; a normal is 0 where no finer wall faces that way.
    """
    n = fine_colors.shape[1]
    own = np.zeros(4, np.float32)
    for at in range(sides.shape[0]):
        side = types.int64(sides[at])
        k = side & 3
        i = (side >> 2) % n
        j = (side >> 2) // n
        rows = places[side, 2] * SAMPLES
        upper = ends[side, 0]
        each = (upper - ends[side, 1]) / np.float32(max(rows, 1))
        columns = across if across > 1 else 1
        for row in range(rows):
            z = upper - (np.float32(row) + np.float32(0.5)) * each
            for column in range(columns):
                # First of the same side and at that height, then of the same side, then of any.
                for attempt in range(3):
                    own[:] = _ZERO
                    for layer in range(source.shape[0]):
                        for y in range(deep):
                            for x in range(wide):
                                part = y if k < 2 else x
                                parts = deep if k < 2 else wide
                                if columns > 1 and parts == 2 and attempt < 2 and part != column * parts // columns:
                                    continue
                                fine_x = i * wide + x
                                fine_y = j * deep + y
                                child = source[layer, fine_y // n, fine_x // n]
                                if child < 0:
                                    continue
                                texel = 4 * (n * (fine_y % n) + fine_x % n)
                                for other in range(4):
                                    if attempt < 2 and other != k:
                                        continue
                                    fine = texel + other
                                    if fine_places[child, fine, 2] == 0:
                                        continue
                                    inside = z <= fine_ends[child, fine, 0] and z >= fine_ends[child, fine, 1]
                                    if attempt == 0 and not inside:
                                        continue
                                    _sample(
                                        fine_colors, fine_places, fine_ends, child, fine, z, n, fine_across[child], own
                                    )
                                    # One that faces elsewhere tells nothing of how this one is turned.
                                    out = fine_azimuths[child, fine, k // 2]
                                    if (out if k % 2 else -out) > FACING:
                                        normals[side, 0] += fine_azimuths[child, fine, 0]
                                        normals[side, 1] += fine_azimuths[child, fine, 1]
                    if own[3] > _ZERO:
                        break
                if own[3] == _ZERO:
                    continue
                image_row = places[side, 1] + row // SAMPLES
                image_column = places[side, 0] + column
                weight = np.float32(1.0) / own[3]
                for c in range(3):
                    sums[image_row, image_column, c] += own[c] * weight
                sums[image_row, image_column, 3] += np.float32(1.0)
