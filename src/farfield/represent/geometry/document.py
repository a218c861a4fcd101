"""The JSON of the GLBs that `write` makes: the part of glTF 2.0 that near geometry needs, with its types.

Members are named as in glTF. What has another type, is negative or is no finite number is refused where the JSON is
decoded; unknown members are skipped.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Number = Annotated[int, Meta(ge=0, le=(1 << 32) - 1)]
"""A count, a length, an offset or a place in a list: a GLB has less than 4 GiB."""
_Factor = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""Of colour or alpha: single precision holds it."""
_Hash = Annotated[str, Meta(pattern=r"^[0-9a-f]{16}\Z")]
MAXIMUM_PRIMITIVES = 65535
"""Primitives of a mesh: its triangles name their material in 16 bits."""


class Accessor(msgspec.Struct, frozen=True):
    """Typed rows of a buffer view."""

    componentType: Literal[5120, 5121, 5123, 5125, 5126]  # noqa: N815
    count: _Number
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT4"]
    bufferView: _Number | None = None  # noqa: N815
    """None: of a compressed primitive."""


class BufferView(msgspec.Struct, frozen=True):
    """A run of bytes of the body."""

    byteLength: _Number  # noqa: N815
    byteOffset: _Number = 0  # noqa: N815
    byteStride: Annotated[int, Meta(ge=1, le=252)] | None = None  # noqa: N815


class Attributes(msgspec.Struct, frozen=True, rename={"feature": "_FEATURE_ID_0"}):
    """Of a primitive's vertices."""

    POSITION: _Number
    NORMAL: _Number
    feature: _Number
    TEXCOORD_0: _Number | None = None
    COLOR_0: _Number | None = None

    def named(self) -> dict[str, int]:
        """By glTF's names."""
        found: dict[str, int] = msgspec.to_builtins(self)
        return {name: number for name, number in found.items() if number is not None}


class CompressedPrimitive(msgspec.Struct, frozen=True):
    """Where a compressed primitive is."""

    bufferView: _Number  # noqa: N815
    attributes: Attributes
    """Numbers of the attributes in the data."""


class PrimitiveExtensions(msgspec.Struct, frozen=True, rename={"draco": "KHR_draco_mesh_compression"}):
    """Of a primitive."""

    draco: CompressedPrimitive | None = None


class Primitive(msgspec.Struct, frozen=True):
    """Triangles of one material."""

    attributes: Attributes
    """Places in the list of accessors."""
    indices: _Number
    material: _Number
    extensions: PrimitiveExtensions = PrimitiveExtensions()


class MeshEntry(msgspec.Struct, frozen=True):
    """All triangles of the file."""

    primitives: Annotated[tuple[Primitive, ...], Meta(min_length=1, max_length=MAXIMUM_PRIMITIVES)]


class TextureReference(msgspec.Struct, frozen=True):
    """Place in the list of textures."""

    index: _Number


class Surface(msgspec.Struct, frozen=True):
    """Base colour of a material, linear light and alpha."""

    baseColorFactor: tuple[_Factor, _Factor, _Factor, _Factor]  # noqa: N815
    baseColorTexture: TextureReference | None = None  # noqa: N815


class MaterialEntry(msgspec.Struct, frozen=True):
    """A material."""

    pbrMetallicRoughness: Surface  # noqa: N815
    alphaMode: str = "OPAQUE"  # noqa: N815
    alphaCutoff: _Factor = 0.5  # noqa: N815
    doubleSided: bool = False  # noqa: N815
    extensions: dict[str, msgspec.Raw] = {}


class TextureEntry(msgspec.Struct, frozen=True):
    """Place in the list of images."""

    source: _Number


class ImageEntry(msgspec.Struct, frozen=True):
    """Relative address of a texture of the world."""

    uri: Annotated[str, Meta(pattern=r"^(\.\./){1,4}texture/[0-9a-f]{16}\Z")]

    @property
    def hash(self) -> str:
        """What the texture is called."""
        return self.uri[-16:]


class InstanceList(msgspec.Struct, frozen=True):
    """Placements of one shared mesh."""

    mesh: _Hash
    transforms: _Number
    objects: _Number


class LeafNotes(msgspec.Struct, frozen=True):
    """What glTF has no place for."""

    objects: _Number | None = None
    """Accessor of the object id of each feature; None: a feature's number is its id."""
    instances: tuple[InstanceList, ...] = ()


class Extras(msgspec.Struct, frozen=True):
    """Extras of the scene."""

    farfield: LeafNotes = LeafNotes()


class SceneEntry(msgspec.Struct, frozen=True):
    """The scene of the file."""

    extras: Extras = Extras()


class Document(msgspec.Struct, frozen=True):
    """The whole JSON."""

    scenes: tuple[SceneEntry, ...] = ()
    meshes: tuple[MeshEntry, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    bufferViews: tuple[BufferView, ...] = ()  # noqa: N815
    materials: tuple[MaterialEntry, ...] = ()
    textures: tuple[TextureEntry, ...] = ()
    images: tuple[ImageEntry, ...] = ()
