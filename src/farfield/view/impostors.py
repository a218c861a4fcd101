"""Dynamic impostors: images of shared meshes made on demand, for where a viewer is going to be (BEN 4.1, 5.1).

A world has images from the side alone, which tell little to an eye that looks down. These are made from the meshes as
they lie in the world, so that no bake has to be kept, and remembered: viewers that look alike are sent the same.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.board import dynamic_angle
from farfield.represent.geometry.impostor import impostor_image
from farfield.represent.geometry.read import read_mesh_glb
from farfield.represent.geometry.texture import decode_texture
from farfield.represent.materials import MaterialTable, TexturePool
from farfield.store.contract import Store
from farfield.stream.forms import CellForms
from farfield.stream.tree import Instances
from farfield.world.keys import DynamicImpostor, mesh_key, texture_key

ENOUGH_TRIANGLES = 50_000
"""Of a mesh, for the finest image: the coarsest level that has as many is drawn. A full statue of 990,000 triangles
takes 60 ms, its level of 248,000 16 to 29 ms."""
MOST_TRIANGLES = 1_000_000
"""Of the meshes that are kept decoded, some 120 MB of them."""
MOST_TEXELS = 32 << 20
"""Of their images, 128 MB and a third more in smaller sizes; what is larger is decoded anew."""
MOST_BYTES = 16 << 20
"""Of images that are kept: 10,000 and more."""
MOST_ROWS = 768
"""Of an image."""
MOST_WAITING = 4
"""Images that are waited for, from which on none should be asked for: up to a fifth of a second of a core."""


@dataclass(frozen=True, slots=True)
class _Drawable:
    """A mesh as it is drawn."""

    chunk: Chunk
    materials: MaterialTable
    texels: int


@dataclass(frozen=True, slots=True)
class _Source:
    """What a mesh is drawn from."""

    key: str
    """Of the level."""
    bounds: NDArray[np.float64]
    """(2, 3) of the mesh, in its own frame."""


class ImpostorMaker:
    """Makes the dynamic impostors of one generation of a world, one at a time, in a thread of its own."""

    def __init__(self, store: Store, instances: Instances) -> None:
        """instances: of the world, whose meshes may be asked for."""
        self._store = store
        self._sources = {
            forms.values[0].cell: _source(forms, counts, bounds)
            for forms, counts, bounds in zip(instances.forms, instances.triangles, instances.boxes, strict=True)
        }
        self._meshes: OrderedDict[str, _Drawable] = OrderedDict()
        self._images: OrderedDict[str, bytes] = OrderedDict()
        self._bytes = 0
        self._worker = ThreadPoolExecutor(1, "impostors")
        self._waited_for: set[Future[bytes]] = set()

    @property
    def is_busy(self) -> bool:
        """Whether so many images are waited for that no other should be."""
        self._waited_for = {one for one in self._waited_for if not one.done()}
        return len(self._waited_for) >= MOST_WAITING

    def begin(self, wanted: DynamicImpostor) -> Future[bytes]:
        """Has an image made: WebP with alpha. It fails with StoreError or CorruptTileError, see `image`.

        This and `is_busy` are for one thread, such as that of an event loop.
        """
        begun = self._worker.submit(self._image, wanted)
        self._waited_for.add(begun)
        return begun

    def image(self, wanted: DynamicImpostor) -> bytes:
        """WebP with alpha. Raises StoreError, and CorruptTileError: its mesh is damaged, or missing."""
        return self._worker.submit(self._image, wanted).result()

    def _image(self, wanted: DynamicImpostor) -> bytes:
        found = self._images.get(wanted.key)
        if found is None:
            found = self._drawn(wanted)
            self._images[wanted.key] = found
            self._bytes += len(found)
        self._images.move_to_end(wanted.key)
        while self._bytes > MOST_BYTES:
            self._bytes -= len(self._images.popitem(last=False)[1])
        return found

    def _drawn(self, wanted: DynamicImpostor) -> bytes:
        if wanted.rows > MOST_ROWS:
            raise CorruptTileError(f"an impostor of more than {MOST_ROWS} rows", wanted.key)
        mesh, angle = self._mesh(wanted.mesh), dynamic_angle(wanted.turn, wanted.tilt)
        try:
            return impostor_image(mesh.chunk, mesh.materials, self._sources[wanted.mesh].bounds, wanted.rows, angle)
        except (ArithmeticError, ValueError, OSError) as error:
            # Bounds that are flat, or have nothing to do with the mesh.
            raise CorruptTileError(f"its mesh cannot be drawn: {error}", wanted.key) from None

    def _mesh(self, name: str) -> _Drawable:
        if name not in self._sources:
            raise CorruptTileError("no such mesh is listed", mesh_key(name))
        found = self._meshes.get(name) or self._read(self._sources[name].key)
        self._meshes[name] = found
        self._meshes.move_to_end(name)
        while len(self._meshes) > 1 and self._is_full():
            self._meshes.popitem(last=False)
        return found

    def _is_full(self) -> bool:
        kept = self._meshes.values()
        triangles = sum(len(one.chunk.triangles) for one in kept)
        return triangles > MOST_TRIANGLES or sum(one.texels for one in kept) > MOST_TEXELS

    def _read(self, key: str) -> _Drawable:
        mesh = read_mesh_glb(self._get(key), key, lambda image: decode_texture(self._get(texture_key(image)), key))
        blocks = BlockedMesh.from_mesh(mesh)
        images = {id(one.texture): one.texture for one in mesh.materials if one.texture is not None}
        texels = sum(image.pixels.shape[0] * image.pixels.shape[1] for image in images.values())
        return _Drawable(Chunk.whole(blocks), MaterialTable.build(mesh.materials, TexturePool()), texels)

    def _get(self, key: str) -> bytes:
        try:
            return self._store.get(key)
        except MissingKeyError:
            raise CorruptTileError("near geometry is missing", key, "run farfield verify") from None


def _source(forms: CellForms, triangles: Sequence[int], bounds: NDArray[np.float64]) -> _Source:
    enough = [level for level, count in enumerate(triangles) if count >= ENOUGH_TRIANGLES]
    return _Source(forms.values[max(enough, default=0)].keys[-1], bounds)
