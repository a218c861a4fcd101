"""What lies below a cell as one mesh: merged, simplified, and with colours of its own, in an atlas or at its vertices.

    surface = ColoredSurface.of(chunk, materials)      # all that lies below, merged
    shape = plain_shape(chunk, materials.arrays)
    form = colored(reduced(shape, 2048), surface, texel=0.5, most_texels=65536)

A hierarchical level of detail (Erikson et al. 2001, HLODs for faster display of large static and dynamic environments),
with textures made from the source (Cignoni et al. 1999, Preserving attribute values on simplified meshes).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR
from farfield.kernels.carry import NO_TRIANGLE, carry, cover
from farfield.kernels.fill import fill_invalid
from farfield.kernels.surface import Materials
from farfield.represent.chunk import Chunk, merge, ordered
from farfield.represent.geometry.atlas import Atlas, Charts, charts_of, fits, packed
from farfield.represent.geometry.triangle_grid import TriangleGrid
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Texture

SMALL = 16.0
"""Texels: a smaller chart has colours at its vertices instead, which take less than its frame of texels would."""
PLAIN = 6
"""Steps of sRGB by which the colours of a chart may differ that has them at its vertices for being plain."""
ASTRAY = 8.0
"""Texels by which a triangle that faces the same way may be farther away than one that does not."""
SAMPLES = 2
"""Of a texel along its side."""
_GRID_CELLS = 256
_BATCH = 1 << 18
"""Samples at once: 40 MB."""
_UNLIT, _DOUBLE_SIDED = 1, 2
"""Bits of a group's number."""
_INNER = (np.eye(3) * 3 + 1) / 6
"""Weights of the corners at three points of a triangle, one for each corner."""


@dataclass(frozen=True, slots=True)
class MergedForm:
    """A mesh and what it is drawn with."""

    chunk: Chunk
    materials: tuple[Material, ...]
    texture: Texture | None
    """The one that materials have, None: none has."""


@dataclass(frozen=True, slots=True)
class ColoredSurface:
    """A surface to take colours from. 150 bytes a triangle beside its own."""

    chunk: Chunk
    materials: MaterialTable
    grid: TriangleGrid
    facing: NDArray[np.float64]
    """(m, 3) unit normals of the triangles."""
    groups: NDArray[np.uint8]
    """(m,) see `group_of`."""
    density: NDArray[np.float64]
    """(m,) texels a metre; 0: without a texture."""
    is_plain: NDArray[np.bool_]
    """(m,) whether all of it has one colour."""

    @classmethod
    def of(cls, chunk: Chunk, materials: MaterialTable) -> ColoredSurface:
        """Of the triangles that have an area."""
        corners = chunk.positions[chunk.triangles].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        kept = areas > 0
        chunk = replace(
            chunk, triangles=chunk.triangles[kept], materials=chunk.materials[kept], objects=chunk.objects[kept]
        )
        areas = areas[kept]
        grid = TriangleGrid.of(chunk.positions.astype(np.float64), chunk.triangles, _GRID_CELLS)
        arrays = materials.arrays
        density, plain = _density(chunk, arrays, areas), arrays.texture[chunk.materials] < 0
        if len(chunk.colors):
            first, second, third = (chunk.colors[chunk.triangles[:, k], :3] for k in range(3))
            plain = plain & (first == second).all(axis=1) & (first == third).all(axis=1)
        groups = group_of(materials)[chunk.materials]
        return cls(chunk, materials, grid, normals[kept] / areas[:, None], groups, density, plain)

    def colors_at(
        self,
        points: NDArray[np.float64],
        facing: NDArray[np.float64],
        groups: NDArray[np.uint8],
        footprint: NDArray[np.float64],
        astray: float,
    ) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        """(k, 3) linear light where the surface is nearest to some points, and (k,) its triangles there.

        facing, groups, footprint: see kernels.carry. astray: metres, see ASTRAY.
        """
        colors, found = np.empty((len(points), 3), np.float32), np.empty(len(points), np.uint32)
        grid = self.grid
        carry(
            self.chunk.surface, self.materials.arrays, grid.points, self.facing, self.groups, self.density, grid.low,
            grid.size, grid.shape, grid.start, grid.inside, points, facing, groups, footprint, astray**2, colors, found,
        )  # fmt: skip
        return colors, found


def group_of(materials: MaterialTable) -> NDArray[np.uint8]:
    """(k,) uint8 group of each material: what of it stays when colours are taken from elsewhere."""
    unlit, double_sided = materials.arrays.unlit > 0, materials.double_sided > 0
    return (_UNLIT * unlit + _DOUBLE_SIDED * double_sided).astype(np.uint8)


