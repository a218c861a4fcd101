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
from farfield.kernels.surface import NOTHING
from farfield.kernels.walls import SAMPLES, find_walls, paint_walls
from farfield.represent.blockmap.blockmap import CODES, STEEP, STEEPEST, BlockMap, BlockMapSize, turns_of
from farfield.represent.blockmap.caps import CLOSE, NO_OBJECT, inside_at_top
from farfield.represent.blockmap.unfolding import DENSITIES
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.visibility import nearest_surface

TOP_SAMPLES = 3
"""Of a texel seen from above, along each axis: an odd number, one is in the middle; 5 take twice as long."""
ALIKE = 0.5
"""Of a texel's width: what is no higher or lower than that from its middle looks like its top."""
FINEST = 2
"""Columns of a side, at most."""
TALL = (1.5, 1.0)
"""Texels for the height of a wall's texel that are tried, for each one across."""
LOWEST_WALL = 0.25
"""Of a texel's width: what is lower has no texels of its own."""
STANDS = 0.4
"""Of what is open below a roof, at least, for it to stand on what is seen there: turned walls behind eaves fill 0.65,
a house beside one on posts 0.25."""
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
    pitch = float(texel.mean())
    floors = _floors(chunk, tops.objects, low, step)
    if hanging(codes, border, floors) is not None:
        floors = _down_to_ground(frame, floors, chunk, materials, square)
    if hanging(codes, border, floors) is not None:
        floors = _down_to_walls(fitted_to(frame, pitch), floors, chunk, square)
    fitted = fitted_to(replace(frame, floors=hanging(codes, border, floors)), pitch)
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
            if across > finest:
                continue
            scale = round(256 * blockmap.step * tall * across / sharing / texel)
            found = replace(blockmap, density=density, scale=min(max(scale, 1), 65535))
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
    return np.minimum(floors, codes) if _open_sides(codes, border, floors).any() else None


def _open_sides(codes: NDArray[np.uint8], border: NDArray[np.uint8], floors: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n, n, 4) sides below which there is something to be seen."""
    lower = _beside(codes)
    is_side = np.ones(lower.shape, bool)
    is_side[:, 0, 0], is_side[:, -1, 1], is_side[0, :, 2], is_side[-1, :, 3] = border.astype(bool)
    return (codes[..., None] > lower) & (floors[..., None] > lower + 1) & is_side


def _beside(codes: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(n, n, 4) of what is beside each side; at least 1, which is where walls end."""
    found = np.ones((*codes.shape, 4), np.int32)
    found[:, 1:, 0], found[:, :-1, 1] = codes[:, :-1], codes[:, 1:]
    found[1:, :, 2], found[:-1, :, 3] = codes[:-1], codes[1:]
    return np.maximum(found, 1)


def _down_to_ground(
    frame: BlockMap, floors: NDArray[np.uint8], chunk: Chunk, materials: MaterialTable, square: Square
) -> NDArray[np.uint8]:
    """Floors of what is wider than it is high above the lowest surface below, lowered to that.

    A texel has one body and nothing below: of a bridge one sees what is beyond, but through the stands of a stadium one
    would look at the sky where the ground is.
    """
    assert frame.objects is not None
    texel, shape = float(square.texel(frame.size.side).mean()), frame.codes.shape
    screen = _screen(chunk, square, frame.size.side)
    screen[:, 2] *= -1
    depth, ids = nearest_surface(screen, chunk, materials, shape)
    lowest = np.where(ids == NOTHING, np.inf, depth)[::-1]
    _, which = np.unique(frame.objects, return_inverse=True)
    which = which.reshape(-1)
    clear = np.maximum(frame.low + (floors.astype(np.float64) - 1) * frame.step - lowest, 0.0).reshape(-1)
    open_sides = _open_sides(frame.codes, frame.border, floors).sum(axis=-1).reshape(-1)
    area, rim, room = (np.bincount(which, weights) for weights in (None, open_sides, clear))
    is_wide = room / area < 2 * area / np.maximum(rim, 1) * texel
    return np.where(is_wide[which].reshape(shape), np.minimum(floors, _codes_below(lowest, frame)), floors)


def _codes_below(heights: NDArray[np.floating], frame: BlockMap) -> NDArray[np.uint8]:
    """Codes of the steps at or below heights, metres; the highest of inf."""
    return np.asarray(
        np.clip(np.floor((heights - frame.low) / frame.step), 0, CODES - 1).astype(np.uint8) + np.uint8(1)
    )


def _screen(chunk: Chunk, square: Square, side: int) -> NDArray[np.float32]:
    """(n, 4) vertices in a picture of the cell from above, `side` pixels wide and high; depth in metres downwards."""
    axes = principal(TOP).axes
    pitch = square.texel(side).astype(np.float64)
    matrix = np.concatenate([axes / np.array([pitch[0], pitch[1], 1.0])[:, None], np.zeros((3, 1))], axis=1)
    matrix[1, 3] = side
    screen = np.empty((len(chunk.positions), 4), np.float32)
    project_orthographic(chunk.positions, matrix, np.zeros(3), 1, screen)
    return screen


