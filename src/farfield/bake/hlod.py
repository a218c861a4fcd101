"""Geometry of a cell above the leaves: what lies below merged, simplified and coloured anew (spec/world.md).

It is made from the geometry of the cell's children as it is stored, so that the bytes are the same whoever bakes it and
whenever. What leaves list as instances is left out: readers place it by the index.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.bake.cell import BakedCell, Record, Standing
from farfield.bake.context import LEVEL_NORMAL_BITS, BakeContext
from farfield.bake.likeness import FARTHER, FormErrors, sights_of
from farfield.octree.grid import CellKey, Grid
from farfield.represent.chunk import Chunk, merge
from farfield.represent.geometry.hlod import ColoredSurface, MergedForm, colored, plain_shape
from farfield.represent.geometry.levels import SMALLER, STEP
from farfield.represent.geometry.read import read_leaf_glb
from farfield.represent.geometry.reduction import reduced
from farfield.represent.geometry.walls import Walls
from farfield.represent.geometry.write import LEAF_BITS, encode_texture, leaf_glb
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Mesh
from farfield.world.index import MOST_LISTING, Bounds, GeometryEntry, GeometryLevel
from farfield.world.keys import content_hash, geometry_key
from farfield.world.reach import form_values

FORMS = 3
PIXELS_A_TRIANGLE = 8
"""Of a cell's picture from one side, for a triangle of the finest form."""
SQUARE = 4
"""Texels along a side of the squares of which a corner on a wall is kept: about as far as triangles reach."""
SPARE = 16
"""Times the triangles that a cell keeps of a child that the child has at least: levels of leaves do not quite meet at
their walls."""
UNLIKE = 0.1
"""Error of a leaf's form, from where a pixel is as wide as one of its pictures, beyond which a finer one is merged."""
PARTS = 16
"""Steps of positions in a pixel's pitch: with 16 bits for all cells, forms take a fifth more bytes."""
TEXELS = 4
"""Of an atlas, for each pixel of a cell's picture from one side."""
WORST = 0.6
"""Error in the first view beyond which a form is not made."""


@dataclass(frozen=True, slots=True)
class Merged:
    """What became of a cell's geometry."""

    geometry: GeometryEntry | None
    input: str
    """Hash of what it was made from; empty: it may have none."""
    files: dict[str, bytes]
    """Forms that were made just now, by key."""


def standing_of(below: Sequence[BakedCell], merged: Merged) -> Standing:
    """Of a cell above some."""
    whole = bool(merged.input) and (merged.geometry is not None or not _sources(below, 1))
    leaves, lists = _counts(below)
    return Standing(whole, leaves, lists, _boxes(below) if leaves <= MOST_LISTING else ())


def merged_geometry(
    context: BakeContext, key: CellKey, below: Sequence[BakedCell], bounds: Bounds, before: Record | None
) -> Merged:
    """Geometry of a cell in all its forms, stored; as it is noted where that was made from the same.

    below: its children. bounds: of what lies in it, local metres. before: the cell's latest record.
    """
    leaves, lists = _counts(below)
    options = context.job.options
    is_wanted = options.geometry and options.orthoviews
    if not is_wanted or not all(cell.standing.is_solid for cell in below) or (lists and leaves > MOST_LISTING):
        return Merged(None, "", {})
    triangles = context.grid.resolution**2 // PIXELS_A_TRIANGLE
    sources = _sources(below, triangles)
    named = (f"{one.cell.key} {one.form.hash} {one.form.errors}".encode() for one in sources)
    box = context.grid.bounds(key).tobytes()
    boxes = _boxes(below)
    source = content_hash(context.job.signature.encode(), box, repr((bounds, boxes)).encode(), *named)
    if before is not None and before.merged == source:
        return Merged(before.entry.geometry, source, {})
    if not sources:
        return Merged(None, source, {})
    geometry, files = _Maker(context, key).made(sources, bounds, triangles, boxes)
    return Merged(geometry, source, files)


@dataclass(frozen=True, slots=True)
class _Source:
    """A child and the form of it that is merged."""

    cell: BakedCell
    form: GeometryLevel

    @property
    def errors(self) -> tuple[float, float]:
        """Its own, in the first view that errors of the cell above are told for, and in the second."""
        if not self.form.errors:
            return 0.0, 0.0
        first, second, *_ = (error / 255 for error in self.form.errors)
        if self.cell.key.level == 0:
            # Told from where a pixel is as wide as one of a leaf's: four times as far, and there.
            return FARTHER**2 * first, first
        return FARTHER * first, (first + second) / 2


def _counts(below: Sequence[BakedCell]) -> tuple[int, bool]:
    """Leaves below, and whether any lists instances."""
    return sum(cell.standing.leaves for cell in below), any(cell.standing.lists for cell in below)


def _boxes(below: Sequence[BakedCell]) -> tuple[tuple[float, ...], ...]:
    """Round the instances that leaves below list."""
    return tuple(box for cell in below for box in cell.standing.boxes)