def plain_shape(chunk: Chunk, materials: MaterialTable) -> Chunk:
    """A chunk without its looks: nothing but places and normals, one object, groups for materials."""
    return replace(
        chunk,
        uvs=np.empty((0, 2), np.float32),
        colors=np.empty((0, 4), np.uint8),
        materials=group_of(materials)[chunk.materials].astype(np.uint32),
        objects=np.zeros(len(chunk.triangles), np.uint32),
    )


def colored(shape: Chunk, surface: ColoredSurface, texel: float, most_texels: int) -> MergedForm:
    """A shape with the colours of a surface.

    shape: as of `plain_shape`, in the frame of the surface. texel: metres along the side of a texel of its atlas; twice
    as many, or more, where the atlas would have more texels than it may.
    """
    charts = charts_of(shape)
    inner = _InnerColors.of(shape, surface, texel)
    is_plain = inner.plain_charts(charts, surface)
    while True:
        large = np.flatnonzero((charts.areas >= SMALL * texel**2) & ~is_plain)
        if fits(charts, large, texel, most_texels):
            break
        texel *= 2
    has_texels = np.isin(charts.chart, large)
    parts, texture = [], None
    groups = shape.materials
    if len(large):
        atlas = packed(charts, large, texel)
        texture = Texture(_painted(shape, atlas, surface, texel))
        parts.append(_with_uvs(shape, charts, atlas))
    if not has_texels.all():
        parts.append(_with_colors(shape, np.flatnonzero(~has_texels), inner.colors))
    # Numbers of materials: the group, and whether there is a texture.
    numbers = np.concatenate([2 * groups[has_texels] + 1, 2 * groups[~has_texels]])
    used, materials = np.unique(numbers, return_inverse=True)
    merged = replace(merge(parts), materials=materials.astype(np.uint32))
    return MergedForm(ordered(merged), tuple(_material(int(number), texture) for number in used), texture)


@dataclass(frozen=True, slots=True)
class _InnerColors:
    """Colours near the corners of a shape's triangles."""

    colors: NDArray[np.float32]
    """(m, 3, 3) linear light, for each corner."""
    found: NDArray[np.uint32]
    """(m, 3) triangles of the surface that they are of."""

    @classmethod
    def of(cls, shape: Chunk, surface: ColoredSurface, texel: float) -> _InnerColors:
        corners = shape.positions[shape.triangles].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
        points = np.einsum("kc,mcd->mkd", _INNER, corners).reshape(-1, 3)
        facing = np.repeat(normals / length[:, None], 3, axis=0)
        groups, footprint = np.repeat(shape.materials, 3).astype(np.uint8), np.repeat(np.sqrt(length / 6), 3)
        colors, found = surface.colors_at(points, facing, groups, footprint, ASTRAY * texel)
        return cls(colors.reshape(-1, 3, 3), found.reshape(-1, 3))

    def plain_charts(self, charts: Charts, surface: ColoredSurface) -> NDArray[np.bool_]:
        """(charts,) which show nothing but one colour."""
        bytes_ = _srgb(self.colors).astype(np.int16)
        low, high = np.full((len(charts), 3), 255, np.int16), np.zeros((len(charts), 3), np.int16)
        np.minimum.at(low, charts.chart, bytes_.min(axis=1))
        np.maximum.at(high, charts.chart, bytes_.max(axis=1))
        is_rich = np.zeros(len(charts), np.bool_)
        is_rich[charts.chart[~surface.is_plain[self.found].all(axis=1)]] = True
        return np.asarray(((high - low).max(axis=1) <= PLAIN) & ~is_rich)


