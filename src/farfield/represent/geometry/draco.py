"""Triangles of one material as Draco keeps them: a ninth of their bytes in a city, a seventeenth at statues.

Of the file format only the head is read here, so that nobody allocates for more than the data can hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import DracoPy
import numpy as np
from numpy.typing import NDArray

NORMAL_BITS = 8
"""Of each coordinate of the octahedron: steps of half a degree (6 bits: of two degrees)."""
LEVEL = 7
"""Of ten; 10 is a hundredth smaller and takes twice as long."""
MOST_ROWS = 16
"""Vertices, or triangles, for each byte of the data: what packs more tightly is no mesh."""
_MAGIC, _HEADER, _EDGEBREAKER = b"DRACO", 11, 1
_SEMANTICS = {0: "POSITION", 1: "NORMAL", 3: "TEXCOORD_0"}
"""Draco's types of attributes."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """Points that positions are rounded to. Two files with the same step, and corners whole steps apart, share them."""

    corner: tuple[float, float, float]
    """Metres."""
    size: float
    """Metres along each side."""
    bits: int
    """2^bits - 1 steps along a side."""

    @property
    def step(self) -> float:
        """Metres."""
        return self.size / ((1 << self.bits) - 1)


@dataclass(frozen=True, slots=True)
class Vertices:
    """Attributes of n vertices."""

    positions: NDArray[np.float32]
    """(n, 3) metres."""
    normals: NDArray[np.float32]
    """(n, 3) unit vectors."""
    features: NDArray[np.uint32]
    """(n,) the number of the feature that each belongs to."""
    uvs: NDArray[np.float32] | None = None
    """(n, 2)."""
    colors: NDArray[np.uint16] | None = None
    """(n, 4) linear light and alpha."""


@dataclass(frozen=True, slots=True)
class Compressed:
    """A compressed primitive."""

    data: bytes
    ids: Mapping[str, int]
    """glTF semantic -> number of the attribute in the data."""
    vertices: int
    triangles: int
    """Which, and in what order, Draco decides; without area there are none."""
    wide: bool
    """Whether there are features that 16 bits do not tell: then they are float32."""
    bounds: NDArray[np.float32]
    """(2, 3) of the positions, as they come out."""
    step: float
    """Metres that positions are rounded to."""


def compress(
    vertices: Vertices, triangles: NDArray[np.uint32], lattice: Lattice, uv_bits: int, normal_bits: int = NORMAL_BITS
) -> Compressed:
    """Compresses triangles, (m, 3) into the vertices.

    uv_bits: of texture coordinates, over their range. normal_bits: of each coordinate of the octahedron.
    """
    # Numbers of more than 16 bits cost Draco seconds, and glTF has none but floats for them.
    wide = int(vertices.features.max(initial=0)) > 0xFFFF
    generic: dict[int | str, NDArray[Any]] = {0: vertices.features.astype(np.float32 if wide else np.uint16)[:, None]}
    if vertices.colors is not None:
        generic[1] = vertices.colors
    uvs = vertices.uvs
    # Draco fails on what lies beyond: levels of a mesh may reach a little out of its leaf.
    corner = np.array(lattice.corner, np.float32)
    data = DracoPy.encode(
        np.clip(vertices.positions, corner, corner + np.float32(lattice.size)),
        triangles,
        quantization_bits=lattice.bits,
        quantization_range=lattice.size,
        quantization_origin=np.array(lattice.corner),
        compression_level=LEVEL,
        normals=vertices.normals.astype(np.float64),
        normal_quantization_bits=normal_bits,
        tex_coord=None if uvs is None else uvs.astype(np.float64),
        tex_coord_quantization_bits=None if uvs is None else uv_bits,
        generic_attributes=generic,
    )
    found = DracoPy.decode(data)
    # A plane cut into squares packs to next to nothing; what is added deflates to nothing.
    data += bytes(max(0, -(-max(len(found.points), len(found.faces)) // MOST_ROWS) - len(data)))
    points = found.points.reshape(-1, 3)
    ids = {_SEMANTICS.get(one["attribute_type"]): one["unique_id"] for one in found.attributes}
    names = {name: ids[name] for name in _SEMANTICS.values() if name in ids}
    names |= {"_FEATURE_ID_0": 0} if vertices.colors is None else {"COLOR_0": 1, "_FEATURE_ID_0": 0}
    bounds = np.stack([points.min(axis=0), points.max(axis=0)])
    return Compressed(data, names, len(points), len(found.faces), wide, bounds, lattice.step)


def decompress(data: bytes, vertices: int, triangles: int) -> tuple[dict[int, NDArray[Any]], NDArray[np.uint32]]:
    """(attributes by number, triangles): (n, k) rows of each, and (m, 3). Raises ValueError unless they are as many.

    Allocates for nothing that claims more than that, or more than MOST_ROWS for each byte.
    """
    few, faces = _claimed(data)
    if faces != triangles or few > vertices or max(vertices, triangles) > MOST_ROWS * len(data):
        raise ValueError("compressed triangles that are more or fewer than said")
    try:
        found = DracoPy.decode(data)
    except Exception as error:
        # It has exceptions of its own beside those of whatever fails inside it.
        raise ValueError(f"triangles that cannot be unpacked: {error}") from None
    rows = {int(one["unique_id"]): np.asarray(one["data"]) for one in found.attributes}
    indices = np.asarray(found.faces, dtype=np.uint32).reshape(-1, 3)
    if len(indices) != triangles or any(len(values) != vertices for values in rows.values()):
        raise ValueError("compressed triangles that are more or fewer than said")
    return rows, indices


def _claimed(data: bytes) -> tuple[int, int]:
    """(vertices, triangles) that the head of the data tells. Raises ValueError."""
    if len(data) < _HEADER + 3 or data[:5] != _MAGIC or tuple(data[5:8]) != (2, 2, 1):
        raise ValueError("not triangles as Draco 2.2 keeps them")
    if data[8] == _EDGEBREAKER:
        vertices, at = _varint(data, _HEADER + 1)
        return vertices, _varint(data, at)[0]
    triangles, at = _varint(data, _HEADER)
    return _varint(data, at)[0], triangles


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number in groups of seven bits, lowest first, and where it ends."""
    number = 0
    for place, part in enumerate(data[at : at + 5]):
        number |= (part & 0x7F) << (7 * place)
        if part < 0x80:
            return number, at + place + 1
    raise ValueError("a number that is cut short, or out of range")
