"""Pieces of large meshes as scene chunks (spec/record.md), and the meshes they are again when they are read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any
from weakref import WeakValueDictionary

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.scene.model import Material, Mesh, Texture
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk
from farfield.scene.textures import LARGEST
from farfield.store.contract import Store
from farfield.world.keys import chunk_key
from farfield.world.limits import HashOrNone

PIECE, TEXTURE = "mesh piece", "texture"
_BAKE_AGAIN = "remove it and bake again"

FURTHEST = 1e12
"""Metres, as everywhere in a world (spec/world.md)."""

_Share = Annotated[float, Meta(ge=-1e30, le=1e30)]


class _MaterialRecord(msgspec.Struct, frozen=True):
    name: str
    base_color: tuple[_Share, _Share, _Share, _Share]
    alpha_cutoff: _Share | None
    double_sided: bool
    unlit: bool
    texture: HashOrNone


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """What a chunk holds."""

    mesh: Mesh
    """Its material without texture."""
    texture: str
    """Chunk of the material's texture; empty: it has none."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredPiece:
    """A MeshSource: a piece of a large mesh, in the store of the world that is made of it."""

    store: Store
    chunk: str
    """Hash of the chunk."""
    name: str

    def load(self) -> Mesh:
        """Reads the piece. Raises StoreError, and CorruptTileError when it is damaged: left out, it would be a hole."""
        key = chunk_key(self.chunk)
        piece = decode_piece(self.store.get(key), f"{self.store.location}: {key}")
        if not piece.texture:
            return piece.mesh
        material = replace(piece.mesh.materials[0], texture=_texture(self.store, piece.texture))
        return replace(piece.mesh, materials=(material,))


_textures: WeakValueDictionary[tuple[str, str], Texture] = WeakValueDictionary()
"""Those in use, by store and chunk: all pieces of a mesh have one and the same."""


def _texture(store: Store, chunk: str) -> Texture:
    found = _textures.get((store.location, chunk))
    if found is None:
        key = chunk_key(chunk)
        read = decode_texture(store.get(key), f"{store.location}: {key}")
        # Another thread may have read it meanwhile.
        found = _textures.setdefault((store.location, chunk), read)
    return found


def encode_piece(mesh: Mesh, texture: str) -> bytes:
    """The chunk of a mesh with one material and no objects; texture: the chunk of that of the material, or empty."""
    (material,) = mesh.materials
    single = mesh.positions.astype(np.float32)
    arrays: dict[str, NDArray[Any]] = {
        # Most files hold single precision anyway.
        "positions": single if (single == mesh.positions).all() else mesh.positions,
        "normals": mesh.normals,
        "triangles": mesh.triangles,
    }
    if mesh.uvs is not None:
        arrays["uvs"] = mesh.uvs
    if mesh.colors is not None:
        arrays["colors"] = mesh.colors
    record = _MaterialRecord(
        material.name, material.base_color, material.alpha_cutoff, material.double_sided, material.unlit, texture
    )
    return encode_chunk(SceneChunk(PIECE, {"material": msgspec.to_builtins(record)}, arrays))


def decode_piece(data: bytes, where: str = "") -> Piece:
    """Reads the chunk of a piece; allocates at most 32 bytes for each byte of it. Raises CorruptTileError."""
    chunk = decode_chunk(data, PIECE, where)
    arrays = chunk.arrays
    positions, triangles = arrays.get("positions"), arrays.get("triangles")
    if positions is None or triangles is None:
        raise _damaged("positions or triangles are missing", where)
    count = len(positions) if positions.ndim else 0
    shapes = {
        "positions": ((count, 3), ("<f4", "<f8")),
        "normals": ((count, 3), ("<f4",)),
        "triangles": ((triangles.size // 3, 3), ("<u4",)),
        "uvs": ((count, 2), ("<f4",)),
        "colors": ((count, 4), ("|u1",)),
    }
    for name, (shape, types) in shapes.items():
        if name in arrays and (arrays[name].shape != shape or arrays[name].dtype.str not in types):
            raise _damaged(name, where)
        most = FURTHEST if name == "positions" else np.inf
        if name in arrays and not (np.isfinite(arrays[name]) & (np.abs(arrays[name]) <= most)).all():
            raise _damaged(f"{name} out of bounds", where)
    if "normals" not in arrays or int(triangles.max(initial=0)) >= max(count, 1) or (len(triangles) and not count):
        raise _damaged("its triangles have no vertices or normals", where)
    try:
        record = msgspec.convert(chunk.about.get("material"), _MaterialRecord)
    except msgspec.ValidationError as error:
        raise _damaged(str(error), where) from None
    material = Material(record.name, record.base_color, None, record.alpha_cutoff, record.double_sided, record.unlit)
    mesh = Mesh(
        positions=positions.astype(np.float64),
        triangles=triangles,
        normals=arrays["normals"],
        materials=(material,),
        triangle_material=np.zeros(len(triangles), np.uint16),
        uvs=arrays.get("uvs"),
        colors=arrays.get("colors"),
    )
    return Piece(mesh, record.texture)


def encode_texture(texture: Texture) -> bytes:
    """The chunk of a texture."""
    return encode_chunk(SceneChunk(TEXTURE, {}, {"pixels": texture.pixels}))


def decode_texture(data: bytes, where: str = "") -> Texture:
    """Reads the chunk of a texture; allocates as `decode_chunk` does. Raises CorruptTileError."""
    pixels = decode_chunk(data, TEXTURE, where).arrays.get("pixels")
    if pixels is None or pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 4:
        raise _damaged("its pixels", where)
    if not 1 <= min(pixels.shape[:2]) <= max(pixels.shape[:2]) <= LARGEST:
        raise _damaged(f"it is {pixels.shape[1]} x {pixels.shape[0]} pixels", where)
    return Texture(pixels)


def _damaged(what: str, where: str) -> CorruptTileError:
    return CorruptTileError(f"scene chunk is damaged: {what}", where, _BAKE_AGAIN)