def _down_to_walls(frame: BlockMap, floors: NDArray[np.uint8], chunk: Chunk, square: Square) -> NDArray[np.uint8]:
    """Floors of what stands on walls of whichever object lowered to where these end: roofs are often objects.

    frame: without floors. An object stands on walls where these fill STANDS of what is open below its sides.
    """
    walls = _Walls.found_in(chunk, frame, square)
    side = np.repeat(np.arange(len(walls.counts)), walls.counts)
    height, half = walls.samples(side)
    floor = (frame.low + (floors.astype(np.float64) - 1) * frame.step).reshape(-1)[side // 4]
    below = _open_sides(frame.codes, frame.border, floors).reshape(-1)[side] & (height < floor)
    is_wall = below & (walls.nearest > _NOTHING)
    seen, there = (np.bincount(side[mask], minlength=len(walls.counts)) for mask in (below, is_wall))
    lowest = np.full(len(walls.counts), np.inf)
    np.minimum.at(lowest, side[is_wall], height[is_wall] - half[is_wall])
    assert frame.objects is not None
    ids, which = np.unique(frame.objects, return_inverse=True)
    which = which.reshape(-1).repeat(4)
    samples, standing = (np.bincount(which, many, len(ids)) for many in (seen, there))
    end = np.full(len(ids), np.inf)
    np.minimum.at(end, which, lowest)
    ends = np.where(standing > STANDS * samples, end, np.inf)[which[::4]].reshape(floors.shape)
    return np.minimum(floors, _codes_below(ends, frame))


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
        screen = _screen(chunk, square, shape[0])
        depth, ids = nearest_surface(screen, chunk, materials, shape)
        pixels, objects = np.empty((*shape, PLANES), np.float32), np.empty(shape, np.uint32)
        none, rows = np.empty((0, 0), np.float32), principal(TOP).axes.astype(np.float32)
        resolve(screen, chunk.surface, materials.arrays, rows, 1, np.float32(1), depth, ids, none, pixels, objects)
        # From image rows, which go down, to rows along y.
        pixels, objects = pixels[::-1], objects[::-1]
        heights = np.where(pixels[..., 1] > 0, -pixels[..., 0], np.float32(np.nan))
        above = inside_at_top(chunk, square.height, shape, (square.width, square.depth))
        # What closes a building just there is a roof.
        goes_on = (above > 0) & ~(heights > square.height * (1 - CLOSE))
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


@dataclass(frozen=True, slots=True)
class _Walls:
    """Which triangles samples of walls show, see kernels.walls."""

    places: NDArray[np.int32]
    """(4 n n, 3)"""
    counts: NDArray[np.int64]
    """(4 n n,) of samples."""
    starts: NDArray[np.int32]
    """(4 n n,)"""
    ends: NDArray[np.float32]
    """(4 n n, 2)"""
    nearest: NDArray[np.float32]
    """(samples,) _NOTHING: none."""
    triangle: NDArray[np.int32]
    """(samples,)"""
    across: int

    @classmethod
    def found_in(cls, chunk: Chunk, blockmap: BlockMap, square: Square) -> _Walls:
        own, n = blockmap.unfolded, blockmap.size.side
        places, ends = own.places.reshape(-1, 3), ends_of(blockmap)
        counts = places[:, 2].astype(np.int64) * SAMPLES * own.across * SAMPLES
        starts = (np.cumsum(counts) - counts).astype(np.int32)
        nearest, found = np.full(int(counts.sum()), _NOTHING), np.zeros(int(counts.sum()), np.int32)
        find_walls(chunk.surface, places, starts, ends, n, own.across, square.texel(n), nearest, found)
        return cls(places, counts, starts, ends, nearest, found, own.across)

    def samples(self, side: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(samples,) metres of their middles, and half of their heights. side: of each."""
        row = (np.arange(len(side)) - self.starts[side]) // (SAMPLES * self.across)
        top, bottom = self.ends[side].astype(np.float64).T
        each = (top - bottom) / (self.places[side, 2] * SAMPLES)
        return np.asarray(top - (row + 0.5) * each), np.asarray(each / 2)


def _painted(
    blockmap: BlockMap, chunk: Chunk, materials: MaterialTable, square: Square, tops: NDArray[np.uint8]
) -> BlockMap:
    """With the colours and normals of its walls."""
    n, m = blockmap.size.side, blockmap.size.columns
    found = _Walls.found_in(chunk, blockmap, square)
    walls = np.flatnonzero(found.places[:, 2]).astype(np.int32)
    sums, normals = np.zeros((n, m, 4), np.float32), np.zeros((4 * n * n, 3), np.float32)
    paint_walls(
        chunk.surface, materials.arrays, walls, found.places, found.starts, found.ends, n, found.across,
        square.texel(n), found.nearest, found.triangle, sums, normals,
    )  # fmt: skip
    painted = to_bytes(sums[..., :3] / np.maximum(sums[..., 3:], 1))
    image = fill_invalid(painted, sums[..., 3] > 0)
    colors = np.concatenate([tops, image], axis=1)
    return replace(blockmap, colors=colors, turns=turns_of(blockmap.unfolded, normals))


def ends_of(blockmap: BlockMap) -> NDArray[np.float32]:
    """(4 n n, 2) metres of the upper and of the lower end of the texels of each side in the image of walls."""
    n, codes, low, step = blockmap.size.side, blockmap.codes.astype(np.float32), blockmap.low, blockmap.step
    upper = np.broadcast_to(codes[..., None], (n, n, 4))
    if not blockmap.by_area:
        whole = np.array([low + (CODES - 1) * step, low], np.float32)
        return np.broadcast_to(whole, (4 * n * n, 2)).copy()
    floors = np.ones((n, n)) if blockmap.floors is None else blockmap.floors
    ends = np.stack([upper, np.maximum(_beside(blockmap.codes), floors[..., None])], axis=-1)
    return np.ascontiguousarray((low + (ends - 1) * step).reshape(-1, 2), dtype=np.float32)
