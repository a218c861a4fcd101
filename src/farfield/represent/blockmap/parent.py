"""The BlockMap of a cell from those of its children, as these are stored (BLK 4).

A texel takes the height of one of the finer ones in its place, drawn from where it lies: a mean would fill the streets
and lower the houses, the highest or that of most would build the city over or clear it from level to level. Its colour
is the mean of those about as high, so levels agree in what they look like from above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.fill import fill_invalid
from farfield.kernels.regather import gather_walls
from farfield.represent.blockmap.blockmap import CODES, STEEP, STEEPEST, BlockMap, turns_of
from farfield.represent.blockmap.build import (
    Square,
    ends_of,
    fitted_to,
    hanging,
    least_drop,
    quantised,
    to_bytes,
)

_Number = TypeVar("_Number", np.float32, np.uint32)

FINEST_ABOVE = 1
"""Columns of a side, at most: such maps are seen from where a texel is a pixel."""


@dataclass(frozen=True, slots=True)
class ChildMap:
    """A BlockMap in a part of a coarser one."""

    blockmap: BlockMap
    place: tuple[int, int, int]
    """0 or 1 along x, y and z: where its cell lies in that above; always 0 along axes that do not merge."""
    rise: float
    """Metres from the lower corner of that cell up to its own."""


def build_parent(children: Sequence[ChildMap], square: Square, merges: tuple[int, int, int]) -> BlockMap:
    """The BlockMap of a cell. children: at least one, all of one size. merges: 1 along the axes that cells merge on."""
    size = children[0].blockmap.size
    n = size.side
    fine = _Fine.of(children, merges)
    tops = fine.thinned(merges)
    low, step, codes = quantised(tops.height, min(child.blockmap.low + child.rise for child in children))
    texel = square.texel(n)
    slopes = tops.slopes if tops.slopes.any() else None
    frame = BlockMap(
        size, low, step, codes, slopes, fine.rim(merges), least_drop(texel, step), 0, 0, children[0].blockmap.by_area,
        np.empty((0, 0, 3), np.uint8), np.empty(0, np.uint8), tops.objects,
    )  # fmt: skip
    under = np.clip(np.round((tops.floor - low) / step), 0, CODES - 1)
    floors = np.where(codes > 0, np.nan_to_num(under) + 1, 0).astype(np.uint8)
    frame = replace(frame, floors=hanging(codes, frame.border, floors))
    fitted = fitted_to(frame, float(texel.mean()), FINEST_ABOVE)
    return fine.painted(fitted, tops.color, merges)


@dataclass(frozen=True, slots=True)
class _Tops:
    height: NDArray[np.float32]
    color: NDArray[np.uint8]
    slopes: NDArray[np.int8]
    objects: NDArray[np.uint32] | None
    floor: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Fine:
    """What children show from above, laid side by side, and who they are."""

    maps: tuple[ChildMap, ...]
    source: NDArray[np.int32]
    """(layers, 1 or 2, 1 or 2) which of them lies there, from below, rows along y; -1: none."""
    height: NDArray[np.float32]
    """(h, w) metres from the lower corner of the cell above; NaN: nothing there."""
    color: NDArray[np.float32]
    """(h, w, 3) linear light."""
    slopes: NDArray[np.float32]
    """(h, w, 2)"""
    objects: NDArray[np.uint32] | None
    """(h, w)"""
    floor: NDArray[np.float32]
    """(h, w) metres down to which what stands there goes."""

    @classmethod
    def of(cls, children: Sequence[ChildMap], merges: tuple[int, int, int]) -> _Fine:
        n = children[0].blockmap.size.side
        across, deep, layers = (2 if merge else 1 for merge in merges)
        source = np.full((layers, deep, across), -1, np.int32)
        height = np.full((deep * n, across * n), np.nan, np.float32)
        color, slopes = np.zeros((*height.shape, 3), np.float32), np.zeros((*height.shape, 2), np.float32)
        named = all(child.blockmap.objects is not None for child in children)
        objects, floor = np.zeros(height.shape, np.uint32), np.full(height.shape, np.nan, np.float32)
        for number, child in sorted(enumerate(children), key=lambda one: one[1].place[2]):
            x, y, z = child.place
            source[z, y, x] = number
            part = slice(y * n, y * n + n), slice(x * n, x * n + n)
            own = child.blockmap
            there = own.codes > 0
            under = own.undersides + np.float32(child.rise)
            # What goes on above a cell stands on what is below it.
            on_it = height[part] >= under - np.float32(own.step)
            floor[part] = np.where(there & ~on_it, under, floor[part])
            height[part] = np.where(there, own.heights + np.float32(child.rise), height[part])
            color[part] = np.where(there[..., None], LINEAR_OF_BYTE[own.colors[:, :n]], color[part])
            rise = np.zeros((n, n, 2), np.float32) if own.slopes is None else own.slopes / np.float32(STEEP)
            slopes[part] = np.where(there[..., None], rise, slopes[part])
            if own.objects is not None:
                objects[part] = np.where(there, own.objects, objects[part])
        return cls(tuple(children), source, height, color, slopes, objects if named else None, floor)

    def thinned(self, merges: tuple[int, int, int]) -> _Tops:
        """One texel for each block."""
        wide, deep = merges[0] + 1, merges[1] + 1
        rows, columns = self.height.shape[0] // deep, self.height.shape[1] // wide
        height, color, slopes = (_blocks(a, rows, columns) for a in (self.height, self.color, self.slopes))
        chosen = _drawn(rows, columns, wide * deep)
        # One that is there, if any is.
        there = np.isfinite(height)
        others = np.argmax(there, axis=2)
        is_there = np.take_along_axis(there, chosen[..., None], 2)[..., 0]
        most = there.sum(axis=2) * 2 >= wide * deep
        # What is thin stays, where it is all that there is.
        alone = not (is_there | most).any()
        chosen = np.where(is_there | ~(most | alone), chosen, others)
        picked = np.take_along_axis(height, chosen[..., None], 2)[..., 0]
        spread = np.nan_to_num(np.nanmax(_or_zero(height), axis=2) - np.nanmin(_or_zero(height), axis=2))
        alike = there & (np.abs(height - picked[..., None]) <= spread[..., None] / 2 + 1e-3)
        weight = alike[..., None] / np.maximum(alike.sum(axis=2), 1)[..., None, None]
        known = np.isfinite(picked)
        mean = (color * weight).sum(axis=2)
        steps = np.round((slopes * weight).sum(axis=2) * STEEP)
        floor = np.take_along_axis(_blocks(self.floor, rows, columns), chosen[..., None], 2)[..., 0]
        named = None
        if self.objects is not None:
            named = np.take_along_axis(_blocks(self.objects, rows, columns), chosen[..., None], 2)[..., 0]
            named = np.where(known, named, 0).astype(np.uint32)
        steep = (np.abs(steps) > STEEPEST).any(axis=2, keepdims=True) | ~known[..., None]
        return _Tops(
            picked.astype(np.float32),
            fill_invalid(to_bytes(mean), known),
            np.where(steep, 0, steps).astype(np.int8),
            named,
            floor,
        )

    def rim(self, merges: tuple[int, int, int]) -> NDArray[np.uint8]:
        """(4, n) as BlockMap.border: where one of the finer sides there is a wall."""
        n = self.maps[0].blockmap.size.side
        found = np.zeros((4, n), np.uint8)
        for k in range(4):
            axis, last = k >> 1, k & 1
            wide = merges[1 - axis] + 1
            lines = np.zeros(n * wide, np.uint8)
            for child in self.maps:
                if child.place[axis] == (merges[axis] if last else 0):
                    first = child.place[1 - axis] * n
                    lines[first : first + n] |= child.blockmap.border[k]
            found[k] = lines.reshape(n, wide).max(axis=1)
        return found

    def painted(self, blockmap: BlockMap, tops: NDArray[np.uint8], merges: tuple[int, int, int]) -> BlockMap:
        """With the colours and normals of its walls."""
        n, m, own = blockmap.size.side, blockmap.size.columns, blockmap.unfolded
        maps = [child.blockmap for child in self.maps]
        unfolded = [one.unfolded for one in maps]
        angles = np.stack([one.azimuths.reshape(-1) for one in maps])
        ends = np.stack([ends_of(c.blockmap) + np.float32(c.rise) for c in self.maps])
        sums, normals = np.zeros((n, m, 4), np.float32), np.zeros((4 * n * n, 3), np.float32)
        places = own.places.reshape(-1, 3)
        gather_walls(
            self.source,
            np.stack([one.places.reshape(-1, 3) for one in unfolded]),
            ends,
            np.stack([one.colors for one in maps]),
            np.stack([np.cos(angles), np.sin(angles)], axis=-1),
            np.array([one.across for one in unfolded], np.int32),
            merges[0] + 1, merges[1] + 1,
            np.flatnonzero(places[:, 2]).astype(np.int32), places, ends_of(blockmap), own.across, sums, normals,
        )  # fmt: skip
        painted = to_bytes(sums[..., :3] / np.maximum(sums[..., 3:], 1))
        image = fill_invalid(painted, sums[..., 3] > 0)
        return replace(blockmap, colors=np.concatenate([tops, image], axis=1), turns=turns_of(own, normals))


def _blocks(texels: NDArray[_Number], rows: int, columns: int) -> NDArray[_Number]:
    """(h, w, …) -> (rows, columns, texels of a block, …)."""
    deep, wide = texels.shape[0] // rows, texels.shape[1] // columns
    parted = texels.reshape(rows, deep, columns, wide, *texels.shape[2:])
    return np.moveaxis(parted, 1, 2).reshape(rows, columns, deep * wide, *texels.shape[2:])


def _or_zero(height: NDArray[np.float32]) -> NDArray[np.float32]:
    """Blocks without anything count as flat."""
    return np.where(np.isfinite(height).any(axis=2, keepdims=True), height, np.float32(0))


def _drawn(rows: int, columns: int, count: int) -> NDArray[np.int64]:
    """(rows, columns) which texel of each block: as good as by chance, and always the same."""
    j, i = np.mgrid[:rows, :columns].astype(np.uint32)
    with np.errstate(over="ignore"):
        mixed = i * np.uint32(0x9E3779B1) ^ j * np.uint32(0x85EBCA77)
        mixed = (mixed ^ (mixed >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
        mixed = (mixed ^ (mixed >> np.uint32(12))) * np.uint32(0x297A2D39)
    return np.asarray((mixed ^ (mixed >> np.uint32(15))) % np.uint32(count), np.int64)
