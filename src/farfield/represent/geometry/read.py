"""Reading near geometry back: the subset of GLB that `write` makes (spec/world.md, Geometry of a leaf).

Nothing in a file is believed before it is checked. Kernels draw what is read here and do not look whether an index is
within its array, so every attribute has a row for each vertex, every index names a vertex, and every number is finite.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.geometry.color import srgb_from_linear
from farfield.packed import unpack
from farfield.represent.geometry.dictionary import DICTIONARY
from farfield.represent.geometry.document import Accessor, Document, Primitive
from farfield.represent.geometry.draco import decompress
from farfield.represent.geometry.write import MAGIC, PlacedMesh
from farfield.scene.model import Material, Mesh, Texture

_HEADER = struct.Struct("<4sIIII")
_KIND = {5126: "<f4", 5125: "<u4", 5123: "<u2", 5121: "u1", 5120: "i1"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_UNPACKED = {
    "POSITION": (3, "f"), "NORMAL": (3, "f"), "_FEATURE_ID_0": (1, "uf"), "TEXCOORD_0": (2, "f"), "COLOR_0": (4, "u"),
}  # fmt: skip
"""Columns and kinds of number of compressed attributes."""
_LARGEST = 1e12
"""Metres: coordinates beyond are refused, before sums of them overflow."""
MAXIMUM_BYTES = 1 << 30
"""A GLB never unpacks to more than this."""
_HINT = "run farfield verify"

TextureReader = Callable[[str], Texture]
"""Texture of a hash."""


@dataclass(frozen=True, slots=True)
class LeafGeometry:
    """Near geometry of one leaf."""

    mesh: Mesh | None
    """The leaf's own triangles, metres relative to its lower corner; objects are scene ids."""
    placed: tuple[PlacedMesh, ...]
    """Instances of shared meshes that reach into it."""


def read_leaf_glb(data: bytes, where: str, texture: TextureReader) -> LeafGeometry:
    """Reads a leaf's GLB. Raises CorruptTileError; see `_glb_of` for what it allocates."""
    with _Damage(where):
        glb = _Glb(_glb_of(data, where))
        if not glb.document.scenes:
            raise ValueError("without a scene")
        notes = glb.document.scenes[0].extras.farfield
        placed = tuple(
            PlacedMesh(item.mesh, glb.transforms(item.transforms), glb.objects(item.objects))
            for item in notes.instances
        )
        if any(len(p.transforms) != len(p.objects) for p in placed):
            raise ValueError("instances with more transforms or fewer than object ids")
        mesh = glb.mesh(texture) if glb.document.meshes else None
        if mesh is not None and notes.objects is not None:
            mesh = _with_ids(mesh, glb.objects(notes.objects))
        return LeafGeometry(mesh, placed)


def _with_ids(mesh: Mesh, ids: NDArray[np.uint32]) -> Mesh:
    """The mesh with object ids in place of the numbers of its features."""
    numbers = mesh.triangle_object
    if numbers is None or mesh.object_count > len(ids):
        raise ValueError("a feature without an object id")
    return replace(mesh, triangle_object=ids[numbers], object_count=int(ids.max(initial=0)) + 1)


def read_mesh_glb(data: bytes, where: str, texture: TextureReader) -> Mesh:
    """Reads a shared mesh. Raises CorruptTileError; see `_glb_of` for what it allocates."""
    with _Damage(where):
        return _Glb(_glb_of(data, where)).mesh(texture)


def texture_hashes(data: bytes, where: str) -> tuple[str, ...]:
    """Hashes of the images that a GLB refers to. Raises CorruptTileError."""
    with _Damage(where):
        return tuple(image.hash for image in _Glb(_glb_of(data, where)).document.images)


def _glb_of(data: bytes, where: str) -> bytes:
    """The GLB, of at most as many bytes as the head declares; files from before there was compression are not packed.

    Reading it allocates at most 32 bytes for each byte of it, textures apart, and 256 for each vertex and triangle of
    compressed primitives, which are at most 16 for each byte.
    """
    if data[:4] != MAGIC:
        return data
    return unpack(data, MAGIC, MAXIMUM_BYTES, "near geometry", where, dictionary=DICTIONARY)


class _Damage:
    """Turns what a damaged file provokes in `struct`, `msgspec` and `numpy` into CorruptTileError."""

    def __init__(self, where: str) -> None:
        self._where = where

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ValueError | LookupError | RecursionError | struct.error):
            raise CorruptTileError(f"near geometry is damaged: {error}", self._where, _HINT) from None


