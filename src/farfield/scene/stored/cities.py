"""City objects of a place as a scene chunk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.scene.cityjson.appearance import Image
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.kinds import Family, Role
from farfield.scene.model import Mesh
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk
from farfield.store.contract import Store
from farfield.store.once import put_once
from farfield.world.keys import chunk_key, content_hash

KIND = "city"
_LARGEST = 1e12
"""Metres (spec/world.md, Limits)."""
_SHAPES = {"points": ("<f8", (3,)), "corner": ("<i8", ()), "ring_start": ("<i8", ()), "face_start": ("<i8", ()),
           "owner": ("<i8", ()), "family": ("|u1", ()), "role": ("|u1", ()), "single": ("|b1", ()),
           "image": ("<i4", ()), "color": ("|u1", (4,)), "uv": ("<f4", (2,)), "seed": ("<u4", ()),
           "height": ("<f8", ())}  # fmt: skip
"""Array -> dtype and shape of a row."""
_OF_FACES = tuple(name for name in _SHAPES if name not in ("seed", "height"))


@dataclass(frozen=True, slots=True)
class StoredCity:
    """A CityChunk in a store."""

    store: Store
    chunk: str
    """Its hash."""
    name: str
    images: tuple[Image, ...]
    facades: bool

    @classmethod
    def of(cls, chunk: CityChunk, store: Store) -> StoredCity:
        """Stores the objects, unless they are there whole."""
        data = encode_city(chunk)
        name = content_hash(data)
        put_once(store, chunk_key(name), data)
        return cls(store, name, chunk.name, chunk.images, chunk.facades)

    def load(self) -> Mesh:
        """Triangulates them. Raises CorruptTileError and StoreError."""
        key = chunk_key(self.chunk)
        return decode_city(self.store.get(key), self, key).load()


def encode_city(chunk: CityChunk) -> bytes:
    """Scene chunk of city objects; they come back exactly."""
    arrays: dict[str, NDArray[Any]] = {name: getattr(chunk.faces, name) for name in _OF_FACES}
    return encode_chunk(SceneChunk(KIND, {}, {**arrays, "seed": chunk.seed, "height": chunk.height}))


def decode_city(data: bytes, stored: StoredCity, where: str = "") -> CityChunk:
    """Reads city objects; their arrays lie in `data`. Raises CorruptTileError."""
    arrays = decode_chunk(data, KIND, where).arrays
    fault = _fault(arrays, len(stored.images))
    if fault:
        raise CorruptTileError(f"scene chunk is damaged: {fault}", where)
    faces = Faces(*(arrays[name] for name in _OF_FACES))
    return CityChunk(stored.name, faces, arrays["seed"], arrays["height"], stored.images, stored.facades)


def _fault(arrays: dict[str, NDArray[Any]], images: int) -> str:
    """What would lead astray who walks the rings, or nothing."""
    if {name: (a.dtype.str, a.shape[1:]) for name, a in arrays.items() if a.ndim} != _SHAPES:
        return "its arrays are not those of city objects"
    count, objects = len(arrays["owner"]), len(arrays["seed"])
    lengths = {len(arrays[name]) for name in ("family", "role", "single", "image", "color")}
    if count == 0 or lengths != {count} or len(arrays["height"]) != objects:
        return "columns of different lengths"
    for starts, things in (("ring_start", arrays["corner"]), ("face_start", arrays["ring_start"][1:])):
        start = arrays[starts]
        if len(start) < 2 or start[0] != 0 or start[-1] != len(things) or (np.diff(start) < 1).any():
            return f"{starts} is no partition"
    if len(arrays["face_start"]) != count + 1 or len(arrays["uv"]) not in (0, len(arrays["corner"])):
        return "columns of different lengths"
    for name, low, high in (("corner", 0, len(arrays["points"])), ("owner", 0, objects), ("image", -1, images),
                            ("family", 0, len(Family)), ("role", 0, len(Role))):  # fmt: skip
        if int(arrays[name].min()) < low or int(arrays[name].max()) >= high:
            return f"{name} out of bounds"
    if (np.diff(arrays["owner"]) < 0).any():
        return "faces out of order"
    numbers = (arrays["points"], arrays["height"], arrays["uv"])
    return "" if all((np.abs(a) <= _LARGEST).all() for a in numbers) else "a coordinate that is no number, or too large"
