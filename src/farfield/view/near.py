"""Near geometry of a world as triangles: its leaves read back, instances clipped to them (spec/world.md)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.octree.grid import CellKey
from farfield.represent.blocks import BlockedMesh
from farfield.represent.clipping import clip_to_cell
from farfield.represent.geometry.board import board_mesh
from farfield.represent.geometry.read import read_leaf_glb, read_mesh_glb
from farfield.represent.geometry.texture import decode_texture
from farfield.represent.geometry.write import PlacedMesh
from farfield.scene.model import Texture
from farfield.stream.tree import CellTree
from farfield.view.blockmaps import MapDraw, map_of
from farfield.view.geometry import Batches
from farfield.view.impostors import ImpostorMaker
from farfield.view.kinds import PlacedInstance, ShownForm
from farfield.world.index import BlockMapEntry, CellEntry, GeometryLevel
from farfield.world.keys import DynamicImpostor, geometry_key, mesh_key, texture_key
from farfield.world.reach import form_values
from farfield.world.world import World

_HINT = "run farfield verify"


def is_held(cell: CellKey, form: GeometryLevel, held: Collection[str] | None) -> bool:
    """Whether a form of a leaf's geometry may be drawn by who holds these keys; None: all."""
    return held is None or all(key in held for key, _ in form_values(cell, form))


@dataclass(frozen=True, slots=True)
class MergedPart:
    """What a cell above stands in by for one of those below."""

    entry: CellEntry
    """Of the cell above, which has geometry of its own."""
    form: GeometryLevel | BlockMapEntry
    """By which it stands in."""
    cell: CellKey
    """To which that is clipped."""
    moved: NDArray[np.float64]
    """(3,) metres by which it is drawn elsewhere."""


