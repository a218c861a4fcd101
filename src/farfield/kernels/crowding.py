"""How many surfaces lie over each other in a view, by tiles of samples; and drawing the last of them.

The rasterisers keep what is nearest. Drawn with depths negated, what they keep is the farthest; a limit is then not a
test of each fragment but what the buffers hold to begin with.
"""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.rasterise_key import key_of
from farfield.kernels.surface import F32_2, FAR, I64_2, NOTHING, U8_1, U32_1, U32_2

CROWD_TILE = 32
"""Samples along the side of a tile."""


@device
def _twice_area(screen, triangles, t):  # type: ignore[no-untyped-def]
    """Twice the signed area on the screen, square samples: negative for a triangle that faces the camera.

    In float64: on the grid of corners that is exact, and a sliver keeps its sign.
    """
    a = np.uintp(triangles[t, 0])
    b = np.uintp(triangles[t, 1])
    c = np.uintp(triangles[t, 2])
    ax = np.float64(screen[a, 0])
    ay = np.float64(screen[a, 1])
    return (screen[b, 0] - ax) * (screen[c, 1] - ay) - (screen[c, 0] - ax) * (screen[b, 1] - ay)


@kernel(types.void(F32_2, U32_2, U32_1, U8_1, types.int64, types.int64, types.int64, F32_2))
def crowding(screen, triangles, materials, double_sided, height, width, stride, surfaces):  # type: ignore[no-untyped-def]
    """Adds up the areas of the triangles that may be seen, by tiles: the mean number of surfaces over each other there.

    They are those of two-sided materials and the others that face the camera.

    screen: (n, 4) float32, as `rasterise` takes it; all corners inside the view. triangles: (m, 3) uint32. materials:
    (m,) uint32 into double_sided, (k,) uint8. height, width: of the view, samples. stride: every so many triangles
    stand for all.
    surfaces: (ceil(h / CROWD_TILE), ceil(w / CROWD_TILE)) float32 out. The area of a triangle is taken to be
    spread evenly over its bounding box.
    """
    for row in range(surfaces.shape[0]):
        for column in range(surfaces.shape[1]):
            surfaces[row, column] = np.float32(0.0)
    scale = np.float32(1.0 / CROWD_TILE)
    weight = np.float32(0.5 / (CROWD_TILE * CROWD_TILE)) * np.float32(stride)
    for t in range(0, triangles.shape[0], stride):
        twice = _twice_area(screen, triangles, t)
        if twice == 0.0 or (twice > 0.0 and double_sided[materials[t]] == 0):
            continue
        a = np.uintp(triangles[t, 0])
        b = np.uintp(triangles[t, 1])
        c = np.uintp(triangles[t, 2])
        left = min(screen[a, 0], min(screen[b, 0], screen[c, 0])) * scale
        right = max(screen[a, 0], max(screen[b, 0], screen[c, 0])) * scale
        top = min(screen[a, 1], min(screen[b, 1], screen[c, 1])) * scale
        bottom = max(screen[a, 1], max(screen[b, 1], screen[c, 1])) * scale
        density = weight * np.float32(abs(twice)) / ((right - left) * (bottom - top))
        for row in range(max(int(top), 0), min(int(bottom) + 1, surfaces.shape[0])):
            high = min(bottom, np.float32(row + 1)) - max(top, np.float32(row))
            for column in range(max(int(left), 0), min(int(right) + 1, surfaces.shape[1])):
                wide = min(right, np.float32(column + 1)) - max(left, np.float32(column))
                surfaces[row, column] += density * high * wide
    for row in range(surfaces.shape[0]):
        for column in range(surfaces.shape[1]):
            rows = min(CROWD_TILE, height - row * CROWD_TILE)
            columns = min(CROWD_TILE, width - column * CROWD_TILE)
            surfaces[row, column] *= np.float32(CROWD_TILE * CROWD_TILE / (rows * columns))


@kernel(types.int64(F32_2, U32_2, U32_1, U8_1, F32_2, types.float32, types.boolean, U32_1))
def touching(screen, triangles, materials, double_sided, surfaces, crowd, crowded, names):  # type: ignore[no-untyped-def]
    """Which triangles to draw where there are at least `crowd` surfaces (crowded) or less (not); returns how many.

    Those that may touch such a tile; of a crowd, only those that may be seen.

    screen, triangles, materials, double_sided, surfaces: as for `crowding`. names: (m,) uint32 out, ascending.
    """
    scale = np.float32(1.0 / CROWD_TILE)
    count = 0
    for t in range(triangles.shape[0]):
        if crowded and double_sided[materials[t]] == 0 and _twice_area(screen, triangles, t) >= 0.0:
            continue
        a = np.uintp(triangles[t, 0])
        b = np.uintp(triangles[t, 1])
        c = np.uintp(triangles[t, 2])
        left = int(min(screen[a, 0], min(screen[b, 0], screen[c, 0])) * scale)
        right = int(max(screen[a, 0], max(screen[b, 0], screen[c, 0])) * scale)
        top = int(min(screen[a, 1], min(screen[b, 1], screen[c, 1])) * scale)
        bottom = int(max(screen[a, 1], max(screen[b, 1], screen[c, 1])) * scale)
        touches = False
        for row in range(max(top, 0), min(bottom + 1, surfaces.shape[0])):
            for column in range(max(left, 0), min(right + 1, surfaces.shape[1])):
                touches |= (surfaces[row, column] >= crowd) == crowded
        if touches:
            names[count] = t
            count += 1
    return count


@kernel(types.void(F32_2, F32_2, types.float32, types.boolean, F32_2))
def limits_where(behind, surfaces, crowd, crowded, limits):  # type: ignore[no-untyped-def]
    """behind (h, at least w) where the tile has at least `crowd` surfaces (crowded) or less (not), FAR elsewhere.

    limits: (h, at least w) float32 out.
    """
    for y in range(limits.shape[0]):
        for x in range(limits.shape[1]):
            tile = surfaces[y // CROWD_TILE, min(x // CROWD_TILE, surfaces.shape[1] - 1)]
            limits[y, x] = behind[y, x] if (tile >= crowd) == crowded else FAR


@kernel(types.void(F32_2, I64_2))
def begin_keys(limits, keys):  # type: ignore[no-untyped-def]
    """Makes keys (h, w + LANES) take only what is, negated, behind limits (h, w + LANES)."""
    for y in range(keys.shape[0]):
        for x in range(keys.shape[1]):
            keys[y, x] = key_of(-limits[y, x], np.int64(0))


@kernel(types.void(F32_2, F32_2, F32_2, U32_2))
def turn_back(limits, negated, depth, ids):  # type: ignore[no-untyped-def]
    """Into depth (h, w) what was drawn negated into `negated` (h, w) and ids: FAR and NOTHING where nothing was."""
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            z = -negated[y, x]
            found = z > limits[y, x]
            depth[y, x] = z if found else FAR
            ids[y, x] = ids[y, x] if found else NOTHING


@kernel(types.void(F32_2, U32_2, F32_2, U32_2))
def fill_in(other_depth, other_ids, depth, ids):  # type: ignore[no-untyped-def]
    """Takes from other_depth and other_ids (h, w) where nothing is yet."""
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            if ids[y, x] == NOTHING:
                depth[y, x] = other_depth[y, x]
                ids[y, x] = other_ids[y, x]