def _density(chunk: Chunk, materials: Materials, areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) texels a metre. areas: (m,) twice those of the triangles, square metres."""
    texture = materials.texture[chunk.materials]
    found = np.zeros(len(areas))
    rows = np.flatnonzero(texture >= 0)
    if len(rows) and len(chunk.uvs):
        size = materials.size[texture[rows], :2].astype(np.float64)
        a, b, c = (chunk.uvs[chunk.triangles[rows, k]].astype(np.float64) * size for k in range(3))
        u, v = b - a, c - a
        found[rows] = np.sqrt(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / areas[rows])
    return found


def _painted(shape: Chunk, atlas: Atlas, surface: ColoredSurface, texel: float) -> NDArray[np.uint8]:
    """(h, w, 4) sRGB, opaque; what no triangle covers goes on as it is beside it."""
    ids = np.full((SAMPLES * atlas.height, SAMPLES * atlas.width), NO_TRIANGLE)
    cover(SAMPLES * atlas.corners.reshape(-1, 6), ids)
    rows, columns = np.nonzero(ids >= 0)
    which, at = ids[rows, columns], np.stack([columns, rows], axis=1)
    place = rows // SAMPLES * atlas.width + columns // SAMPLES
    to_space = _ToSpace.of(shape, atlas)
    sums = np.zeros((atlas.height * atlas.width, 3))
    for first in range(0, len(which), _BATCH):
        batch = slice(first, first + _BATCH)
        own = which[batch]
        points = to_space.points(own, (at[batch] + 0.5) / SAMPLES)
        groups = shape.materials[atlas.rows[own]].astype(np.uint8)
        footprint = np.full(len(own), texel / SAMPLES)
        colors, _ = surface.colors_at(points, to_space.facing[own], groups, footprint, ASTRAY * texel)
        for k in range(3):
            sums[:, k] += np.bincount(place[batch], colors[:, k], len(sums))
    counts = np.bincount(place, minlength=len(sums))
    image = _srgb(sums / np.maximum(counts, 1)[:, None]).reshape(atlas.height, atlas.width, 3)
    filled = fill_invalid(image, counts.reshape(image.shape[:2]) > 0)
    return np.concatenate([filled, np.full((*filled.shape[:2], 1), 255, np.uint8)], axis=2)


@dataclass(frozen=True, slots=True)
class _ToSpace:
    """From an atlas back to the triangles of its shape."""

    origin: NDArray[np.float64]
    """(k, 3) metres, the point of the triangle's plane that lies at the atlas's zero."""
    across: NDArray[np.float64]
    """(k, 2, 3) metres a texel along x and y."""
    facing: NDArray[np.float64]
    """(k, 3) unit normals."""

    @classmethod
    def of(cls, shape: Chunk, atlas: Atlas) -> _ToSpace:
        corners = shape.positions[shape.triangles[atlas.rows]].astype(np.float64)
        sides = corners[:, 1:] - corners[:, :1]
        (ax, ay), (bx, by) = (np.moveaxis(atlas.corners[:, k] - atlas.corners[:, 0], 1, 0) for k in (1, 2))
        area = ax * by - ay * bx
        # What has no area covers no sample.
        inverse = np.array([[by, -ay], [-bx, ax]]) / np.where(area == 0, 1.0, area)
        across = np.einsum("ijk,kjd->kid", inverse, sides)
        origin = corners[:, 0] - np.einsum("ki,kid->kd", atlas.corners[:, 0], across)
        normals = np.cross(sides[:, 0], sides[:, 1])
        return cls(origin, across, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))

    def points(self, triangles: NDArray[np.int32], at: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) metres. at: (n, 2) texels."""
        return np.asarray(self.origin[triangles] + np.einsum("ni,nid->nd", at, self.across[triangles]))


def _with_uvs(shape: Chunk, charts: Charts, atlas: Atlas) -> Chunk:
    """The triangles in an atlas, with a vertex for each chart that has it."""
    triangles = shape.triangles[atlas.rows]
    keys = triangles + charts.chart[atlas.rows, None] * len(shape.positions)
    _, first, corners = np.unique(keys, return_index=True, return_inverse=True)
    uvs = atlas.corners.reshape(-1, 2)[first] / [atlas.width, atlas.height]
    vertices = triangles.ravel()[first]
    return _part(shape, atlas.rows, vertices, corners, uvs.astype(np.float32), shape.colors)


def _with_colors(shape: Chunk, rows: NDArray[np.int64], colors: NDArray[np.float32]) -> Chunk:
    """Some triangles, their vertices with the mean of the colours around. colors: (m, 3, 3) near all corners."""
    vertices, corners = np.unique(shape.triangles[rows], return_inverse=True)
    places = shape.positions[shape.triangles[rows]].astype(np.float64)
    areas = np.linalg.norm(np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]), axis=1)
    weights = np.repeat(np.maximum(areas, 1e-30), 3)
    total = np.bincount(corners.ravel(), weights)
    flat = colors[rows].reshape(-1, 3)
    mean = [np.bincount(corners.ravel(), weights * flat[:, k]) / total for k in range(3)]
    opaque = np.full((len(vertices), 1), 255, np.uint8)
    painted = np.concatenate([_srgb(np.stack(mean, axis=1)), opaque], axis=1)
    return _part(shape, rows, vertices, corners, shape.uvs, painted)


def _part(
    shape: Chunk,
    rows: NDArray[np.int64],
    vertices: NDArray[np.uint32],
    corners: NDArray[np.int64],
    uvs: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> Chunk:
    triangles = corners.reshape(-1, 3).astype(np.uint32)
    own = shape.positions[vertices], shape.normals[vertices], uvs, colors
    return Chunk(*own, triangles, shape.materials[rows], shape.objects[rows])


def _material(number: int, texture: Texture | None) -> Material:
    group, has_texels = divmod(number, 2)
    return Material(
        texture=texture if has_texels else None,
        double_sided=bool(group & _DOUBLE_SIDED),
        unlit=bool(group & _UNLIT),
    )


def _srgb(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(BYTE_OF_LINEAR[np.clip(linear * 4095 + 0.5, 0, 4095).astype(np.uint16)])
