"""BlockMaps drawn into a frame by casting rays (BLK 3.2; spec/drawing.md, BlockMaps)."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.kernels.leaps import LEAPS, leaps
from farfield.kernels.raycast import cast_rays
from farfield.octree.grid import CellKey
from farfield.represent.blockmap.blockmap import CODES, STEEP, BlockMap
from farfield.represent.blockmap.coding import decode_blockmap, with_objects
from farfield.view.frame import Frame
from farfield.view.shading import Light
from farfield.world.index import BlockMapEntry, CellEntry
from farfield.world.keys import blockmap_key, blockmap_objects_key
from farfield.world.world import World

_NEAR = 1e-3
MARGIN = 64
"""Parts of a texel's width that the box reaches beyond the lowest and the highest point."""


@dataclass(frozen=True, slots=True)
class MapDraw:
    """A BlockMap of a world that is to be drawn."""

    cell: CellKey
    key: str
    box: NDArray[np.float64] | None = None
    """(2, 3) local metres to which it is cut; None: all of it."""
    moved: NDArray[np.float64] | None = None
    """(3,) metres by which it is drawn elsewhere."""


def map_of(
    entry: CellEntry,
    blockmap: BlockMapEntry,
    box: NDArray[np.float64] | None = None,
    moved: NDArray[np.float64] | None = None,
) -> MapDraw:
    """That of a cell, see MapDraw."""
    return MapDraw(entry.cell, blockmap_key(entry.cell, blockmap.hash), box, moved)


@dataclass(frozen=True, slots=True)
class CastableMap:
    """A BlockMap as the kernel takes it, with the distances that rays leap by."""

    blockmap: BlockMap
    extent: NDArray[np.float64]
    """(3,) metres of the cell."""
    heights: NDArray[np.float32]
    floors: NDArray[np.float32]
    """(n, n) metres from the cell's lower corner down to which what stands in a texel goes."""
    slopes: NDArray[np.float32]
    distances: NDArray[np.uint8]
    thresholds: NDArray[np.float32]
    azimuths: NDArray[np.float32]
    span: tuple[float, float]
    """Metres from the cell's lower corner up to where its box begins and ends."""

    @classmethod
    def of(cls, blockmap: BlockMap, extent: NDArray[np.float64]) -> CastableMap:
        """extent: (3,) metres of the cell."""
        n = blockmap.size.side
        texel = np.asarray(extent[:2], np.float64) / n
        heights = blockmap.heights
        rise = np.zeros((n, n, 2), np.float32)
        if blockmap.slopes is not None:
            rise = (blockmap.slopes / STEEP).astype(np.float32)
        across = (rise * texel).astype(np.float32)
        tops = np.where(np.isnan(heights), -np.inf, heights + np.abs(across).sum(axis=-1) / 2).astype(np.float32)
        thresholds = leap_heights(tops)
        distances = np.zeros((LEAPS, n, n), np.uint8)
        for k, threshold in enumerate(thresholds):
            leaps(tops, threshold, distances[k])
        slopes = np.ascontiguousarray(np.concatenate([across, rise], axis=-1))
        extent, span = np.asarray(extent, np.float64), _span(blockmap.low, float(tops.max()), float(texel[0]))
        return cls(blockmap, extent, heights, _floors(blockmap), slopes, distances, thresholds, blockmap.azimuths, span)


class BlockMapPass:
    """Draws BlockMaps of a world into a frame, after all else; each is read once, and kept until it was drawn last."""

    def __init__(self, world: World, frame: Frame, light: Light) -> None:
        self._world, self._frame, self._light = world, frame, light
        self._maps: dict[str, CastableMap] = {}
        """Half a megabyte each."""
        self.bytes = 0
        """Encoded size of everything read so far."""

    def draw(self, draws: Sequence[MapDraw]) -> tuple[int, int]:
        """Returns how many were drawn, and how many cannot be read."""
        drawn = unreadable = 0
        last = {one.key: number for number, one in enumerate(draws)}
        for number, one in enumerate(draws):
            try:
                castable = self._castable(one)
            except CorruptTileError:
                unreadable += 1
                continue
            corner = self._world.grid.bounds(one.cell)[0]
            moved = np.zeros(3) if one.moved is None else one.moved
            box = None if one.box is None else one.box + moved
            draw_blockmap(self._frame, castable, corner + moved, self._light, box)
            drawn += 1
            if last[one.key] == number:
                del self._maps[one.key]
        return drawn, unreadable

    def _castable(self, one: MapDraw) -> CastableMap:
        if one.key not in self._maps:
            blockmap = decode_blockmap(self._read(one.key), one.key)
            if self._frame.objects.size:
                ids = blockmap_objects_key(one.cell, one.key[-16:])
                with contextlib.suppress(MissingKeyError):
                    blockmap = with_objects(blockmap, self._world.store.get(ids), ids)
            self._maps[one.key] = CastableMap.of(blockmap, self._world.grid.cell_size(one.cell.level))
        return self._maps[one.key]

    def _read(self, key: str) -> bytes:
        try:
            data = self._world.store.get(key)
        except MissingKeyError:
            raise CorruptTileError("BlockMap is missing", key, "run farfield verify") from None
        self.bytes += len(data)
        return data


