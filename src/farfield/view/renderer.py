"""The reference renderer: a picture of a baked world by the rules the viewer follows (OV 4.2, 5; spec/drawing.md)."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.geometry.cameras import Camera
from farfield.geometry.frustum import Frustum
from farfield.octree.cut import Cut, cut, near_radius, view_bin
from farfield.octree.grid import CellKey
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.view.blockmaps import BlockMapPass, MapDraw, map_of
from farfield.view.frame import Frame
from farfield.view.geometry import Batches, GeometryPass
from farfield.view.kinds import Kinds, PlacedInstance, ShownForm
from farfield.view.near import MergedPart, NearGeometry, is_held
from farfield.view.picture import Picture, Statistics
from farfield.view.shading import Light
from farfield.view.splats import Splats
from farfield.view.tiles import Place, TileCache, Wanted, places_of
from farfield.world.index import BlockMapEntry, CellEntry
from farfield.world.keys import orthoview_key
from farfield.world.world import World

DEFAULT_LEAST_GAIN = 10.0
VIEWS_WITHOUT_PICKS = 3
"""Directions drawn of a cell whose index picks no tiles, when no number is asked for."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How a world is drawn."""

    views: int | None = None
    """Directions drawn of each cell; None: the tiles that the index picks, down to `least_gain`."""
    least_gain: float = DEFAULT_LEAST_GAIN
    """Pixels of a view that a kilobyte of a picked tile must add."""
    layers: int = 2
    """Depth layers drawn of each direction, as far as they exist."""
    supersampling: int = 4
    """Samples a pixel along each axis."""
    bias: float = 0.0
    """Cells are taken from r * 2^(level - bias) on: 1 draws twice as coarse."""
    near_radius: float | None = None
    """Metres within which leaves are geometry; None: r, as the cut defines it."""
    far_geometry: bool = True
    """See `held`; False: what is farther away is drawn from pictures alone."""
    far_only: bool = False
    """Leave the near geometry out."""
    nearest_by_angle: bool = False
    """Ignore the table of views of each cell."""
    splats: Splats = Splats.COVERED
    """What pixels of orthoviews become; all but the default are for comparison."""
    light: Light = field(default_factory=Light)
    normals: bool = False
    """Keep the normals."""
    ids: bool = False
    """Keep the object ids."""
    held: Collection[str] | None = None
    """Keys of the values that may be drawn, as by a viewer that has no others; None: all. Cells of which tiles lack are
    drawn from the others, and from those above as far as tiles lack; cells of which geometry is held that
    shows more are geometry, however far away."""


def render_world(
    world: World,
    camera: Camera,
    size: tuple[int, int],
    options: RenderOptions | None = None,
    cache: TileCache | None = None,
) -> Picture:
    """Draws a world.

    size: width and height, pixels. cache: decoded tiles to take and leave; None: none are kept for later. Tiles that
    cannot be read are stood in for by their cell's parent; the picture's statistics count them as warnings.
    """
    begun = time.perf_counter()
    options = options or RenderOptions()
    drawing = _Drawing(world, camera, size, options, cache or TileCache(world))
    shown = drawing.tree.cut(camera, size, options)
    afar = drawing.draw_pictures(shown.pictures)
    if not options.far_only:
        drawing.draw_geometry(shown.geometry, afar)
    drawing.draw_maps()
    statistics = replace(drawing.statistics(), seconds=time.perf_counter() - begun)
    return replace(drawing.frame.develop(options.light), statistics=statistics)


def picture_radius(world: World, camera: Camera, size: tuple[int, int]) -> float:
    """r of OV 4.2 for that picture, metres."""
    across = 2 * math.atan(size[0] / 2 / camera.focal(size))
    return near_radius(world.grid, size[0], across)


