"""Cutting a large mesh into pieces while it is read, in bounded memory."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError, MissingKeyError
from farfield.progress import Progress
from farfield.scene.cleaning import Losses, RawSurface, nothing_usable, shaded, visible
from farfield.scene.faults import reading
from farfield.scene.model import Mesh, Texture
from farfield.scene.shading import face_vectors
from farfield.scene.stored.order import TRIANGLE, Extent, Order
from farfield.scene.stored.piece import FURTHEST, encode_piece, encode_texture
from farfield.scene.stored.rings import rings
from farfield.scene.streams import MeshStream, SurfaceStream, gather
from farfield.store.contract import Store
from farfield.store.once import put_once
from farfield.world.keys import chunk_key, content_hash

PIECE_TRIANGLES = 1 << 19
"""Of a piece, at most; half as many are usual."""


@dataclass(frozen=True, slots=True)
class Pieces:
    """What became of a mesh: chunks by their hashes, each with its bytes."""

    pieces: tuple[tuple[str, int], ...]
    textures: tuple[tuple[str, int], ...]
    warnings: tuple[str, ...]
    """What was left out and why."""


def write_pieces(
    stream: MeshStream, store: Store, where: str, progress: Progress, most: int = PIECE_TRIANGLES
) -> Pieces:
    """Sorts the triangles of a mesh into pieces and puts each into the store; what is there whole stays.

    The pieces together have the triangles, normals, texture coordinates and colours that the mesh has when it is loaded
    whole, to the bit. They depend on the content of the file and `most` alone, and a change in one place of it changes
    those pieces only that have a part in it. most: triangles of a piece.
    Takes about 600 bytes of memory for each triangle of a piece, and 100 bytes on disk (where temporary files go)
    for each of the mesh. Raises InputError and StoreError.
    """
    found = _Found([], {}, [])
    with reading(where):
        for surface in stream.surfaces:
            _write_surface(surface, store, where, progress, most, found)
    return Pieces(tuple(found.pieces), tuple(dict.fromkeys(found.textures.values())), tuple(found.warnings))


@dataclass(slots=True)
class _Found:
    """Pieces, while they are becoming more."""

    pieces: list[tuple[str, int]]
    textures: dict[Texture, tuple[str, int]]
    warnings: list[str]


def _write_surface(
    surface: SurfaceStream, store: Store, where: str, progress: Progress, most: int, found: _Found
) -> None:
    texture = surface.material.texture
    if texture is not None and texture not in found.textures:
        found.textures[texture] = _put(store, encode_texture(texture))
    name = "" if texture is None else found.textures[texture][0]
    losses = Losses()
    with tempfile.TemporaryDirectory(prefix="farfield-") as folder:
        progress.start(surface.faces, f"triangles of {where} sorted")
        order = Order.of(surface, _extent(surface, where), Path(folder), losses, progress)
        progress.finish()
        cuts = order.cuts(most)
        progress.start(len(cuts), f"pieces of {where} written")
        for mesh in _meshes(surface, order, cuts, Path(folder)):
            found.pieces.append(_put(store, encode_piece(mesh, name)))
            progress.advance()
        progress.finish()
    found.warnings += (*surface.warnings, *losses.lines(where))
    if not cuts:
        found.warnings.append(nothing_usable(where))


def _extent(surface: SurfaceStream, where: str) -> Extent:
    extent = Extent.of(surface)
    if np.abs([extent.lower, extent.upper]).max() > FURTHEST:
        raise InputError(f"has coordinates beyond {FURTHEST:.0e} m", where, "check its coordinates")
    return extent


def _put(store: Store, data: bytes) -> tuple[str, int]:
    name = content_hash(data)
    put_once(store, chunk_key(name), data)
    return name, len(data)


def holds(store: Store, chunk: str, size: int) -> bool:
    """Whether a chunk is there, with all its bytes."""
    try:
        return store.size(chunk_key(chunk)) == size
    except MissingKeyError:
        return False


def _meshes(surface: SurfaceStream, order: Order, cuts: list[tuple[int, int]], folder: Path) -> Iterator[Mesh]:
    """The pieces of a surface, in the order of the curve."""
    alone = len(cuts) == 1 or not (order.extent.lacks_normals and surface.shares_vertices)
    around = repeat(np.empty(0, TRIANGLE)) if alone else rings(order, cuts, folder)
    for cut, ring in zip(cuts, around, strict=False):
        yield _mesh(surface, order.part(*cut), ring)


def _mesh(surface: SurfaceStream, own: NDArray[Any], ring: NDArray[Any]) -> Mesh:
    """The mesh of some triangles; ring: those that have a part in their normals too."""
    # Normals are sums in the order of the file: only so are they the same as those of the whole to the bit.
    every = np.concatenate([own, ring])
    every = every[np.argsort(every["triangle"])]
    numbers, local = np.unique(every["corners"], return_inverse=True)
    vertices = gather(surface, numbers)
    triangles = local.reshape(-1, 3).astype(np.uint32)
    raw = RawSurface(
        vertices.positions,
        triangles.astype(np.int64),
        vertices.normals,
        vertices.uvs,
        visible(vertices.colors),
        (replace(surface.material, texture=None),),
        crease_cosine=surface.crease_cosine,
    )
    chosen = np.searchsorted(every["triangle"], own["triangle"])
    return shaded(raw, triangles, face_vectors(raw.positions, triangles), chosen)
