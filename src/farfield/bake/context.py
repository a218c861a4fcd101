"""What a process needs to bake any cell of one world."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from farfield.bake.options import BakeOptions
from farfield.bake.plan import Plan
from farfield.bake.survey import MeshCache
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey, Grid
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.write import encode_texture, mesh_glb
from farfield.represent.materials import MaterialTable, MipCache, TexturePool
from farfield.scene.model import Material, Scene, Texture
from farfield.scene.stored.scene import MeshSummary
from farfield.store.contract import Store
from farfield.world.keys import content_hash, mesh_key, texture_key

_TABLES_KEPT = 8
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
        placements = np.bincount(job.scene.instances.mesh, minlength=len(job.scene.meshes))
        self.shared = placements > 1
        """(meshes,) bool: placed more than once, so near geometry refers to it instead of copying it."""
        self._threads = ThreadPoolExecutor(threads) if threads > 1 else None
        self._mips = MipCache()
        self._tables: OrderedDict[tuple[int, ...], LeafMaterials] = OrderedDict()
        self._textures: dict[int, tuple[Texture, str]] = {}
        self._mesh_files: dict[int, tuple[str, int]] = {}
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
            while len(self._tables) > _TABLES_KEPT:
                self._tables.popitem(last=False)
        self._tables.move_to_end(meshes)
        return self._tables[meshes]

    def texture_hash(self, texture: Texture) -> str:
        """Stores the texture once and gives its hash."""
        if id(texture) not in self._textures:
            data = encode_texture(texture)
            name = content_hash(data)
            self._put_once(texture_key(name), data)
            # The texture is kept with its hash: its id must not be given to another while the entry stands.
            self._textures[id(texture)] = (texture, name)
        return self._textures[id(texture)][1]

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

    def mesh_file(self, mesh: int) -> tuple[str, int]:
        """Stores a shared mesh once; its hash and bytes."""
        if mesh not in self._mesh_files:
            loaded = self.meshes.get(mesh)
            data = mesh_glb(Chunk.whole(loaded.blocks), loaded.materials, self.texture_hash)
            name = content_hash(data)
            self._put_once(mesh_key(name), data)
            self._mesh_files[mesh] = name, len(data)
        return self._mesh_files[mesh]

    def _put_once(self, key: str, data: bytes) -> None:
        """Unless it is there; it is not read, for every worker asks, and `verify --repair` deletes what is damaged."""
        if not self.store.exists(key):
            self.store.put(key, data)
