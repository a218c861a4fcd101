"""Prisms: walls with whole bays and floors, roofs triangulated with their holes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.details import Details
from farfield.scene.footprints.facades import (
    BAY,
    BAYS,
    FLOOR,
    FLOORS,
    PIER,
    SHORTEST_WINDOW_WALL,
    VARIANTS,
    facade_material,
    given_tints,
    pale_facade_material,
    plain_material,
    roof_colors,
    variant_of,
    wall_tints,
)
from farfield.scene.footprints.rings import Rings, next_in_ring, starts_of
from farfield.scene.footprints.unique import FACADE_SIDE, Layout, Styles
from farfield.scene.model import Material, Mesh
from farfield.scene.options import Facades
from farfield.scene.surfaces.clipping import flat_triangles


@dataclass(frozen=True, slots=True, eq=False)
class Buildings:
    """Footprints with their heights, in the frame of a mesh."""

    rings: Rings
    bottom: NDArray[np.float32]
    """(n,) z where the walls begin."""
    top: NDArray[np.float32]
    """(n,) z of the flat roof."""
    seed: NDArray[np.uint32]
    """(n,) what a building's looks are drawn from."""
    details: Details = field(default_factory=Details)

    @property
    def lifted(self) -> NDArray[np.bool_]:
        """(n,) which can be seen from below."""
        lift = self.details.lift
        return np.zeros(len(self.bottom), bool) if lift is None else lift > 0


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    positions: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    colors: NDArray[np.uint8]
    material: NDArray[np.uint16]
    """(m,) per triangle."""
    building: NDArray[np.int64]
    """(m,) per triangle."""


def prism_mesh(buildings: Buildings, facades: Facades) -> Mesh:
    """Walls and roofs of all buildings, floors of those above the ground; object = row of the building.

    Material 0 is plain, then come the façades, then, where a wall has a colour of its own, the pale façades it tints.
    Unique façades keep their colours.
    """
    roofs = _roofs(buildings)
    if facades == "unique":
        walls, own = _unique_walls(buildings)
    else:
        walls, own = _walls(buildings, facades), _shared(facades, "wall_color" in buildings.details.told())
    parts = [walls, roofs]
    if buildings.lifted.any():
        parts.append(_floors(buildings, roofs))
    owner = np.concatenate([part.building for part in parts])
    order = np.argsort(owner, kind="stable")
    before = starts_of(np.array([len(part.positions) for part in parts]))
    triangles = np.concatenate([part.triangles + first for part, first in zip(parts, before[:-1], strict=True)])
    return Mesh(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=triangles[order].astype(np.uint32),
        normals=np.concatenate([part.normals for part in parts]),
        materials=(plain_material(), *own),
        triangle_material=np.concatenate([part.material for part in parts])[order],
        uvs=np.concatenate([part.uvs for part in parts]),
        colors=np.concatenate([part.colors for part in parts]),
        triangle_object=owner[order].astype(np.uint32),
        object_count=len(buildings.bottom),
    )


def _shared(facades: bool, colored: bool) -> tuple[Material, ...]:
    """The façades that buildings share."""
    variants = range(VARIANTS if facades else 0)
    pale = [pale_facade_material(k) for k in variants] if colored else []
    return (*(facade_material(k) for k in variants), *pale)


def _walls(buildings: Buildings, facades: bool) -> _Surface:
    """One quad an edge, its corners counter-clockwise from outside: bottom left, bottom right, top right, top left."""
    a, b, owner, length = _edges(buildings)
    height = buildings.top - buildings.bottom
    variant = variant_of(buildings.seed, height)
    bare = buildings.lifted & (height < SHORTEST_WINDOW_WALL)
    tints, given = _wall_colors(buildings, variant, facades)
    rise = buildings.top[owner].astype(np.float64) - buildings.bottom[owner].astype(np.float64)
    uvs = _wall_uvs(np.where(bare[owner], 0.0, length), rise, buildings.seed[owner])
    return _quads(buildings, (a, b, owner), uvs, tints[owner], (variant + 1 + VARIANTS * given)[owner] * facades)


def _unique_walls(buildings: Buildings) -> tuple[_Surface, tuple[Material, ...]]:
    """As `_walls`, and a material for each building; walls longer than a façade are cut between bays."""
    a, b, owner, length = _edges(buildings)
    styles = Styles.of(buildings.seed, buildings.top.astype(np.float64) - buildings.bottom)
    layout = Layout.of(length, owner, styles)
    a, b, owner = a[layout.wall], b[layout.wall], owner[layout.wall]
    low, high = layout.share[:, :1], layout.share[:, 1:]
    # A wall that is whole keeps its corners to the bit.
    first = np.where(low > 0, a + (b - a) * low, a)
    last = np.where(high < 1, a + (b - a) * high, b)
    # Half a texel within, so that the roof's edge never shows at the ground where textures repeat.
    inset = np.full(len(owner), 0.5 / FACADE_SIDE)
    left, right = layout.u.T
    uvs = np.stack([left, 1 - inset, right, 1 - inset, right, inset, left, inset], 1)
    white = np.full((len(owner), 4), 255, np.uint8)
    walls = _quads(buildings, (first, last, owner), uvs.reshape(-1, 2).astype(np.float32), white, owner + 1)
    bays = layout.bays.tolist()
    return walls, tuple(styles.material(row, bays[row]) for row in range(len(bays)))


