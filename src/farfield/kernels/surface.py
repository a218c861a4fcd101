"""What every drawing kernel reads: the triangles of a cell and the materials, as named tuples of flat arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray


class Surface(NamedTuple):
    """Triangles with attributes at their corners; metres in any frame whose axes are the world's."""

    positions: NDArray[np.float32]
    """(n, 3) float32."""
    normals: NDArray[np.float32]
    """(n, 3) float32, any length; for shading only."""
    uvs: NDArray[np.float32]
    """(n, 2) float32, or (0, 2): no texture coordinates."""
    colors: NDArray[np.uint8]
    """(n, 4) uint8 sRGB and alpha, or (0, 4): white."""
    triangles: NDArray[np.uint32]
    """(m, 3) uint32 into the corners."""
    materials: NDArray[np.uint32]
    """(m,) uint32 into Materials."""
    objects: NDArray[np.uint32]
    """(m,) uint32 object id, 0 = none."""


class Materials(NamedTuple):
    """Materials and one pool of mip-mapped textures."""

    base_color: NDArray[np.float32]
    """(k, 4) float32 linear light and alpha."""
    texture: NDArray[np.int32]
    """(k,) int32 into the textures; -1 = none."""
    cutoff: NDArray[np.float32]
    """(k,) float32: alpha below this is a hole; negative = opaque."""
    unlit: NDArray[np.uint8]
    """(k,) uint8 0 or 1."""
    level: NDArray[np.int64]
    """(t, 17) int64: offset in pixels of each mip level of each texture in the pool; unused levels repeat the last."""
    size: NDArray[np.int32]
    """(t, 3) int32 width, height, number of levels; level l is max(1, width >> l) wide."""
    pixels: NDArray[np.uint8]
    """(p, 4) uint8 sRGB and alpha of all levels, row by row."""
    mask: NDArray[np.int64]
    """(k,) int64: first byte of the material's alpha mask in mask_bits; -1: none, compare alpha itself."""
    mask_bits: NDArray[np.uint8]
    """(b,) uint8: a bit a texel of the full-resolution level, least significant first, 1 = kept; rows start at bytes.
    A leaf of a tree looks at texels far apart: a megapixel of bits stays in the cache, of pixels it does not."""


def _array(dtype: types.Type, dimensions: int) -> types.Type:
    return types.Array(dtype, dimensions, "C")


F32_1, F32_2, F32_3 = (_array(types.float32, d) for d in (1, 2, 3))
F64_1, F64_2, F64_3 = (_array(types.float64, d) for d in (1, 2, 3))
U8_1, U8_2, U8_3 = (_array(types.uint8, d) for d in (1, 2, 3))
I32_1, I32_2 = (_array(types.int32, d) for d in (1, 2))
I64_1, I64_2 = (_array(types.int64, d) for d in (1, 2))
U32_1, U32_2 = (_array(types.uint32, d) for d in (1, 2))

SURFACE = types.NamedTuple((F32_2, F32_2, F32_2, U8_2, U32_2, U32_1, U32_1), Surface)
"""Numba type of Surface, for explicit signatures."""
MATERIALS = types.NamedTuple((F32_2, I32_1, F32_1, U8_1, I64_2, I32_2, U8_2, I64_1, U8_1), Materials)
"""Numba type of Materials."""

NOTHING = np.uint32(0xFFFFFFFF)
"""Triangle id of a sample that nothing covers."""
FAR = np.float32(3.0e38)
"""Depth of a sample that nothing covers."""
