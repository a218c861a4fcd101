"""How much a cell's pictures look like what they were made from: both drawn small from two sides, and compared.

Every cell is told an error of its own, so that those who choose between kinds know which is better where (BEN 4.1 has
functions of size and angle alone). Leaves are compared with their geometry. Of cells above is told what is lost by
their pictures in the place of each child's: in a street nearly everything, on plain ground nothing. Geometry of cells
above is compared with that of their children.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera
from farfield.geometry.directions import Direction
from farfield.octree.cut import view_bin
from farfield.octree.grid import CellKey, Grid
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.likeness import SIDES, unlikeness
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.scene.model import Material
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.geometry import GeometryPass
from farfield.view.picture import Picture
from farfield.view.shading import Light
from farfield.world.index import ERROR_SPACING, FARTHEST, Bounds, CellEntry

FOV = 2.5
"""Degrees: all of a cell is about as far away."""
SMALLEST, LARGEST = 32, 256
"""Pixels a side of the first view, which holds the whole cell where its pictures have twice as many."""
SAMPLES = 2
LEAST_GAIN = 10.0
"""Of the tiles that are drawn: those that a viewer draws unless it is told otherwise."""
FARTHER = 0.8
"""Times the error of the first view, from twice as far."""
LOST_FAR = 0.3
"""Of what is lost by the pictures of a cell in the place of its children's, seen from where theirs are as wide as a
pixel: from where its own are half as wide."""
NEARER = 0.6
"""Of what the error grows by from the first view to the second: how much more to the third, from so near that hardly
anything of a cell is in a picture."""
_LIGHT = Light()
_CORNERS = np.array([[n >> axis & 1 for axis in range(3)] for n in range(8)])
"""(8, 3) which corner of a box has its upper end along which axis."""
_WALLS = np.array([
    [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
    [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
])  # fmt: skip
"""(12, 3) triangles of its walls, seen from outside."""

PlacedMap = tuple[CastableMap, NDArray[np.float64]]
"""A BlockMap, and the lower corner of its cell, local metres."""

Layers = Mapping[tuple[int, int], tuple[Direction, OrthoLayer]]
"""(direction, layer) -> the same."""


@dataclass(frozen=True, slots=True)
class Sight:
    """A cell from one side. Pixels are `share` times as wide as those of its pictures."""

    grid: Grid
    key: CellKey
    side: int
    middle: NDArray[np.float64]
    """(3,) local metres, of what is looked at."""
    size: int
    """Pixels a side."""
    share: float = FARTHEST

    @property
    def eye(self) -> NDArray[np.float64]:
        """(3,) local metres."""
        azimuth, elevation = np.radians(SIDES[self.side])
        flat = math.cos(elevation)
        towards = np.array([math.sin(azimuth) * flat, math.cos(azimuth) * flat, math.sin(elevation)])
        focal = self.size / 2 / math.tan(math.radians(FOV) / 2)
        return np.asarray(self.middle + towards * (self.share * self.grid.pitch(self.key.level) * focal))

    @property
    def camera(self) -> Camera:
        """Looks at the middle."""
        eye, middle = self.eye.tolist(), self.middle.tolist()
        return Camera((eye[0], eye[1], eye[2]), (middle[0], middle[1], middle[2]), FOV)

    def empty(self) -> Frame:
        """A frame."""
        return Frame.empty(self.camera, (self.size, self.size), SAMPLES)

    def places(self, entry: CellEntry) -> tuple[tuple[int, int], ...]:
        """(direction, layer) of the tiles by which a cell, this or one below it, is drawn from that side."""
        places: list[tuple[int, int]] = []
        for place, gain in entry.picks_from(view_bin(self.middle, self.eye)):
            if gain >= LEAST_GAIN or not places:
                direction, layer, _ = entry.tiles[place]
                places.append((direction, layer))
        return tuple(places)

    def nearer(self, frame: Frame) -> Sight | None:
        """ERROR_SPACING times as near to what is in the middle of what a frame shows; None: it shows nothing."""
        rows, columns = np.nonzero(np.isfinite(frame.depth))
        if not len(rows):
            return None
        nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
        row, column = int(rows[nearest]), int(columns[nearest])
        # From x w, y w and w, in samples: the inverse of what projects.
        w = float(frame.depth[row, column])
        matrix = self.camera.matrix(frame.sample_size)[:, :3]
        point = np.linalg.solve(matrix, w * np.array([column + 0.5, row + 0.5, 1.0]))
        return replace(self, middle=self.eye + point, share=self.share / ERROR_SPACING)


def sights_of(grid: Grid, key: CellKey, bounds: Bounds) -> tuple[Sight, ...]:
    """From two sides; neighbours are seen from others, the children of a cell from four together."""
    first = (key.x + 2 * key.y + 3 * key.z + key.level) % len(SIDES)
    size = min(max(grid.resolution // 2, SMALLEST), LARGEST)
    middle = np.asarray(np.mean(bounds, axis=0))
    return tuple(Sight(grid, key, (first + n) % len(SIDES), middle, size) for n in (0, 2))


def places_of(sights: Iterable[Sight], entry: CellEntry) -> set[tuple[int, int]]:
    """(direction, layer) of all tiles by which a cell is drawn from there."""
    return {place for sight in sights for place in sight.places(entry)}


def leaf_errors(
    sights: Iterable[Sight], chunk: Chunk, materials: MaterialTable, entry: CellEntry, layers: Layers
) -> tuple[int, ...]:
    """As the index tells them (CellEntry.errors). chunk: what is in the leaf, metres from its lower corner.

    layers: at least those of `places_of`.
    """
    truth = _Truth.of(sights, lambda sight: _drawn(sight, chunk, materials))
    return _told(truth.errors(lambda sight: _splatted(sight, [(entry, layers)])))


@dataclass(frozen=True, slots=True)
class FormErrors:
    """Of forms of a cell's geometry, as the index tells them (GeometryLevel.errors)."""

    truth: _Truth
    before: tuple[float, float]
    """Of what the forms are made from, 0 = like the full geometry, in the first view and in the second."""

    @classmethod
    def against(
        cls, sights: Iterable[Sight], chunk: Chunk, materials: MaterialTable, before: tuple[float, float]
    ) -> FormErrors:
        """chunk: what they are made from, metres from the cell's lower corner."""
        return cls(_Truth.of(sights, lambda sight: _drawn(sight, chunk, materials)), before)

    @classmethod
    def against_maps(
        cls, sights: Iterable[Sight], maps: Iterable[PlacedMap], before: tuple[float, float]
    ) -> FormErrors:
        """maps: the BlockMaps that one is made from."""
        return cls(_Truth.of(sights, lambda sight: _cast(sight, maps)), before)

    def of(self, chunk: Chunk, materials: MaterialTable) -> tuple[int, ...]:
        """Of a form; of what is too small to be seen those of what it is made from."""
        return self._of(lambda sight: _drawn(sight, chunk, materials))

    def of_map(self, blockmap: PlacedMap) -> tuple[int, ...]:
        """The same of a BlockMap."""
        return self._of(lambda sight: _cast(sight, [blockmap]))

    def _of(self, shown: Callable[[Sight], Frame]) -> tuple[int, ...]:
        found = self.truth.errors(shown) or [0.0, 0.0]
        return _told([math.hypot(*both) for both in zip(found, self.before, strict=True)])

    def share_of(self, boxes: Sequence[Sequence[float]]) -> int:
        """What boxes, local metres, take of what there is to be seen in the first view (GeometryEntry.listed)."""
        return _byte(self.truth.share_of(np.array(boxes, np.float64).reshape(-1, 6))) if boxes else 0


