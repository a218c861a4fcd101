"""How far a ray may leap over a height map: the distance field of BLK 3.1, for a few heights of the ray.

The paper keeps the distance to the nearest building. In a dense city, most of a ray's way lies above low buildings;
so there is a distance for each of three heights, to what is higher than that.
"""

from __future__ import annotations

from numba import types

from farfield.kernels.compiling import kernel
from farfield.kernels.surface import F32_2, U8_2

LEAPS = 3
"""Heights for which there are distances."""


@kernel(types.void(F32_2, types.float32, U8_2))
def leaps(tops, height, out):  # type: ignore[no-untyped-def]
    """(n, n) float32 highest points of texels -> (n, n) uint8: texels to the nearest one above `height`, 0 = itself.

    Distances are those of a king on a chess board (Chebyshev): all texels within one less are no higher. 255 at most.
    """
    rows, columns = tops.shape
    for j in range(rows):
        for i in range(columns):
            if tops[j, i] > height:
                out[j, i] = 0
                continue
            least = 254
            if j > 0:
                for x in range(max(i - 1, 0), min(i + 2, columns)):
                    least = min(least, out[j - 1, x])
            if i > 0:
                least = min(least, out[j, i - 1])
            out[j, i] = least + 1
    for j in range(rows - 1, -1, -1):
        for i in range(columns - 1, -1, -1):
            least = types.int64(out[j, i])
            if j + 1 < rows:
                for x in range(max(i - 1, 0), min(i + 2, columns)):
                    least = min(least, types.int64(out[j + 1, x]) + 1)
            if i + 1 < columns:
                least = min(least, types.int64(out[j, i + 1]) + 1)
            out[j, i] = least