def _floors(blockmap: BlockMap) -> NDArray[np.float32]:
    """(n, n) metres; what goes down to the lowest code goes down for ever: no ray slips through below it."""
    if blockmap.floors is None:
        return np.full(blockmap.codes.shape, -np.inf, np.float32)
    return np.where(blockmap.floors > 1, blockmap.undersides, np.float32(-np.inf)).astype(np.float32)


def _span(low: float, highest: float, texel: float) -> tuple[float, float]:
    """Metres between which rays are cast: rays that come in from above are above the tops, even where all is flat."""
    return low - texel / MARGIN, highest + texel / MARGIN


def leap_heights(tops: NDArray[np.float32]) -> NDArray[np.float32]:
    """(LEAPS,) heights that distances are told for: of the ground, of most buildings, of nearly all."""
    known = tops[np.isfinite(tops)]
    low = float(known.min())
    ground = low + 0.05 * (float(known.max()) - low)
    most, nearly = np.quantile(known, [0.75, 0.97])
    return np.array([ground, max(most, ground), max(nearly, ground)], np.float32)


def draw_blockmap(
    frame: Frame,
    castable: CastableMap,
    corner: NDArray[np.float64],
    light: Light,
    box: NDArray[np.float64] | None = None,
) -> int:
    """Draws a BlockMap, before or behind what is there; returns the samples that it is seen in.

    corner: (3,) lower one of its cell, local metres. box: (2, 3) local metres to which it is cut; None: its cell.
    """
    blockmap, camera = castable.blockmap, frame.camera
    eye = np.array(camera.eye, np.float64)
    n = blockmap.size.side
    texel = np.array([*(castable.extent[:2] / n), 1.0])
    lower, upper = np.zeros(3), np.array([*castable.extent[:2], 0.0])
    lower[2], upper[2] = castable.span
    if box is not None:
        lower, upper = np.maximum(lower, box[0] - corner), np.minimum(upper, box[1] - corner)
    if (lower >= upper).any():
        return 0
    rows = camera.matrix(frame.sample_size)[:, :3]
    part = _samples_of(rows, lower + corner - eye, upper + corner - eye, frame.sample_size)
    if part is None:
        return 0
    (x0, x1), (y0, y1) = part
    to_ray = np.linalg.inv(rows) / texel[:, None]
    cut = slice(y0, y1), slice(x0, x1)
    depth, surface = np.ascontiguousarray(frame.depth[cut]), np.ascontiguousarray(frame.surface[cut])
    normal = np.ascontiguousarray(frame.normal[cut]) if frame.normal.size else frame.normal
    objects = np.ascontiguousarray(frame.objects[cut]) if frame.objects.size else frame.objects
    ids = blockmap.objects if blockmap.objects is not None else np.zeros((0, 0), np.uint32)
    own = blockmap.unfolded
    drawn = int(
        cast_rays(
            castable.heights, castable.floors, castable.slopes, castable.distances, castable.thresholds,
            own.places, castable.azimuths, blockmap.colors, ids,
            np.stack([lower, upper]) / texel, to_ray, (eye - corner) / texel,
            light.sun.astype(np.float32), x0, y0, own.across, blockmap.by_area,
            blockmap.low, blockmap.low + (CODES - 1) * blockmap.step, depth, surface, normal, objects,
        )
    )  # fmt: skip
    if drawn:
        frame.depth[cut], frame.surface[cut] = depth, surface
        if frame.normal.size:
            frame.normal[cut] = normal
        if frame.objects.size:
            frame.objects[cut] = objects
    return drawn


def _samples_of(
    rows: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64], size: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """First and end of the columns and rows that a box, relative to the eye, is seen in; None: nowhere."""
    corners = np.array([[(upper if n >> axis & 1 else lower)[axis] for axis in range(3)] for n in range(8)])
    projected = corners @ rows.T
    if (projected[:, 2] < _NEAR).all():
        return None
    if (projected[:, 2] < _NEAR).any():
        return (0, size[0]), (0, size[1])
    at = projected[:, :2] / projected[:, 2:]
    first, last = np.floor(at.min(axis=0)).astype(int), np.ceil(at.max(axis=0)).astype(int)
    x0, y0 = np.maximum(first, 0).tolist()
    x1, y1 = np.minimum(last, size).tolist()
    return ((x0, x1), (y0, y1)) if x0 < x1 and y0 < y1 else None
