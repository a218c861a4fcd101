"""A BlockMap from the triangles of a cell: tops as seen from above, walls as seen from beside (BLK 3.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR
from farfield.geometry.directions import TOP, principal
from farfield.kernels.fill import fill_invalid
from farfield.kernels.project import project_orthographic
from farfield.kernels.resolve import PLANES, resolve
from farfield.kernels.walls import SAMPLES, find_walls, paint_walls
from farfield.represent.blockmap.blockmap import STEEP, STEEPEST, BlockMap, BlockMapSize, turns_of
from farfield.represent.blockmap.caps import NO_OBJECT, inside_at_top
from farfield.represent.blockmap.unfolding import DENSITIES
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.visibility import nearest_surface

TOP_SAMPLES = 3
"""Of a texel seen from above, along each axis: an odd number, one is in the middle; 5 take twice as long."""
CODES = 255
ALIKE = 0.5
"""Of a texel's width: what is no higher or lower than that from its middle looks like its top."""
FINEST = 2
"""Columns of a side, at most."""
TALL = (1.5, 1.0)
"""Texels for the height of a wall's texel that are tried, for each one across."""
LOWEST_WALL = 0.25
"""Of a texel's width: what is lower has no texels of its own."""
_NOTHING = np.float32(-3.0e38)
_INSIDE = np.float32(0.2)
"""Linear light of what is cut off above: it is seen only until that is there."""
_UP = np.array([0, 0, 1], np.float32)


@dataclass(frozen=True, slots=True)
class Square:
    """The cell that a BlockMap is of."""

    width: float
    """Metres along x."""
    depth: float
    """Along y."""
    height: float
    """Of the cell; what reaches its upper side goes on above it."""

    def texel(self, side: int) -> NDArray[np.float32]:
        """(2,) metres along x and y."""
        return np.array([self.width / side, self.depth / side], np.float32)


def build_blockmap(
    chunk: Chunk,
    materials: MaterialTable,
    square: Square,
    size: BlockMapSize,
    by_area: bool = True,
    sloped: bool = True,
) -> BlockMap | None:
    """A BlockMap of a cell; None when nothing is seen of it from above.

    chunk: metres from the cell's lower corner, nothing outside of it. by_area: see BlockMap. sloped: whether roofs that
    slope are planes (BLK 6, future work); else every top is flat.
    """
    tops = _Tops.seen(chunk, materials, square, size.side)
    if not np.isfinite(tops.height).any():
        return None
    low, step, codes = quantised(tops.height, float(chunk.bounds[0, 2]))
    slopes = tops.slopes if sloped and tops.slopes.any() else None
    texel = square.texel(size.side)
    least = least_drop(texel, step)
    border = _walls_on_rim(chunk, square, size.side)
    frame = BlockMap(
        size, low, step, codes, slopes, border, least, 0, 0, by_area,
        np.empty((0, 0, 3), np.uint8), np.empty(0, np.uint8), tops.objects,
    )  # fmt: skip
    frame = replace(frame, floors=hanging(codes, border, _floors(chunk, tops.objects, low, step)))
    fitted = fitted_to(frame, float(texel.mean()))
    return _painted(fitted, chunk, materials, square, tops.color)


def quantised(heights: NDArray[np.float32], low: float) -> tuple[float, float, NDArray[np.uint8]]:
    """(low, step, codes) of (n, n) metres, NaN: nothing there. low: metres down to which walls go."""
    known = np.isfinite(heights)
    low = float(np.float32(min(low, heights[known].min())))
    step = float(np.float32(max((float(heights[known].max()) - low) / (CODES - 1), 1e-3)))
    codes = np.zeros(heights.shape, np.uint8)
    codes[known] = np.clip(np.round((heights[known] - low) / step), 0, CODES - 1).astype(np.uint8) + 1
    return low, step, codes


def fitted_to(blockmap: BlockMap, texel: float, finest: int = FINEST) -> BlockMap:
    """With the finest texels on walls that these have room for. texel: of the map, metres."""
    if not blockmap.by_area:
        return replace(blockmap, density=DENSITIES.index((1, 1)), scale=1)
    found = blockmap
    for density, (across, sharing) in enumerate(DENSITIES):
        for tall in TALL:
            scale = round(256 * blockmap.step * tall * across / sharing / texel)
            if across > finest or scale < 1:
                continue
            found = replace(blockmap, density=density, scale=min(scale, 65535))
            if found.unfolded.rows <= blockmap.size.side:
                return found
    return replace(found, scale=1)


def least_drop(texel: NDArray[np.float32], step: float) -> int:
    """Steps of height that a wall has at least. texel: (2,) metres."""
    return min(max(1, int(np.ceil(LOWEST_WALL * float(texel.min()) / step))), 255)