def _edges(
    buildings: Buildings,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Both ends of each wall, its building and its length."""
    rings = buildings.rings
    a = rings.xy.astype(np.float64)
    b = a[next_in_ring(rings.ring_start)]
    owner = _vertex_feature(rings)
    length = np.hypot(*(b - a).T)
    solid = length > 1e-3
    return a[solid], b[solid], owner[solid], length[solid]


def _quads(
    buildings: Buildings,
    walls: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]],
    uvs: NDArray[np.float32],
    colors: NDArray[np.uint8],
    material: NDArray[np.int64],
) -> _Surface:
    """walls: both ends and the building of each. uvs: of four corners each. colors, material: of each wall."""
    a, b, owner = walls
    length = np.hypot(*(b - a).T)
    bottom, top = buildings.bottom[owner].astype(np.float64), buildings.top[owner].astype(np.float64)
    positions = np.empty((len(a), 4, 3))
    positions[:, :, :2] = np.stack([a, b, b, a], 1)
    positions[:, :, 2] = np.stack([bottom, bottom, top, top], 1)
    outward = np.stack([(b - a)[:, 1] / length, -(b - a)[:, 0] / length, np.zeros(len(a))], -1)
    quads = np.arange(len(a))[:, None] * 4 + np.array([0, 1, 2, 0, 2, 3])
    return _Surface(
        positions.reshape(-1, 3),
        quads.reshape(-1, 3),
        np.repeat(outward.astype(np.float32), 4, 0),
        uvs,
        np.repeat(colors, 4, 0),
        np.repeat(material, 2).astype(np.uint16),
        np.repeat(owner, 2),
    )


def _wall_colors(
    buildings: Buildings, variant: NDArray[np.int64], textured: bool
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """(n, 4) uint8 tints, and (n,) whose colour is given."""
    tints, wanted = wall_tints(buildings.seed, variant, textured), buildings.details.wall_color
    if wanted is None:
        return tints, np.zeros(len(tints), bool)
    given = wanted[:, 3] > 0
    tints[given] = given_tints(wanted[given], variant[given], textured)
    return tints, given


def _wall_uvs(
    length: NDArray[np.float64], height: NDArray[np.float64], seed: NDArray[np.uint32]
) -> NDArray[np.float32]:
    """(4 n, 2): whole bays along the wall, whole floors up it, so that no window is cut; v grows downwards.

    Where in the texture a wall begins is drawn from the building's seed; short walls show only a pier.
    """
    bays = np.maximum(np.round(length / BAY), 1)
    bays = np.where(length < SHORTEST_WINDOW_WALL, PIER, bays)
    floors = np.maximum(np.round(height / FLOOR), 1)
    left = (seed >> np.uint32(8)) % np.uint32(BAYS)
    base = (seed >> np.uint32(16)) % np.uint32(FLOORS)
    u = np.stack([left, left + bays, left + bays, left], 1) / BAYS
    v = -np.stack([base, base, base + floors, base + floors], 1) / FLOORS
    return np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)


def _roofs(buildings: Buildings) -> _Surface:
    rings = buildings.rings
    owner = _vertex_feature(rings)
    triangles = roof_triangles(rings)
    count = len(rings.xy)
    top = buildings.top[owner].astype(np.float64)
    colors, wanted = roof_colors(buildings.seed), buildings.details.roof_color
    if wanted is not None:
        colors = np.where(wanted[:, 3:] > 0, wanted, colors)
        colors[:, 3] = 255
    return _Surface(
        np.concatenate([rings.xy.astype(np.float64), top[:, None]], 1),
        triangles,
        np.tile(np.array([0, 0, 1], np.float32), (count, 1)),
        np.zeros((count, 2), np.float32),
        colors[owner],
        np.zeros(len(triangles), np.uint16),
        owner[triangles[:, 0]],
    )


def _floors(buildings: Buildings, roofs: _Surface) -> _Surface:
    """The roofs of the buildings above the ground, moved down and turned over, in the colour of the walls."""
    owner = _vertex_feature(buildings.rings)
    seen = buildings.lifted[owner]
    turned = roofs.triangles[buildings.lifted[roofs.building]][:, [0, 2, 1]]
    positions = roofs.positions[seen]
    positions[:, 2] = buildings.bottom[owner[seen]]
    variant = variant_of(buildings.seed, buildings.top - buildings.bottom)
    return _Surface(
        positions,
        (np.cumsum(seen) - 1)[turned],
        -roofs.normals[seen],
        roofs.uvs[seen],
        _wall_colors(buildings, variant, False)[0][owner[seen]],
        np.zeros(len(turned), np.uint16),
        owner[turned[:, 0]],
    )


def roof_triangles(rings: Rings) -> NDArray[np.int64]:
    """(m, 3) into the vertices, counter-clockwise from above: fans of convex polygons, ear clipping of the others.

    Two thirds of Tokyo's footprints are convex.
    """
    turn = _turns(rings)
    least = np.minimum.reduceat(turn, rings.ring_start[:-1])[rings.polygon_start[:-1]]
    convex = (least >= 0) & (np.diff(rings.polygon_start) == 1)
    xy = rings.xy.astype(np.float64)
    return flat_triangles(xy, rings.ring_start, rings.polygon_start, convex, ~convex)


def _turns(rings: Rings) -> NDArray[np.float64]:
    """(v,): cross product of the edges before and after each vertex (given at the vertex before it)."""
    following = next_in_ring(rings.ring_start)
    xy = rings.xy.astype(np.float64)
    edge = xy[following] - xy
    after = edge[following]
    return edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]


def _vertex_feature(rings: Rings) -> NDArray[np.int64]:
    """(v,) feature of each vertex."""
    starts = rings.ring_start[rings.polygon_start]
    return np.repeat(rings.polygon_feature, np.diff(starts))