class SoundTree:
    """A world's tree that shows a cell itself where the index below it cannot be read."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.broken: list[CellKey] = []
        """Cells whose children are unknown."""

    @property
    def roots(self) -> Iterable[CellKey]:
        """See Tree."""
        return self.world.roots

    def children(self, key: CellKey) -> Iterable[CellKey]:
        """See Tree."""
        try:
            below = self.world.children(key)
            for child in below:
                self.world.entry(child)
        except (CorruptTileError, KeyError):
            self.broken.append(key)
            return ()
        return below

    def cut(self, camera: Camera, size: tuple[int, int], options: RenderOptions) -> Cut:
        """The cells that a picture shows, inside the frustum or not."""
        radius = picture_radius(self.world, camera, size)
        near = radius * self.world.manifest.near_share if options.near_radius is None else options.near_radius
        shown = cut(self, self.world.grid, np.array(camera.eye), radius / 2**options.bias, near)
        shown.pictures.extend(self.broken)
        return shown


class _Drawing:
    """One picture in the making."""

    def __init__(
        self, world: World, camera: Camera, size: tuple[int, int], options: RenderOptions, cache: TileCache
    ) -> None:
        self.tree = SoundTree(world)
        self.frame = Frame.empty(camera, size, options.supersampling, options.normals, options.ids)
        self.unreadable = 0
        self._world, self._options, self._cache = world, options, cache
        self._eye = np.array(camera.eye, dtype=np.float64)
        self._frustum = Frustum.of(camera, size)
        free = options.far_geometry and not options.far_only and options.near_radius != 0
        self._kinds: Kinds | None = None
        if free and options.held is not None:
            self._kinds = Kinds(world, self._eye, camera.focal(size), options.least_gain)
        self._instances: list[PlacedInstance] = []
        """Of cells that are not there whole."""
        self._merged: list[MergedPart] = []
        """What cells above stand in by."""
        self._maps: list[MapDraw] = []
        """What has no pictures but a BlockMap, and what stands in by one."""
        self._cells = self._orthoviews = self._splats = self._triangles = self._bytes = 0

    def statistics(self) -> Statistics:
        """What was drawn so far; seconds are not known here."""
        return Statistics(
            0.0, self._cells, self._orthoviews, self._splats, self._triangles, self._bytes, self.unreadable
        )

    def draw_pictures(self, keys: Iterable[CellKey], are_placed: bool = False) -> list[ShownForm]:
        """Draws cells from their orthoviews, the nearest first; returns what is geometry in their place.

        are_placed: whether the instances in them are drawn already.
        """
        wanted, there, lacking, geometry = [], [], [], []
        for entry in self._seen(keys):
            if shown_by := self._geometry_of(entry):
                geometry += shown_by
                continue
            if not entry.tiles:
                if not self._draw_map(entry):
                    self._stand_in(entry.cell)
                continue
            cell = self._wanted(entry)
            held = self._held(cell)
            if len(held.places) < len(cell.places):
                lacking.append((entry, held))
                if not are_placed:
                    self._place(entry, is_near=False, pictured=True)
            else:
                there.append(entry)
            if held.places or not cell.places:
                wanted.append(held)
        self._place_beside_merged(there, geometry)
        boxes = np.array([one.box for one in self._instances]).reshape(-1, 6)
        for entry, held in lacking:
            lower, upper = entry.bounds
            is_filling = bool(((boxes[:, :3] <= upper) & (boxes[:, 3:] >= lower)).all(axis=1).any())
            self._stand_in(entry.cell, bool(held.places), is_filling)
        for cell, layers in self._cache.cells(wanted, self._options.ids):
            if isinstance(layers, CorruptTileError):
                self.unreadable += 1
                self._stand_in(cell.key)
            else:
                self._splat(cell, layers, None)
        return geometry

    def _draw_map(self, entry: CellEntry, box: NDArray[np.float64] | None = None) -> bool:
        """Whether a cell without pictures has a BlockMap that may be drawn. box: to which it is cut."""
        if entry.blockmap is None:
            return False
        wanted = map_of(entry, entry.blockmap, box)
        if self._options.held is not None and wanted.key not in self._options.held:
            return False
        self._maps.append(wanted)
        return True

    def draw_maps(self) -> None:
        """Casts the BlockMaps that all that was drawn before is to be seen with."""
        casting = BlockMapPass(self._world, self.frame, self._options.light)
        drawn, unreadable = casting.draw(self._maps)
        self._cells += drawn
        self.unreadable += unreadable
        self._bytes += casting.bytes

    def _geometry_of(self, entry: CellEntry) -> list[ShownForm]:
        if self._kinds is None or self._options.held is None:
            return []
        return self._kinds.geometry_of(entry.cell, self._options.held)

    def _place(
        self,
        entry: CellEntry,
        is_near: bool,
        leaves: Collection[CellKey] = (),
        pictured: bool = False,
        into: NDArray[np.float64] | None = None,
    ) -> None:
        if self._kinds is not None and self._options.held is not None:
            held = self._options.held
            self._instances += self._kinds.instances_of(entry.cell, held, is_near, leaves, pictured, into)

    def _place_beside_merged(self, there: Iterable[CellEntry], geometry: Iterable[ShownForm]) -> None:
        """Places what stands in cells that are there and reaches into merged geometry, which does not show it."""
        above = [shown.entry.cell for shown in geometry if lacks_instances(shown)]
        merged = [self._world.grid.bounds(cell).ravel() for cell in above]
        if merged:
            for entry in there:
                self._place(entry, is_near=False, into=np.array(merged))

    def draw_geometry(self, leaves: Iterable[CellKey], afar: Iterable[ShownForm]) -> None:
        """Draws leaves as triangles, in front of or behind what is there; from pictures when they have no geometry.

        afar: others that have, and cells above.
        """
        entries = self._seen(leaves)
        afar = list(afar)
        without = [entry for entry in entries if not self._has_geometry(entry)]
        shown = (*entries, *(one.entry for one in afar))
        drawn = {e.cell for e in shown if e.cell.level == 0 and self._has_geometry(e)}
        for entry in without:
            self._place(entry, is_near=True, pictured=True)
        for one in afar:
            if lacks_instances(one):
                self._place(one.entry, is_near=False)
        for cell in drawn:
            # What reaches out of the leaves that are drawn would be cut off there.
            self._place(self._world.entry(cell), is_near=True, leaves=drawn)
        self.draw_pictures((entry.cell for entry in without), are_placed=True)
        seen = {entry.key for entry in self._seen(one.entry.cell for one in afar)}
        near = [ShownForm(entry) for entry in entries if self._has_geometry(entry)]
        near += [one for one in afar if one.entry.key in seen]
        reader = NearGeometry(self._world, self._eye)
        drawing = GeometryPass(self.frame, self._options.light)
        batches = Batches(drawing)
        self.unreadable += reader.draw_instances(self._instances, batches)
        self.unreadable += reader.draw(near, batches, self._options.held)
        self.unreadable += reader.draw_merged(self._merged, batches, self._options.held)
        self._triangles += drawing.triangles
        self._bytes += reader.bytes
        self._maps += reader.maps

    def _seen(self, keys: Iterable[CellKey]) -> list[CellEntry]:
        entries = []
        for key in keys:
            try:
                entry = self._world.entry(key)
            except (CorruptTileError, KeyError):
                self.unreadable += 1
                continue
            # A splat on the border of the content reaches a few pixels beyond it.
            if self._frustum.touches(np.array(entry.bounds), margin=4 * entry.error):
                entries.append(entry)
        entries.sort(key=lambda e: self._away(np.array(e.bounds)))
        return entries

    def _away(self, bounds: NDArray[np.float64]) -> float:
        gap = np.maximum(np.maximum(bounds[0] - self._eye, self._eye - bounds[1]), 0.0)
        return float((gap * gap).sum())

    def _wanted(self, entry: CellEntry) -> Wanted:
        return Wanted(entry.cell, chosen_tiles(self._world, entry, self._eye, self._options))

    def _held(self, cell: Wanted) -> Wanted:
        """Those of its tiles that may be drawn."""
        held = self._options.held
        if held is None:
            return cell
        name = self._world.entry(cell.key).hash
        return Wanted(cell.key, tuple(place for place in cell.places if orthoview_key(cell.key, *place, name) in held))

    def _has_geometry(self, entry: CellEntry) -> bool:
        near, held = entry.geometry, self._options.held
        return near is not None and any(is_held(entry.cell, form, held) for form in near.forms)

    def _stand_in(self, key: CellKey, behind: bool = False, is_filling: bool = False) -> None:
        """Draws the nearest ancestor that can be read, clipped to the cell's box; while tiles lack, those above it too.

        As merged geometry, later, where that shows more than what there is of its pictures.
        behind: as much farther away as its pixels are apart, so that it does not hide what is there of the cell.
        is_filling: beside instances, which pictures show as well: behind them, and without wide discs.
        """
        cell, box, world = key, self._world.grid.bounds(key), self._world
        away = box.mean(axis=0) - self._eye
        away /= max(float(np.linalg.norm(away)), 1e-9)
        while key.level < world.grid.top_level:
            key = world.grid.parent(key)
            moved = away * world.grid.pitch(key.level)
            held_keys = self._options.held
            form = self._kinds.stands_in(key, held_keys) if self._kinds is not None and held_keys else None
            if form is not None:
                self._merged.append(MergedPart(world.entry(key), form, cell, moved if behind else 0 * moved))
                return
            if not world.entry(key).tiles:
                if self._draw_map(world.entry(key), box):
                    return
                continue
            try:
                whole = self._wanted(world.entry(key))
                held = self._held(whole)
                layers = self._cache.layers(held, self._options.ids)
            except (CorruptTileError, KeyError):
                continue
            if layers:
                self._splat(held, layers, box, moved if behind or is_filling else None, is_filling)
                if len(held.places) == len(whole.places):
                    return
                behind = True

    def _splat(
        self,
        cell: Wanted,
        layers: list[OrthoLayer],
        box: NDArray[np.float64] | None,
        moved: NDArray[np.float64] | None = None,
        is_filling: bool = False,
    ) -> None:
        numbers = self._world.manifest.direction_by_number
        sizes = {(d, layer): size for d, layer, size in self._world.entry(cell.key).tiles}
        for place, layer in zip(cell.places, layers, strict=True):
            direction, grid = numbers[place[0]], self._world.grid
            self._splats += self.frame.splat(
                layer,
                direction,
                grid,
                cell.key.level,
                self._options.light,
                box,
                self._options.splats,
                moved,
                is_filling,
            )
            self._bytes += sizes[place]
        self._cells += 1
        self._orthoviews += len({d for d, _ in cell.places})


def lacks_instances(shown: ShownForm) -> bool:
    """Whether what is listed of a cell below is not shown: by merged geometry of a cell above."""
    return shown.entry.cell.level > 0 and (shown.form is None or not isinstance(shown.form, BlockMapEntry))


def chosen_tiles(world: World, entry: CellEntry, eye: NDArray[np.float64], options: RenderOptions) -> tuple[Place, ...]:
    """The tiles to draw a cell from, best first (spec/drawing.md, Which tiles)."""
    if entry.has_picks and options.views is None and not options.nearest_by_angle:
        return _picked(entry, view_bin(np.array(entry.bounds).mean(0), eye), options)
    return places_of(entry, _directions(world, entry, eye, options), options.layers)


def _picked(entry: CellEntry, from_bin: int, options: RenderOptions) -> tuple[Place, ...]:
    """The best of those that are drawn at all, and the others that add enough for their bytes."""
    places: list[Place] = []
    for place, gain in entry.picks_from(from_bin):
        direction, layer, _ = entry.tiles[place]
        if layer < options.layers and (gain >= options.least_gain or not places):
            places.append((direction, layer))
    return tuple(places)


def _directions(world: World, entry: CellEntry, eye: NDArray[np.float64], options: RenderOptions) -> list[int]:
    """Numbers of the directions to draw a cell from, best first: from its table, or else the nearest by angle."""
    views = VIEWS_WITHOUT_PICKS if options.views is None else options.views
    middle = np.array(entry.bounds).mean(0)
    listed = [] if options.nearest_by_angle else entry.directions_from(view_bin(middle, eye))
    if listed:
        return listed[:views]
    towards = eye - middle
    there = {d for d, _, _ in entry.tiles}
    directions = [d for d in world.manifest.direction_by_number.values() if d.number in there]
    directions.sort(key=lambda d: (-float((towards * np.array(d.vector)).sum()), d.number))
    return [d.number for d in directions[:views]]
