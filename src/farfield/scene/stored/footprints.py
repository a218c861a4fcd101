"""Footprints of a square as a scene chunk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.scene.footprints.details import SIDES, Details
from farfield.scene.footprints.features import Features, FootprintChunk, chunk_at
from farfield.scene.footprints.order import Square
from farfield.scene.footprints.rings import Rings
from farfield.scene.model import Mesh
from farfield.scene.options import Facades
from farfield.scene.stored.container import SceneChunk, decode_chunk, encode_chunk
from farfield.store.contract import Store
from farfield.store.once import put_once
from farfield.world.keys import chunk_key, content_hash

KIND = "footprints"
_LARGEST = 1e12
"""Metres (spec/world.md, Limits)."""


@dataclass(frozen=True, slots=True)
class StoredFootprints:
    """A FootprintChunk in a store."""

    store: Store
    chunk: str
    """Its hash."""
    family: str
    level: int
    prefix: int
    count: int
    """Buildings."""
    facades: Facades

    @classmethod
    def of(cls, chunk: FootprintChunk, store: Store) -> StoredFootprints:
        """Stores the footprints, unless they are there whole."""
        data = encode_features(chunk.features)
        name = content_hash(data)
        put_once(store, chunk_key(name), data)
        square = chunk.square
        return cls(store, name, chunk.family, square.level, square.prefix, len(chunk.features), chunk.facades)

    @property
    def square(self) -> Square:
        """Where they are."""
        return Square(self.level, self.prefix)

    @property
    def name(self) -> str:
        """File and place."""
        return f"{self.family}, {self.square}"

    def features(self) -> Features:
        """The footprints. Raises CorruptTileError and StoreError."""
        key = chunk_key(self.chunk)
        features = decode_features(self.store.get(key), key)
        if len(features) != self.count:
            raise CorruptTileError(f"scene chunk of {len(features)} footprints instead of {self.count}", key)
        return features

    def load(self) -> Mesh:
        """Extrudes them. Raises CorruptTileError and StoreError."""
        return chunk_at(self.square, self.features(), self.family, self.facades).load()


def encode_features(features: Features) -> bytes:
    """Scene chunk of footprints; they come back exactly."""
    rings = features.rings
    arrays: dict[str, NDArray[Any]] = {
        "xy": rings.xy.astype(np.float64),
        "ring_start": rings.ring_start,
        "polygon_start": rings.polygon_start,
        "polygon_feature": rings.polygon_feature,
        "bottom": features.bottom,
        "top": features.top,
        "seed": features.seed,
    }
    arrays |= features.details.told()  # Of most buildings nothing, so that their chunks are what they always were.
    return encode_chunk(SceneChunk(KIND, {}, arrays))


_SHAPES = {"xy": ("<f8", 2), "ring_start": ("<i8", 1), "polygon_start": ("<i8", 1), "polygon_feature": ("<i8", 1),
           "bottom": ("<f8", 1), "top": ("<f8", 1), "seed": ("<u4", 1)}  # fmt: skip
"""Array -> dtype and number of axes."""
_DETAILS = {name: ("<f8" if name == "lift" else "|u1", 1 + len(sides)) for name, sides in SIDES.items()}
"""Likewise of those that are there only if any building has them."""


def decode_features(data: bytes, where: str = "") -> Features:
    """Reads footprints; their arrays lie in `data`. Raises CorruptTileError."""
    arrays = decode_chunk(data, KIND, where).arrays
    fault = _fault(arrays)
    if fault:
        raise CorruptTileError(f"scene chunk is damaged: {fault}", where)
    rings = Rings(*(arrays[name] for name in ("xy", "ring_start", "polygon_start", "polygon_feature")))
    details = Details(**{name: arrays[name] for name in SIDES if name in arrays})
    return Features(rings, arrays["bottom"], arrays["top"], arrays["seed"], details)


def _fault(arrays: dict[str, NDArray[Any]]) -> str:
    """What would lead astray who walks the rings, or nothing."""
    wanted = _SHAPES | {name: shape for name, shape in _DETAILS.items() if name in arrays}
    if {name: (a.dtype.str, a.ndim) for name, a in arrays.items()} != wanted or arrays["xy"].shape[1] != 2:
        return "its arrays are not those of footprints"
    count = len(arrays["bottom"])
    columns = {"top": (), "seed": (), **SIDES}
    if count == 0 or any(arrays[name].shape != (count, *sides) for name, sides in columns.items() if name in arrays):
        return "columns of different lengths"
    for starts, things, least in (("ring_start", arrays["xy"], 3), ("polygon_start", arrays["ring_start"][1:], 1)):
        start = arrays[starts]
        if len(start) < 2 or start[0] != 0 or start[-1] != len(things) or (np.diff(start) < least).any():
            return f"{starts} is no partition"
    owners = arrays["polygon_feature"]
    if len(owners) != len(arrays["polygon_start"]) - 1 or not np.array_equal(np.unique(owners), np.arange(count)):
        return "polygons without a feature, or features without a polygon"
    if (np.diff(owners) < 0).any():
        return "polygons out of order"
    numbers = [arrays[name] for name in ("xy", "bottom", "top", "lift") if name in arrays]
    return "" if all((np.abs(a) <= _LARGEST).all() for a in numbers) else "a coordinate that is no number, or too large"
