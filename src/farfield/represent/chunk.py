"""The triangles of one cell, cut at its walls: what every representation of the cell is built from (OV 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from farfield.kernels import order as kernels
from farfield.kernels.surface import Surface

if TYPE_CHECKING:
    from farfield.represent.blocks import BlockedMesh


@dataclass(frozen=True, slots=True)
class Chunk:
    """Triangles of one leaf cell. Their order decides between surfaces at equal depth: the earlier one is seen.

    Positions are relative to the cell's lower corner, so that single precision is fine enough anywhere in the world:
    a 1 km cell has steps of 0.06 mm, 1/32768 of its pixel pitch at 512 pixels.
    """

    positions: NDArray[np.float32]
    """(n, 3) float32 metres from the cell's lower corner, world axes."""
    normals: NDArray[np.float32]
    """(n, 3) float32 unit shading normals."""
    uvs: NDArray[np.float32]
    """(n, 2) float32, or (0, 2) when no part has texture coordinates."""
    colors: NDArray[np.uint8]
    """(n, 4) uint8 sRGB and alpha, or (0, 4) when no part has vertex colours."""
    triangles: NDArray[np.uint32]
    """(m, 3) uint32, counter-clockwise seen from outside."""
    materials: NDArray[np.uint32]
    """(m,) uint32 into a MaterialTable."""
    objects: NDArray[np.uint32]
    """(m,) uint32 object id, 0 = none."""

    @classmethod
    def whole(cls, mesh: BlockedMesh) -> Chunk:
        """All triangles of a mesh in its own frame, its own material and object numbers."""
        return mesh.placed(np.eye(3, 4), mesh.all_blocks).chunk()

    @property
    def surface(self) -> Surface:
        """The same arrays as kernels take them."""
        return Surface(
            self.positions, self.normals, self.uvs, self.colors, self.triangles, self.materials, self.objects
        )

    @property
    def bounds(self) -> NDArray[np.float32]:
        """(2, 3) float32: lower and upper corner of the positions, inclusive."""
        # A column at a time: NumPy takes 10 times as long over rows of three.
        columns = [self.positions[:, axis] for axis in range(3)]
        return np.array([[c.min() for c in columns], [c.max() for c in columns]], dtype=np.float32)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        return sum(array.nbytes for array in self.surface)


_POWERS = np.array([pow(0x9E3779B97F4A7C15, k, 1 << 64) for k in range(1, 10)], dtype=np.uint64)
"""Of an odd number, as in a polynomial hash: multiples of one would let sums of few bits meet."""


def ordered(chunk: Chunk) -> Chunk:
    """The same triangles along a space-filling curve, in an order that they alone decide.

    Two facets that meet in a silhouette are equally deep along it, and the earlier is seen: in this order the pictures
    of a mesh and of its pieces are the same to the bit.
    """
    codes = np.empty(len(chunk.triangles), np.uint64)
    kernels.curve_codes(chunk.positions, chunk.triangles, codes)
    order = np.argsort(codes)
    codes = codes[order]
    same = codes[1:] == codes[:-1]
    if same.any():
        # In one step of the curve: by whatever tells them apart. Few are: all that are go to their places at once.
        tied = np.flatnonzero(np.append(False, same) | np.append(same, False))
        rows = np.sort(order[tied])
        corners = chunk.positions[chunk.triangles[rows]].reshape(-1, 9)
        bits = (corners.view(np.uint32) * _POWERS).sum(1, dtype=np.uint64)
        own = np.empty(len(chunk.triangles), np.uint64)
        own[order] = codes
        order[tied] = rows[np.lexsort((bits, own[rows]))]
    return replace(
        chunk, triangles=chunk.triangles[order], materials=chunk.materials[order], objects=chunk.objects[order]
    )


def fingerprint(chunk: Chunk) -> bytes:
    """16 bytes that tell what is drawn of the triangles, in their order, from anything else (kernels.order)."""
    marks = np.zeros(2, np.uint64)
    corners = chunk.positions.view(np.uint32), chunk.normals.view(np.uint32), chunk.uvs.view(np.uint32)
    colors = chunk.colors.view(np.uint32)
    kernels.fingerprint(*corners, colors, chunk.triangles, chunk.materials, chunk.objects, marks)
    return marks.tobytes()


def merge(chunks: Sequence[Chunk]) -> Chunk:
    """One chunk with the triangles of all, in their order. Missing texture coordinates become 0, colours white.

    Raises ValueError for an empty sequence.
    """
    if len(chunks) == 1:
        return chunks[0]
    counts = [len(c.positions) for c in chunks]
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.uint32)
    uvs = [_filled(c.uvs, n, 0) for c, n in zip(chunks, counts, strict=True)]
    colors = [_filled(c.colors, n, 255) for c, n in zip(chunks, counts, strict=True)]
    return Chunk(
        np.concatenate([c.positions for c in chunks]),
        np.concatenate([c.normals for c in chunks]),
        np.concatenate(uvs) if any(len(c.uvs) for c in chunks) else chunks[0].uvs,
        np.concatenate(colors) if any(len(c.colors) for c in chunks) else chunks[0].colors,
        np.concatenate([c.triangles + f for c, f in zip(chunks, first, strict=True)]),
        np.concatenate([c.materials for c in chunks]),
        np.concatenate([c.objects for c in chunks]),
    )


def _filled(array: NDArray[Any], rows: int, value: int) -> NDArray[Any]:
    return array if len(array) else np.full((rows, array.shape[1]), value, dtype=array.dtype)