@dataclass(frozen=True, slots=True)
class _Truth:
    """A cell's triangles from all sides, from far and from near; without those from where there is nothing."""

    views: tuple[tuple[Sight, Frame, Sight, Frame], ...]

    @classmethod
    def of(cls, sights: Iterable[Sight], draw: Callable[[Sight], Frame]) -> _Truth:
        """draw: what is true."""
        found = []
        for sight in sights:
            far = draw(sight)
            close = sight.nearer(far)
            if close is not None:
                found.append((sight, far, close, draw(close)))
        return cls(tuple(found))

    def errors(self, shown: Callable[[Sight], Frame]) -> list[float]:
        """From far and from near, mean of the sides; none: there is nothing to be seen."""
        found: list[tuple[float, float]] = []
        for sight, true, close, true_close in self.views:
            far = _unlike(true, shown(sight))
            if far is not None:
                near = _unlike(true_close, shown(close))
                found.append((far, far if near is None else near))
        return np.mean(found, axis=0).tolist() if found else []

    def share_of(self, boxes: NDArray[np.float64]) -> float:
        """What boxes, (n, 6) local metres, hide or are seen beside, of all that is seen with them from far."""
        hidden, seen, materials = 0, 0, MaterialTable.build([Material()])
        for sight, true, _, _ in self.views:
            corner = sight.grid.bounds(sight.key)[0]
            depth = _drawn(sight, _chunk_of_boxes(boxes - np.tile(corner, 2)), materials).depth
            hidden += int((depth < true.depth).sum())
            seen += int((np.isfinite(depth) | np.isfinite(true.depth)).sum())
        return hidden / max(seen, 1)


@dataclass(frozen=True, slots=True)
class ParentErrors:
    """Of a cell above leaves, as the index tells them."""

    errors: tuple[int, ...]
    losses: tuple[int, ...]
    """See CellEntry.losses."""