class _Glb:
    def __init__(self, data: bytes) -> None:
        magic, version, total, length, kind = _HEADER.unpack_from(data)
        if (magic, version, total, kind) != (b"glTF", 2, len(data), 0x4E4F534A):
            raise ValueError("not a GLB of that length")
        if length > len(data) - _HEADER.size:
            raise ValueError("the JSON ends beyond the file")
        self.document = msgspec.json.decode(data[20 : 20 + length], type=Document)
        self._body = memoryview(data)[28 + length :]
        self._unread = len(self._body)

    def accessor(self, index: int, kinds: tuple[str, ...], rows: int | None = None) -> NDArray[Any]:
        """(n, k) values of an accessor whose type and component are one of `kinds`, such as "VEC3 <f4".

        rows: how many there must be. The accessors of a file share no bytes, so all of them together are no longer than
        its body: else a small file could ask for one long accessor a thousand times.
        """
        facts = self.document.accessors[index]
        if f"{facts.type} {_KIND[facts.componentType]}" not in kinds:
            raise ValueError(f"accessor {index} is none of {', '.join(kinds)}")
        if rows is not None and facts.count != rows:
            raise ValueError(f"accessor {index} has {facts.count} rows instead of {rows}")
        return self._rows(facts, np.dtype(_KIND[facts.componentType]))

    def _rows(self, facts: Accessor, kind: np.dtype[Any]) -> NDArray[Any]:
        if facts.bufferView is None:
            raise ValueError("an accessor without a view")
        view = self.document.bufferViews[facts.bufferView]
        width = _WIDTH[facts.type] * kind.itemsize
        stride = view.byteStride or width
        length = facts.count * stride
        if stride < width or length > view.byteLength or view.byteOffset + view.byteLength > len(self._body):
            raise ValueError("an accessor ends beyond its view, or the view beyond the file")
        self._unread -= length
        if self._unread < 0:
            raise ValueError("accessors share their bytes")
        raw = np.frombuffer(self._body[view.byteOffset : view.byteOffset + length], np.uint8)
        return np.ascontiguousarray(raw.reshape(facts.count, stride)[:, :width]).view(kind)

    def transforms(self, index: int) -> NDArray[np.float64]:
        """(k, 3, 4) float64 from columns of MAT4."""
        columns = _finite(self.accessor(index, ("MAT4 <f4",)), _LARGEST)
        return columns.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3].astype(np.float64)

    def objects(self, index: int) -> NDArray[np.uint32]:
        """(k,) uint32 object ids."""
        found: NDArray[np.uint32] = self.accessor(index, ("SCALAR <u4",)).ravel()
        return found

    def mesh(self, texture: TextureReader) -> Mesh:
        """All primitives as one mesh; attributes that some lack are filled with neutral values."""
        primitives = self.document.meshes[0].primitives
        parts = [self._primitive(p) for p in primitives]
        offsets = np.cumsum([0, *(len(p["positions"]) for p in parts)])
        triangles = [p["triangles"] + np.uint32(o) for p, o in zip(parts, offsets[:-1], strict=True)]
        number = np.repeat(np.arange(len(parts), dtype=np.uint16), [len(t) for t in triangles])
        objects = np.concatenate([p["objects"] for p in parts])
        return Mesh(
            positions=np.concatenate([p["positions"] for p in parts]).astype(np.float64),
            triangles=np.concatenate(triangles),
            normals=np.concatenate([p["normals"] for p in parts]),
            materials=tuple(self._material(p.material, texture) for p in primitives),
            triangle_material=number,
            uvs=_joined(parts, "uvs", np.zeros((1, 2), np.float32)),
            colors=_joined(parts, "colors", np.full((1, 4), 255, np.uint8)),
            triangle_object=objects,
            object_count=int(objects.max(initial=0)) + 1,
        )

    def _primitive(self, primitive: Primitive) -> dict[str, Any]:
        rows, triangles = self._rows_of(primitive)
        positions = _finite(rows["POSITION"], _LARGEST)
        if int(triangles.max(initial=0)) >= len(positions) and len(triangles):
            raise ValueError("an index beyond the vertices")
        normals = _finite(rows["NORMAL"])
        ids = rows["_FEATURE_ID_0"].ravel()
        if not (np.isfinite(ids) & (ids >= 0) & (ids < 2**32)).all():
            raise ValueError("an object id beyond 32 bits")
        uvs, colors = rows.get("TEXCOORD_0"), rows.get("COLOR_0")
        return {
            "positions": positions,
            "triangles": triangles,
            "normals": normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6),
            "objects": ids[triangles[:, 0]].astype(np.uint32),
            "uvs": None if uvs is None else _finite(uvs),
            "colors": None if colors is None else _srgb8(colors),
        }

    def _rows_of(self, primitive: Primitive) -> tuple[dict[str, NDArray[Any]], NDArray[np.uint32]]:
        """(semantic -> (n, k) rows, (m, 3) triangles), packed or plain."""
        places, packed = primitive.attributes, primitive.extensions.draco
        if packed is None:
            return self._plain_rows(primitive)
        count = self.document.accessors[places.POSITION].count
        indices = self.document.accessors[primitive.indices].count
        attributes, triangles = decompress(self._view(packed.bufferView), count, indices // 3)
        rows = {}
        for name, number in packed.attributes.named().items():
            width, kinds = _UNPACKED[name]
            values = rows[name] = attributes[number]
            if values.ndim != 2 or values.shape[1] != width or values.dtype.kind not in kinds:
                raise ValueError(f"{name} of another type")
        return rows, triangles

    def _plain_rows(self, primitive: Primitive) -> tuple[dict[str, NDArray[Any]], NDArray[np.uint32]]:
        """Of files from before there was compression."""
        places = primitive.attributes
        triangles = self.accessor(primitive.indices, ("SCALAR <u2", "SCALAR <u4")).reshape(-1, 3).astype(np.uint32)
        rows = {"POSITION": self.accessor(places.POSITION, ("VEC3 <f4",))}
        count = len(rows["POSITION"])
        rows["NORMAL"] = np.maximum(self.accessor(places.NORMAL, ("VEC3 i1",), count).astype(np.float32) / 127, -1)
        rows["_FEATURE_ID_0"] = self.accessor(places.feature, ("SCALAR <f4",), count)
        if places.TEXCOORD_0 is not None:
            rows["TEXCOORD_0"] = self.accessor(places.TEXCOORD_0, ("VEC2 <f4",), count)
        if places.COLOR_0 is not None:
            rows["COLOR_0"] = self.accessor(places.COLOR_0, ("VEC4 <u2",), count)
        return rows, triangles

    def _view(self, index: int) -> bytes:
        """Bytes of a view, which nothing else may share."""
        view = self.document.bufferViews[index]
        if view.byteOffset + view.byteLength > len(self._body):
            raise ValueError("a view ends beyond the file")
        self._unread -= view.byteLength
        if self._unread < 0:
            raise ValueError("views share their bytes")
        return bytes(self._body[view.byteOffset : view.byteOffset + view.byteLength])

    def _material(self, index: int, texture: TextureReader) -> Material:
        facts = self.document.materials[index]
        surface = facts.pbrMetallicRoughness
        image = None
        if surface.baseColorTexture is not None:
            source = self.document.textures[surface.baseColorTexture.index].source
            image = texture(self.document.images[source].hash)
        cutoff = facts.alphaCutoff if facts.alphaMode == "MASK" else None
        unlit = "KHR_materials_unlit" in facts.extensions
        return Material("", surface.baseColorFactor, image, cutoff, facts.doubleSided, unlit)


def _finite(values: NDArray[np.float32], largest: float = float(np.finfo(np.float32).max)) -> NDArray[np.float32]:
    """The values themselves. Raises ValueError when one is no number or beyond `largest`."""
    if not (np.abs(values) <= largest).all():
        raise ValueError("a coordinate that is no finite number, or too large")
    return values


def _joined(parts: list[dict[str, Any]], name: str, neutral: NDArray[Any]) -> NDArray[Any] | None:
    if all(p[name] is None for p in parts):
        return None
    filled = [p[name] if p[name] is not None else np.repeat(neutral, len(p["positions"]), 0) for p in parts]
    return np.concatenate(filled)


def _srgb8(colors: NDArray[np.uint16]) -> NDArray[np.uint8]:
    rgb = np.round(srgb_from_linear(colors[:, :3] / 65535.0) * 255)
    return np.concatenate([rgb, colors[:, 3:] / 257], 1).astype(np.uint8)
