"""What a process needs to bake any cell of one world."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from farfield.bake.instances import Listing, have_own_facades, make_impostors, make_mesh_levels, shared_meshes
from farfield.bake.options import BakeOptions
from farfield.bake.plan import Plan
from farfield.bake.survey import MeshCache
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey, Grid
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.draco import NORMAL_BITS
from farfield.represent.geometry.forms import Form, forms_of
from farfield.represent.geometry.texture import decode_texture
from farfield.represent.geometry.write import encode_texture, mesh_glb
from farfield.represent.materials import MaterialTable, MipCache, TexturePool
from farfield.scene.model import Material, Scene, Texture
from farfield.scene.stored.scene import MeshSummary
from farfield.store.contract import Store
from farfield.world.index import Impostor, MeshLevel
from farfield.world.keys import content_hash, mesh_key, texture_key

FINENESS = 32
"""Steps of positions of shared meshes in a pixel's pitch."""
LEVEL_FINENESS = 4
"""Steps in the geometric error of a level: a statue of 122 triangles takes a quarter less than with those of the full
mesh, and with normals of LEVEL_NORMAL_BITS, steps of two degrees, a third."""
LEVEL_NORMAL_BITS = 6
_TABLES_KEPT = 8
_TABLES_BUDGET = 256 << 20
"""Bytes of their images: where every building has one they are few enough to fit."""
_NAMED_BUDGET = 1 << 29
"""Bytes of images that are kept with the hashes of their files."""
_IMAGES_BUDGET = 128 << 20
"""Bytes of decoded images that are kept."""
_One = TypeVar("_One")
_Made = TypeVar("_Made")


@dataclass(frozen=True, slots=True)
class BakeJob:
    """The whole job, cheap enough to be sent to every worker."""

    scene: Scene
    summaries: list[MeshSummary]
    plan: Plan
    options: BakeOptions
    signature: str


@dataclass(slots=True)
class LeafMaterials:
    """Materials of the meshes in a leaf, joined."""

    table: MaterialTable
    materials: tuple[Material, ...]
    base: dict[int, int]
    """Mesh -> number of its first material in the table."""


@dataclass(frozen=True, slots=True)
class MeshForm:
    """A file of a shared mesh."""

    hash: str
    bytes: int
    triangles: int
    images: dict[str, int]
    """Hash and bytes of those it needs."""