def _floors(chunk: Chunk, objects: NDArray[np.uint32], low: float, step: float) -> NDArray[np.uint8]:
    """(n, n) code of the lowest point of the object in each texel; 0: it is not known."""
    ids, which = np.unique(chunk.objects, return_inverse=True)
    lowest = np.full(len(ids), np.inf)
    np.minimum.at(lowest, which, chunk.positions[chunk.triangles, 2].min(axis=1))
    place = np.minimum(np.searchsorted(ids, objects), len(ids) - 1)
    known = (objects > 0) & (ids[place] == objects)
    codes = np.clip(np.round((lowest[place] - low) / step), 0, CODES - 1).astype(np.uint8) + 1
    return np.where(known, codes, 0).astype(np.uint8)


def hanging(codes: NDArray[np.uint8], border: NDArray[np.uint8], floors: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Floors, if any can be seen: what stands beside a texel, or the ground there, does not reach up to its own."""
    n = len(codes)
    beside = np.zeros((n, n, 4), np.int32)
    beside[:, 1:, 0], beside[:, :-1, 1] = codes[:, :-1], codes[:, 1:]
    beside[1:, :, 2], beside[:-1, :, 3] = codes[:-1], codes[1:]
    inner = np.zeros((n, n, 4), bool)
    inner[:, 1:, 0] = inner[:, :-1, 1] = inner[1:, :, 2] = inner[:-1, :, 3] = True
    rim = np.zeros((n, n, 4), bool)
    rim[:, 0, 0], rim[:, -1, 1], rim[0, :, 2], rim[-1, :, 3] = border.astype(bool)
    lower = np.maximum(beside, 1)
    seen = (codes[..., None] > lower) & (floors[..., None] > lower + 1) & (inner | rim)
    return np.minimum(floors, codes) if seen.any() else None


@dataclass(frozen=True, slots=True)
class _Tops:
    """The cell from above, row by row along y."""

    height: NDArray[np.float32]
    """(n, n) metres in the middle of each texel; NaN: nothing there."""
    color: NDArray[np.uint8]
    """(n, n, 3) sRGB, mean of what is about as high as the middle."""
    slopes: NDArray[np.int8]
    """(n, n, 2)"""
    objects: NDArray[np.uint32]
    """(n, n)"""

    @classmethod
    def seen(cls, chunk: Chunk, materials: MaterialTable, square: Square, side: int) -> _Tops:
        shape = side * TOP_SAMPLES, side * TOP_SAMPLES
        axes = principal(TOP).axes
        pitch = square.texel(side).astype(np.float64) / TOP_SAMPLES
        matrix = np.concatenate([axes / np.array([pitch[0], pitch[1], 1.0])[:, None], np.zeros((3, 1))], axis=1)
        matrix[1, 3] = shape[0]
        screen = np.empty((len(chunk.positions), 4), np.float32)
        project_orthographic(chunk.positions, matrix, np.zeros(3), 1, screen)
        depth, ids = nearest_surface(screen, chunk, materials, shape)
        pixels, objects = np.empty((*shape, PLANES), np.float32), np.empty(shape, np.uint32)
        none, rows = np.empty((0, 0), np.float32), axes.astype(np.float32)
        resolve(screen, chunk.surface, materials.arrays, rows, 1, np.float32(1), depth, ids, none, pixels, objects)
        # From image rows, which go down, to rows along y.
        pixels, objects = pixels[::-1], objects[::-1]
        heights = np.where(pixels[..., 1] > 0, -pixels[..., 0], np.float32(np.nan))
        above = inside_at_top(chunk, square.height, shape, (square.width, square.depth))
        goes_on = (above > 0) & ~(heights > square.height)
        heights = np.where(goes_on, np.float32(square.height), heights)
        color = np.where(goes_on[..., None], _INSIDE, pixels[..., 3:6])
        middle = slice(TOP_SAMPLES // 2, None, TOP_SAMPLES)
        known = heights[middle, middle]
        alike = np.abs(heights - known.repeat(TOP_SAMPLES, 0).repeat(TOP_SAMPLES, 1))
        weights = (alike <= ALIKE * square.texel(side).mean()).astype(np.float32)[..., None]
        mean = _by_texel(color * weights) / np.maximum(_by_texel(weights), 1)
        normals = np.stack([pixels[..., 6], -pixels[..., 7], pixels[..., 8]], axis=-1)
        normals = np.where(goes_on[..., None], _UP, normals)[middle, middle]
        named = np.where(goes_on, np.where(above == NO_OBJECT, 0, above), objects)[middle, middle]
        there = np.isfinite(known)
        return cls(
            np.ascontiguousarray(known),
            fill_invalid(to_bytes(mean), there),
            _slopes(normals, there),
            np.where(there, named, 0).astype(np.uint32),
        )


def to_bytes(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """sRGB of linear light."""
    return np.asarray(BYTE_OF_LINEAR[np.clip(linear * 4095 + 0.5, 0, 4095).astype(np.uint16)])


def _by_texel(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    rows, columns = (size // TOP_SAMPLES for size in samples.shape[:2])
    return np.asarray(samples.reshape(rows, TOP_SAMPLES, columns, TOP_SAMPLES, -1).sum(axis=(1, 3)))


def _slopes(normals: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.int8]:
    up = np.maximum(normals[..., 2:], 1e-6)
    steps = np.round(-normals[..., :2] / up * STEEP)
    steep = (np.abs(steps) > STEEPEST).any(axis=-1, keepdims=True) | ~known[..., None]
    return np.where(steep, 0, steps).astype(np.int8)


def _walls_on_rim(chunk: Chunk, square: Square, side: int) -> NDArray[np.uint8]:
    """(4, n) whether a wall faces outwards within half a texel of the rim of the map."""
    corners = chunk.positions[chunk.triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    texel, extent = square.texel(side).astype(np.float64), (square.width, square.depth)
    found = np.zeros((4, side), np.uint8)
    for k in range(4):
        axis, sense = k >> 1, 1 if k & 1 else -1
        along = corners[:, :, axis]
        near = (
            (along.max(axis=1) > extent[axis] - texel[axis] / 2) if sense > 0 else (along.min(axis=1) < texel[axis] / 2)
        )
        rows = np.flatnonzero(near & (sense * normals[:, axis] > 0.3 * length))
        beside = corners[rows, :, 1 - axis] / texel[1 - axis]
        first = np.clip(np.floor(beside.min(axis=1)), 0, side - 1).astype(np.int64)
        last = np.clip(np.ceil(beside.max(axis=1)), 1, side).astype(np.int64)
        steps = np.zeros(side + 1, np.int64)
        np.add.at(steps, first, 1)
        np.add.at(steps, last, -1)
        found[k] = np.cumsum(steps)[:side] > 0
    return found


def _painted(
    blockmap: BlockMap, chunk: Chunk, materials: MaterialTable, square: Square, tops: NDArray[np.uint8]
) -> BlockMap:
    """With the colours and normals of its walls."""
    n, m = blockmap.size.side, blockmap.size.columns
    own = blockmap.unfolded
    places = own.places.reshape(-1, 3)
    heights = ends_of(blockmap)
    walls = np.flatnonzero(places[:, 2]).astype(np.int32)
    counts = places[:, 2].astype(np.int64) * SAMPLES * own.across * SAMPLES
    starts = (np.cumsum(counts) - counts).astype(np.int32)
    nearest, found = np.full(int(counts.sum()), _NOTHING), np.zeros(int(counts.sum()), np.int32)
    texel = square.texel(n)
    find_walls(chunk.surface, places, starts, heights, n, own.across, texel, nearest, found)
    sums, normals = np.zeros((n, m, 4), np.float32), np.zeros((4 * n * n, 3), np.float32)
    paint_walls(
        chunk.surface,
        materials.arrays,
        walls,
        places,
        starts,
        heights,
        n,
        own.across,
        texel,
        nearest,
        found,
        sums,
        normals,
    )
    painted = to_bytes(sums[..., :3] / np.maximum(sums[..., 3:], 1))
    image = fill_invalid(painted, sums[..., 3] > 0)
    colors = np.concatenate([tops, image], axis=1)
    return replace(blockmap, colors=colors, turns=turns_of(own, normals))


def ends_of(blockmap: BlockMap) -> NDArray[np.float32]:
    """(4 n n, 2) metres of the upper and of the lower end of the texels of each side in the image of walls."""
    n, codes, low, step = blockmap.size.side, blockmap.codes.astype(np.float32), blockmap.low, blockmap.step
    upper = np.broadcast_to(codes[..., None], (n, n, 4))
    if not blockmap.by_area:
        whole = np.array([low + (CODES - 1) * step, low], np.float32)
        return np.broadcast_to(whole, (4 * n * n, 2)).copy()
    beside = np.ones((n, n, 4), np.float32)
    beside[:, 1:, 0], beside[:, :-1, 1] = codes[:, :-1], codes[:, 1:]
    beside[1:, :, 2], beside[:-1, :, 3] = codes[:-1], codes[1:]
    floors = np.ones((n, n)) if blockmap.floors is None else np.maximum(blockmap.floors, 1)
    ends = np.stack([upper, np.maximum(beside, floors[..., None])], axis=-1)
    return np.ascontiguousarray((low + (ends - 1) * step).reshape(-1, 2), dtype=np.float32)