def parent_errors(
    sights: Sequence[Sight], entry: CellEntry, layers: Layers, below: Sequence[tuple[CellEntry, Layers]]
) -> ParentErrors:
    """Of a cell above leaves. below: its children with theirs. Each is seen from one of the sides."""
    losses = [_loss(sights[n % len(sights)], (entry, layers), child) or 0.0 for n, child in enumerate(below)]
    # By what there is to see of each.
    known = [
        (child.errors, loss, sum(size for _, _, size in child.tiles))
        for (child, _), loss in zip(below, losses, strict=True)
        if child.errors and child.tiles
    ]
    if not known:
        return ParentErrors((), tuple(map(_byte, losses)))
    weights = [weight for _, _, weight in known]
    first, second, _ = np.average([errors for errors, _, _ in known], axis=0, weights=weights) / 255
    loss = float(np.average([loss for _, loss, _ in known], weights=weights))
    # Both are wrong in much the same places, where no direction sees, so they do not simply add.
    far, near = math.hypot(FARTHER * first, LOST_FAR * loss), math.hypot((first + second) / 2, loss)
    return ParentErrors(_told([far, near]), tuple(map(_byte, losses)))


def map_loss(sight: Sight, cell: PlacedMap, child: PlacedMap, key: CellKey, bounds: Bounds) -> int:
    """How unlike a child's BlockMap that of the cell looks in its place, as CellEntry.losses has it.

    key, bounds: of the child.
    """
    grid = sight.grid
    far = replace(sight, key=key, middle=np.asarray(np.mean(bounds, axis=0)), share=FARTHEST)
    close = far.nearer(_cast(far, [child]))
    if close is None:
        return 0
    close = replace(close, share=1.0)
    shown = close.empty()
    draw_blockmap(shown, *cell, _LIGHT, grid.bounds(key))
    return _byte(_unlike(_cast(close, [child]), shown) or 0.0)


def _loss(sight: Sight, cell: tuple[CellEntry, Layers], child: tuple[CellEntry, Layers]) -> float | None:
    """How unlike a child's pictures those of the cell look in their place, where a pixel is as wide as one of them."""
    grid, key = sight.grid, child[0].cell
    middle = np.asarray(np.mean(child[0].bounds, axis=0))
    far = replace(sight, key=key, middle=middle, share=FARTHEST)
    close = far.nearer(_splatted(far, [child]))
    if close is None:
        return None
    close = replace(close, share=1.0)
    return _unlike(_splatted(close, [child]), _splatted(close, [cell], grid.bounds(key)))


def _drawn(sight: Sight, chunk: Chunk, materials: MaterialTable) -> Frame:
    """chunk: metres from the lower corner of the cell."""
    frame, shift = sight.empty(), sight.grid.bounds(sight.key)[0] - sight.eye
    moved = replace(chunk, positions=(chunk.positions + shift).astype(np.float32))
    GeometryPass(frame, _LIGHT).draw(moved, materials)
    return frame


def _cast(sight: Sight, maps: Iterable[PlacedMap]) -> Frame:
    frame = sight.empty()
    for castable, corner in maps:
        draw_blockmap(frame, castable, corner, _LIGHT)
    return frame


def _chunk_of_boxes(boxes: NDArray[np.float64]) -> Chunk:
    """The walls of boxes, (n, 6) lower and upper corners."""
    corners = boxes.reshape(-1, 2, 3)[:, _CORNERS, np.arange(3)].reshape(-1, 3).astype(np.float32)
    triangles = (_WALLS + 8 * np.arange(len(boxes))[:, None, None]).reshape(-1, 3).astype(np.uint32)
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), corners.shape).copy()
    none = np.zeros(len(triangles), np.uint32)
    return Chunk(corners, normals, np.empty((0, 2), np.float32), np.empty((0, 4), np.uint8), triangles, none, none)


def _splatted(sight: Sight, cells: Iterable[tuple[CellEntry, Layers]], box: NDArray[np.float64] | None = None) -> Frame:
    """box: (2, 3) local metres to clip to."""
    frame = sight.empty()
    for entry, layers in cells:
        for place in sight.places(entry):
            direction, layer = layers[place]
            frame.splat(layer, direction, sight.grid, entry.cell.level, _LIGHT, box)
    return frame


def _unlike(true: Frame, shown: Frame) -> float | None:
    """0 = like, 1 = as nothing; None: there is nothing to see.

    Where the truth is, and before its own mean colour: round a cell and through its holes its neighbours are seen in
    the whole picture, which are much the same.
    """
    first, second = true.develop(_LIGHT), shown.develop(_LIGHT)
    if not first.alpha.any():
        return None
    alpha = first.alpha.astype(np.float64)
    mean = np.average(first.color.reshape(-1, 3).astype(np.float64), axis=0, weights=alpha.ravel())
    return unlikeness(_before(first, mean), _before(second, mean), alpha)


def _before(picture: Picture, backdrop: NDArray[np.float64]) -> NDArray[np.float64]:
    """(h, w, 3) linear light."""
    alpha = picture.alpha[..., None].astype(np.float64)
    return np.asarray(alpha * picture.color + (1 - alpha) * backdrop)


def _told(found: Sequence[float]) -> tuple[int, ...]:
    """For three views, 255 = as nothing."""
    if not found:
        return ()
    first, second = found[0], max(found)
    third = second + NEARER * (second - first)
    return tuple(map(_byte, (first, second, third)))


def _byte(error: float) -> int:
    return min(round(255 * error), 255)