class BakeContext:
    """One process's view of the job: caches of meshes, material tables and written files."""

    def __init__(self, job: BakeJob, store: Store, meshes: MeshCache, threads: int = 1) -> None:
        """threads: in which the views of a cell are made; 1: in that of the caller."""
        self.job = job
        self.store = store
        self.grid: Grid = job.plan.grid
        self.directions: tuple[Direction, ...] = job.options.direction_list()
        self.meshes = meshes
        self.leaf_of: dict[CellKey, int] = {key: i for i, key in enumerate(job.plan.keys())}
        self.shared = shared_meshes(job.scene.instances, job.summaries, self.grid)
        self.shared &= ~have_own_facades(job.scene.meshes)
        """(meshes,) bool: near geometry refers to it instead of copying it."""
        self.listing = Listing(self)
        self._threads = ThreadPoolExecutor(threads) if threads > 1 else None
        self._mips = MipCache()
        self._tables: OrderedDict[tuple[int, ...], LeafMaterials] = OrderedDict()
        self._images: OrderedDict[tuple[int, bool, int], tuple[Texture, str, int]] = OrderedDict()
        self._anchors: dict[int, NDArray[np.float64]] = {}
        self._mesh_levels: dict[int, tuple[MeshLevel, ...]] = {}
        self._impostors: dict[int, tuple[Impostor, ...]] = {}
        self._mesh_forms: dict[int, tuple[Form, ...]] = {}
        self._mesh_files: dict[tuple[int, int, int], MeshForm] = {}
        self._decoded: OrderedDict[str, Texture] = OrderedDict()
        self._unstored: dict[str, bytes] = {}
        """Values that were made, and that no leaf has kept yet."""
        self._pixels: WeakKeyDictionary[Texture, bytes] = WeakKeyDictionary()

    def each(self, work: Callable[[_One], _Made], things: Iterable[_One]) -> Iterator[_Made]:
        """What `work` makes of each, in order; kernels, encoders and stores let other threads run meanwhile."""
        return map(work, things) if self._threads is None else self._threads.map(work, things)

    def materials(self, meshes: tuple[int, ...]) -> LeafMaterials:
        """The joined materials of these meshes, in their order; the last few are kept, with their mip chains.

        Meshes of the same materials, such as the pieces of one, share them: each is a draw call of near geometry.
        """
        if meshes not in self._tables:
            base: dict[int, int] = {}
            joined: list[Material] = []
            known: dict[tuple[bytes, ...], int] = {}
            for mesh in meshes:
                own = self.meshes.get(mesh).materials
                # By what shows: whether two meshes hold one texture or two alike depends on what was read when.
                looks = tuple(self.material_hash(material) for material in own)
                if looks not in known:
                    known[looks] = len(joined)
                    joined += own
                base[mesh] = known[looks]
            self._tables[meshes] = LeafMaterials(
                MaterialTable.build(joined, TexturePool(self._mips)), tuple(joined), base
            )
            while len(self._tables) > _TABLES_KEPT or (len(self._tables) > 1 and self._table_bytes() > _TABLES_BUDGET):
                self._tables.popitem(last=False)
        self._tables.move_to_end(meshes)
        return self._tables[meshes]

    def _table_bytes(self) -> int:
        return sum(one.table.arrays.pixels.nbytes for one in self._tables.values())

    def image_file(self, material: Material, halvings: int = 0) -> tuple[str, int]:
        """A material's image, its sides halved that often: its hash and bytes. It is stored by `keep`."""
        texture = material.texture
        assert texture is not None
        masked = material.alpha_cutoff is not None and halvings > 0
        place = id(texture), masked, halvings
        if place not in self._images:
            levels = self._mips.get(texture, masked) if halvings else [texture.pixels]
            # The texture is kept with its hash: its id must not be given to another while the entry stands.
            made = self.image_of(encode_texture(Texture(levels[min(halvings, len(levels) - 1)])))
            self._images[place] = texture, *made
        self._images.move_to_end(place)
        while len(self._images) > 1 and sum(one.pixels.nbytes for one, _, _ in self._images.values()) > _NAMED_BUDGET:
            self._images.popitem(last=False)
        return self._images[place][1:]

    def forget(self, texture: Texture) -> None:
        """Drops what was made of an image that no other leaf has, unless it is kept."""
        for place in [place for place, (one, _, _) in self._images.items() if one is texture]:
            self._unstored.pop(texture_key(self._images.pop(place)[1]), None)

    def material_image(self, material: Material) -> bytes:
        """The same for like images."""
        return self._pixel_hash(material.texture)

    def material_hash(self, material: Material) -> bytes:
        """Over all that shows of a material."""
        own = (material.base_color, material.alpha_cutoff, material.double_sided, material.unlit)
        return content_hash(repr(own).encode(), self._pixel_hash(material.texture)).encode()

    def _pixel_hash(self, texture: Texture | None) -> bytes:
        if texture is None:
            return b""
        found = self._pixels.get(texture)
        if found is None:
            shape = repr(texture.pixels.shape).encode()
            found = self._pixels[texture] = content_hash(shape, texture.pixels.tobytes()).encode()
        return found

    def naming(self, halvings: int, images: dict[str, int]) -> Callable[[Material], str]:
        """What gives the hash of a material's image, halved that often, and notes its bytes in `images`."""

        def named(material: Material) -> str:
            name, size = self.image_file(material, halvings)
            images[name] = size
            return name

        return named

    def mesh_forms(self, mesh: int) -> tuple[Form, ...]:
        """A shared mesh and its levels."""
        if mesh not in self._mesh_forms:
            self._mesh_forms[mesh] = forms_of(Chunk.whole(self.meshes.get(mesh).blocks), self.mesh_table(mesh))
        return self._mesh_forms[mesh]

    def mesh_table(self, mesh: int) -> MaterialTable:
        """Materials of one mesh."""
        return MaterialTable.build(self.meshes.get(mesh).materials, TexturePool(self._mips))

    def mesh_anchor(self, mesh: int) -> NDArray[np.float64]:
        """(3,) middle of a mesh's first triangle, in its frame: where its instances have their place."""
        if mesh not in self._anchors:
            blocks = self.meshes.get(mesh).blocks
            self._anchors[mesh] = blocks.positions[blocks.local[0]].mean(axis=0)
        return self._anchors[mesh]

    def mesh_levels(self, mesh: int) -> tuple[MeshLevel, ...]:
        """A shared mesh and its levels as the index lists them. They are stored by `keep`."""
        if mesh not in self._mesh_levels:
            self._mesh_levels[mesh] = make_mesh_levels(self, mesh)
        return self._mesh_levels[mesh]

    def mesh_impostors(self, mesh: int) -> tuple[Impostor, ...]:
        """Images of a shared mesh as the index lists them. They are stored by `keep`."""
        if mesh not in self._impostors:
            self._impostors[mesh] = make_impostors(self, mesh)
        return self._impostors[mesh]

    def image_of(self, data: bytes) -> tuple[str, int]:
        """Hash and bytes of an encoded image. It is stored by `keep`."""
        name = content_hash(data)
        self._unstored[texture_key(name)] = data
        return name, len(data)

    def mesh_file(self, mesh: int, shape: int, halvings: int) -> MeshForm:
        """A form of a shared mesh, the coarsest beyond that, its images halved that often. It is stored by `keep`."""
        place = mesh, shape, halvings
        if place not in self._mesh_files:
            loaded = self.meshes.get(mesh)
            images: dict[str, int] = {}
            chunk, step, bits = Chunk.whole(loaded.blocks), self.grid.pitch(0) / FINENESS, NORMAL_BITS
            if shape:
                forms = self.mesh_forms(mesh)
                form = forms[min(shape, len(forms) - 1)]
                chunk, step, bits = form.chunk, max(step, form.geometric_error / LEVEL_FINENESS), LEVEL_NORMAL_BITS
            data = mesh_glb(chunk, step, loaded.materials, self.naming(halvings, images), normal_bits=bits)
            name = content_hash(data)
            self._unstored[mesh_key(name)] = data
            self._mesh_files[place] = MeshForm(name, len(data), len(chunk.triangles), images)
        return self._mesh_files[place]

    def image(self, name: str) -> Texture:
        """An image of the world as readers decode it; the last ones are kept. Raises CorruptTileError, StoreError."""
        if name not in self._decoded:
            key = texture_key(name)
            self._decoded[name] = decode_texture(self._unstored.get(key) or self.store.get(key), key)
        self._decoded.move_to_end(name)
        while len(self._decoded) > 1 and sum(one.pixels.nbytes for one in self._decoded.values()) > _IMAGES_BUDGET:
            self._decoded.popitem(last=False)
        return self._decoded[name]

    def table(self, materials: Sequence[Material]) -> MaterialTable:
        """Of materials that no mesh of the scene has."""
        return MaterialTable.build(materials, TexturePool(self._mips))

    def keep(self, keys: Iterable[str]) -> None:
        """Stores meshes and images that a leaf needs, each once.

        One that is there is not read, for every worker asks, and `verify --repair` deletes what is damaged.
        """
        for key in keys:
            data = self._unstored.pop(key, None)
            if data is not None and not self.store.exists(key):
                self.store.put(key, data)

    def discard(self, keys: Iterable[str]) -> None:
        """Forgets values that were made and are not wanted."""
        for key in keys:
            self._unstored.pop(key, None)