def _sources(below: Sequence[BakedCell], triangles: int) -> list[_Source]:
    """What is merged into so many triangles: of each child that has any triangles of its own."""
    found = []
    for cell in below:
        geometry = cell.record.entry.geometry
        if geometry is None or not geometry.triangles:
            continue
        forms: Sequence[GeometryLevel] = geometry.forms if cell.key.level == 0 else (geometry,)
        wanted = min(SPARE * triangles // len(below), geometry.triangles)
        fit = [form for form in forms if form.triangles >= wanted and (form.errors or (0,))[0] <= 255 * UNLIKE]
        found.append(_Source(cell, fit[-1] if fit else forms[0]))
    return found


@dataclass(frozen=True, slots=True)
class _Maker:
    """Makes the forms of one cell."""

    context: BakeContext
    key: CellKey

    def made(
        self, sources: Sequence[_Source], bounds: Bounds, triangles: int, boxes: Sequence[Sequence[float]]
    ) -> tuple[GeometryEntry | None, dict[str, bytes]]:
        """From fine to coarse, those that take much fewer bytes than the one before and show something."""
        context, grid = self.context, self.context.grid
        chunk, materials = _merged(context, self.key, sources)
        weights = [one.form.triangles for one in sources]
        first, second = np.average([one.errors for one in sources], axis=0, weights=weights).tolist()
        sights = sights_of(grid, self.key, bounds)
        errors = FormErrors.against(sights, chunk, materials, (first, second))
        surface, shape = ColoredSurface.of(chunk, materials), plain_shape(chunk, materials)
        walls = Walls(grid.cell_size(self.key.level), _side(grid, self.key) / ((1 << _bits(grid, self.key)) - 1))
        found: list[GeometryLevel] = []
        files: dict[str, bytes] = {}
        for number in range(FORMS):
            texel = grid.pitch(self.key.level) * 2**number
            gathered = walls.gathered(shape, SQUARE * texel)
            shape = walls.with_normals(reduced(gathered.chunk, triangles // STEP**number, gathered.fixed), gathered)
            if not len(shape.triangles):
                break
            form, data = self._encoded(colored(shape, surface, texel, TEXELS * (grid.resolution >> number) ** 2))
            if found and _size(form) > SMALLER * _size(found[-1]):
                context.discard(key for key, _ in form_values(self.key, form))
                continue
            read = read_leaf_glb(data, geometry_key(self.key, form.hash), context.image).mesh
            told = errors.of(chunk_of(read), MaterialTable.build(read.materials)) if read is not None else None
            if told is None or told[0] > 255 * WORST:
                context.discard(key for key, _ in form_values(self.key, form))
                break
            if found:
                told = tuple(map(max, told, found[-1].errors))
            form = GeometryLevel(form.hash, form.bytes, form.triangles, 0, (), form.textures, told, form.triangles)
            context.keep(key for key, _ in form_values(self.key, form))
            files[geometry_key(self.key, form.hash)] = data
            context.store.put(geometry_key(self.key, form.hash), data)
            found.append(form)
        return _entry(found, errors.share_of(boxes)), files

    def _encoded(self, merged: MergedForm) -> tuple[GeometryLevel, bytes]:
        images: dict[str, int] = {}

        def image(material: Material) -> str:
            assert material.texture is not None
            name, size = self.context.image_of(encode_texture(material.texture))
            images[name] = size
            return name

        grid = self.context.grid
        data = leaf_glb(
            self.key, _side(grid, self.key), merged.chunk, merged.materials, (), image,
            bits=_bits(grid, self.key), normal_bits=LEVEL_NORMAL_BITS,
        )  # fmt: skip
        count = len(merged.chunk.triangles)
        return GeometryLevel(content_hash(data), len(data), count, textures=tuple(sorted(images.items()))), data


def _size(form: GeometryLevel) -> int:
    """Bytes of all that it needs."""
    return form.bytes + sum(size for _, size in form.textures)


def _entry(found: Sequence[GeometryLevel], listed: int) -> GeometryEntry | None:
    if not found:
        return None
    full, *levels = found
    return GeometryEntry(
        full.hash, full.bytes, full.triangles, 0, (), full.textures, full.errors, full.drawn, tuple(levels), listed
    )


def _merged(context: BakeContext, key: CellKey, sources: Sequence[_Source]) -> tuple[Chunk, MaterialTable]:
    """The children's triangles, metres from the cell's lower corner."""
    materials: list[Material] = []
    chunks: list[Chunk] = []
    for one in sources:
        name = geometry_key(one.cell.key, one.form.hash)
        mesh = read_leaf_glb(one.cell.file_from(context.store, name), name, context.image).mesh
        if mesh is not None:
            chunk = chunk_of(mesh)
            positions = _positions(context.grid, key, one.cell.key, chunk.positions)
            number = chunk.materials + np.uint32(len(materials))
            chunks.append(replace(chunk, positions=positions, materials=number))
            materials += mesh.materials
    return merge(chunks), context.table(materials)


def _positions(grid: Grid, key: CellKey, child: CellKey, positions: NDArray[np.float32]) -> NDArray[np.float32]:
    """From the child's lower corner to the cell's; what children share at their walls is the same to the bit."""
    side, steps = _side(grid, child), (1 << _bits(grid, child)) - 1
    shift = (grid.bounds(child)[0] - grid.bounds(key)[0]) / side
    whole = np.round(positions.astype(np.float64) * (steps / side)) + np.round(shift) * steps
    return np.asarray(whole * (side / steps), np.float32)


def _side(grid: Grid, key: CellKey) -> float:
    """Metres along the longest side of a cell, which positions are rounded by."""
    return float(grid.cell_size(key.level).max())


def _bits(grid: Grid, key: CellKey) -> int:
    """Of positions."""
    return LEAF_BITS if key.level == 0 else min(int(PARTS * grid.resolution - 1).bit_length(), LEAF_BITS)


def chunk_of(mesh: Mesh) -> Chunk:
    """A mesh as a chunk, without its objects."""
    return Chunk(
        mesh.positions.astype(np.float32),
        mesh.normals,
        np.empty((0, 2), np.float32) if mesh.uvs is None else mesh.uvs,
        np.empty((0, 4), np.uint8) if mesh.colors is None else mesh.colors,
        mesh.triangles,
        mesh.triangle_material.astype(np.uint32),
        np.zeros(len(mesh.triangles), np.uint32),
    )