class NearGeometry:
    """Draws leaves of a world as triangles, for one picture; meshes and textures that they share are read once."""

    def __init__(self, world: World, eye: NDArray[np.float64]) -> None:
        """eye: (3,) local metres."""
        self._world, self._eye = world, eye
        self._textures: dict[str, Texture] = {}
        self._maker: ImpostorMaker | None = None
        self._meshes: dict[str, tuple[BlockedMesh, int]] = {}
        """Mesh, board with an image, or merged geometry, by its key, and the number of its first material."""
        self.bytes = 0
        """Encoded size of everything read so far."""
        self.maps: list[MapDraw] = []
        """BlockMaps that are to be drawn, too."""

    def draw(self, shown: Iterable[ShownForm], batches: Batches, held: Collection[str] | None = None) -> int:
        """Draws leaves and cells above by the form that is chosen, or else the finest that can be read.

        held: keys of what may be drawn; None: all. Returns how many have none.
        """
        drawn = []
        for one in shown:
            if isinstance(one.form, BlockMapEntry):
                self.maps.append(map_of(one.entry, one.form))
            elif one.entry.geometry is not None:
                drawn.append(self._draws(one, held, partial(self._draw_leaf, one.entry, batches)))
        batches.flush()
        return drawn.count(False)

    def draw_merged(self, parts: Iterable[MergedPart], batches: Batches, held: Collection[str] | None = None) -> int:
        """Draws what stands in, each by its form or else the finest that can be read; returns how many have none."""
        drawn = []
        for part in parts:
            if isinstance(part.form, BlockMapEntry):
                self.maps.append(map_of(part.entry, part.form, self._world.grid.bounds(part.cell), part.moved))
            else:
                shown = ShownForm(part.entry, part.form)
                drawn.append(self._draws(shown, held, partial(self._draw_part, part, batches)))
        batches.flush()
        return drawn.count(False)

    def _draws(self, shown: ShownForm, held: Collection[str] | None, draw: Callable[[GeometryLevel], None]) -> bool:
        """Whether a form of a cell could be drawn: the one that is chosen, or the finest that may and can be read."""
        entry, forms = shown.entry, shown.entry.geometry.forms if shown.entry.geometry else ()
        for form in (*((shown.form,) if isinstance(shown.form, GeometryLevel) else ()), *forms):
            if is_held(entry.cell, form, held):
                with suppress(CorruptTileError):
                    draw(form)
                    return True
        return False

    def _draw_part(self, part: MergedPart, batches: Batches, form: GeometryLevel) -> None:
        key = geometry_key(part.entry.cell, form.hash)
        if key not in self._meshes:
            read = read_leaf_glb(self._read(key), key, self._texture).mesh
            if read is None:
                return
            self._meshes[key] = BlockedMesh.from_mesh(read), batches.add_materials(read.materials)
        mesh, base = self._meshes[key]
        grid, above = self._world.grid, part.entry.cell
        box, pitch = grid.bounds(part.cell), grid.pitch(above.level)
        placed = mesh.placed(_moved(np.eye(3, 4), grid.bounds(above)[0]), mesh.all_blocks, base)
        away = box.mean(axis=0) - self._eye
        away *= pitch / max(float(np.linalg.norm(away)), 1e-9)
        # Beyond the cell's walls it goes on behind what is finer, which it does not meet: else there are cracks.
        for margin, back in ((0.0, 0.0), (pitch, 1.0)):
            lower, size = box[0] - margin, box[1] - box[0] + 2 * margin
            chunk = clip_to_cell(replace(placed, positions=(placed.positions - lower) / size), 1.0, (0, 0, 0))
            if chunk is not None:
                shift = lower + part.moved + back * away - self._eye
                batches.add(replace(chunk, positions=(chunk.positions * size + shift).astype(np.float32)))

    def draw_instances(self, instances: Iterable[PlacedInstance], batches: Batches) -> int:
        """Draws instances whole, by their meshes or by boards; returns how many cannot be read."""
        unreadable = 0
        for instance in instances:
            try:
                mesh, base = (self._board if instance.is_board else self._mesh)(instance.key, batches)
            except CorruptTileError:
                unreadable += 1
                continue
            transform = _moved(instance.transform, -self._eye)
            batches.add(mesh.placed(transform, mesh.all_blocks, base, instance.first).chunk())
        return unreadable

    def draw_placed(self, entry: CellEntry, batches: Batches) -> None:
        """Draws the instances in a leaf, and nothing else of it. Raises CorruptTileError."""
        assert entry.geometry is not None
        key = geometry_key(entry.cell, entry.geometry.hash)
        for placed in read_leaf_glb(self._read(key), key, self._texture).placed:
            self._draw_instances(placed, entry.cell, self._world.grid.bounds(entry.cell)[0], batches)

    def _draw_leaf(self, entry: CellEntry, batches: Batches, geometry: GeometryLevel) -> None:
        key = geometry_key(entry.cell, geometry.hash)
        found = read_leaf_glb(self._read(key), key, self._texture)
        corner = self._world.grid.bounds(entry.cell)[0]
        for placed in found.placed:
            # All or nothing: what is missing of it would be drawn twice by a coarser form.
            self._mesh(mesh_key(placed.mesh), batches)
        if found.mesh is not None:
            mesh = BlockedMesh.from_mesh(found.mesh)
            base = batches.add_materials(found.mesh.materials)
            batches.add(mesh.placed(_moved(np.eye(3, 4), corner - self._eye), mesh.all_blocks, base).chunk())
        for placed in found.placed:
            self._draw_instances(placed, entry.cell, corner, batches)

    def _draw_instances(self, placed: PlacedMesh, cell: CellKey, corner: NDArray[np.float64], batches: Batches) -> None:
        """Each instance clipped to the leaf: the leaves that are drawn then show it whole, none twice."""
        mesh, base = self._mesh(mesh_key(placed.mesh), batches)
        index = (cell.x, cell.y, cell.z)
        for transform, first in zip(placed.transforms, placed.objects, strict=True):
            chunk = mesh.cell_chunk(_moved(transform, corner), self._world.grid, index, base, int(first))
            if chunk is not None:
                batches.add(replace(chunk, positions=(chunk.positions + (corner - self._eye)).astype(np.float32)))

    def _mesh(self, key: str, batches: Batches) -> tuple[BlockedMesh, int]:
        """The mesh and the number of its first material."""
        if key not in self._meshes:
            mesh = read_mesh_glb(self._read(key), key, self._texture)
            self._meshes[key] = BlockedMesh.from_mesh(mesh), batches.add_materials(mesh.materials)
        return self._meshes[key]

    def _board(self, key: str, batches: Batches) -> tuple[BlockedMesh, int]:
        """The board with an image and the number of its material."""
        if key not in self._meshes:
            board = board_mesh(self._image(key))
            self._meshes[key] = BlockedMesh.from_mesh(board), batches.add_materials(board.materials)
        return self._meshes[key]

    def _texture(self, name: str) -> Texture:
        return self._image(texture_key(name))

    def _image(self, key: str) -> Texture:
        if key not in self._textures:
            dynamic = DynamicImpostor.of(key)
            data = self._read(key) if dynamic is None else self._made(dynamic)
            self._textures[key] = decode_texture(data, key)
        return self._textures[key]

    def _made(self, wanted: DynamicImpostor) -> bytes:
        """As a server makes it."""
        if self._maker is None:
            self._maker = ImpostorMaker(self._world.store, CellTree.of(self._world).instances)
        return self._maker.image(wanted)

    def _read(self, key: str) -> bytes:
        try:
            data = self._world.store.get(key)
        except MissingKeyError:
            raise CorruptTileError("near geometry is missing", key, _HINT) from None
        self.bytes += len(data)
        return data


def _moved(transform: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = np.array(transform, dtype=np.float64)
    moved[:, 3] += shift
    return moved
