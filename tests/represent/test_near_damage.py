"""What the fuzzing of near geometry and textures found: each would have reached kernels that do not check an index."""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from PIL import Image

from farfield.errors import CorruptTileError
from farfield.represent.geometry.draco import decompress
from farfield.represent.geometry.read import read_leaf_glb, read_mesh_glb, texture_hashes
from farfield.represent.geometry.texture import decode_texture
from farfield.scene.model import Texture
from fuzz.decoders import NEAR, decoders
from fuzz.shells import GLB_BODY, GLB_JSON

WHITE = Texture(np.full((1, 1, 4), 255, np.uint8))
MESH = decoders()["mesh"].corpus[0]
"""Three primitives with colours and texture coordinates."""
COMPRESSED = decoders()["mesh"].corpus[1]
"""The same, as it is written today."""
LEAF = decoders()["leaf"].corpus[0]

Change = Callable[[dict[str, Any]], object]


def changed(glb: bytes, change: Change) -> bytes:
    """A GLB whose JSON was changed."""
    document = json.loads(GLB_JSON.open(glb) or b"")
    change(document)
    return GLB_JSON.close(glb, json.dumps(document).encode())


def attribute(name: str, **members: object) -> Change:
    """Changes the accessor of an attribute of the first primitive."""

    def change(document: dict[str, Any]) -> None:
        primitive = document["meshes"][0]["primitives"][0]
        index = primitive["indices"] if name == "indices" else primitive["attributes"][name]
        document["accessors"][index] |= members

    return change


def view(**members: object) -> Change:
    return lambda document: document["bufferViews"][0].update(members)


def refused(data: bytes) -> str:
    with pytest.raises(CorruptTileError) as caught:
        read_mesh_glb(data, "mesh/x", lambda _: WHITE)
    return caught.value.what


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (attribute("NORMAL", count=2), "rows instead of"),
        (attribute("TEXCOORD_0", count=2), "rows instead of"),
        (attribute("COLOR_0", count=2), "rows instead of"),
        (attribute("_FEATURE_ID_0", count=2), "rows instead of"),
        (lambda d: [attribute(name, count=3)(d) for name in d["meshes"][0]["primitives"][0]["attributes"]], "vertices"),
        (attribute("POSITION", type="SCALAR"), "none of VEC3"),
        (attribute("indices", componentType=5121), "none of SCALAR"),
        (attribute("POSITION", count=10**9), "ends beyond"),
        (attribute("POSITION", count=-1), "count"),
        (attribute("POSITION", count=1.5), "count"),
        (attribute("POSITION", bufferView=999), "out of range"),
        (attribute("POSITION", bufferView=-1), "bufferView"),
        (view(byteOffset=-4), "byteOffset"),
        (view(byteOffset=2**31), "ends beyond"),
        (view(byteLength=2**32 - 1), "ends beyond"),
        (view(byteStride=0), "byteStride"),
        (view(byteStride=1), "ends beyond"),
        (lambda d: d.update(accessors={}), "accessors"),
        (lambda d: d.update(meshes=[]), "out of range"),
        (lambda d: d["meshes"][0].update(primitives=[]), "primitives"),
        (lambda d: d["meshes"][0].update(primitives=d["meshes"][0]["primitives"] * 2), "share their bytes"),
        (lambda d: d["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor=["1", 1, 1, 1]), "baseColorFactor"),
        (
            lambda d: d["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor=[1e308, 1, 1, 1]),
            "baseColorFactor",
        ),
        (lambda d: d["images"][0].update(uri="https://example.org/0123456789abcdef"), "uri"),
        (lambda d: d["images"][0].update(uri="../texture/../secret"), "uri"),
    ],
)
def test_each_fault_is_named(change: Change, says: str) -> None:
    assert says in refused(changed(MESH, change))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (attribute("POSITION", count=2), "more or fewer"),
        (attribute("POSITION", count=10**9), "more or fewer"),
        (attribute("indices", count=3), "more or fewer"),
        (lambda d: d["bufferViews"][0].update(byteLength=2), "keeps them"),
        (lambda d: d["bufferViews"][0].update(byteLength=40), "unpacked"),
        (lambda d: d["meshes"][0].update(primitives=d["meshes"][0]["primitives"] * 2), "share their bytes"),
        (lambda d: draco(d).update(POSITION=draco(d)["NORMAL"] + 100), "damaged"),
        (lambda d: draco(d).update(TEXCOORD_0=draco(d)["NORMAL"]), "another type"),
    ],
)
def test_each_fault_of_compressed_primitives_is_named(change: Change, says: str) -> None:
    assert says in refused(changed(COMPRESSED, change))


def draco(document: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]
    return found["attributes"]


def test_heads_that_claim_more_than_the_data_can_hold() -> None:
    head = b"DRACO" + bytes([2, 2, 1, 1, 0, 0, 0])
    many = bytes([255, 255, 255, 255, 7])
    for data in (b"", head, head + many + many, head + many, b"DRACO" + bytes([1, 2, 1, 1, 0, 0, 0]) + many):
        with pytest.raises(ValueError, match=r"keeps them|more or fewer|range"):
            decompress(data, 3, 1)
        with pytest.raises(ValueError, match=r"keeps them|more or fewer|range"):
            decompress(data, 2**31 - 1, 2**31 - 1)


@pytest.mark.parametrize("number", [np.nan, np.inf, 3e38])
@pytest.mark.parametrize("name", ["POSITION", "TEXCOORD_0", "_FEATURE_ID_0"])
def test_numbers_that_are_none(name: str, number: float) -> None:
    document = json.loads(GLB_JSON.open(MESH) or b"")
    index = document["meshes"][0]["primitives"][0]["attributes"][name]
    at = document["bufferViews"][document["accessors"][index]["bufferView"]]["byteOffset"]
    body = bytearray(GLB_BODY.open(MESH) or b"")
    struct.pack_into("<f", body, at, number)
    if name == "TEXCOORD_0" and number == 3e38:
        # A texture repeats for ever; what is too large to have a fraction is looked up at 0.
        assert len(read_mesh_glb(GLB_BODY.close(MESH, bytes(body)), "", lambda _: WHITE).triangles)
        return
    assert "finite" in (found := refused(GLB_BODY.close(MESH, bytes(body)))) or "object id" in found


@pytest.mark.parametrize(
    "text",
    [b"[" * 100_000, b'{"later":' + b"[" * 100_000, b'{"images":[{"uri":"\xff"}]}', b"NaN", b"[]", b'{"meshes":NaN}'],
)
def test_json_that_is_none(text: bytes) -> None:
    assert "damaged" in refused(GLB_JSON.close(MESH, text))
    with pytest.raises(CorruptTileError):
        texture_hashes(GLB_JSON.close(MESH, text), "mesh/x")


def test_the_header_is_believed_no_more_than_the_rest() -> None:
    for data in (
        b"",
        MESH[:19],
        MESH[:12] + struct.pack("<I", 2**32 - 1) + MESH[16:],
        MESH[:16] + b"BIN\0" + MESH[20:],
    ):
        assert "damaged" in refused(data)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["scenes"][0]["extras"]["farfield"]["instances"][0].update(objects=0),
        lambda d: d["scenes"][0]["extras"]["farfield"]["instances"][0].update(transforms=0),
        lambda d: d["scenes"][0]["extras"]["farfield"]["instances"][0].update(mesh="../x"),
        lambda d: d.update(scenes=[]),
    ],
)
def test_instances_that_cannot_be(change: Change) -> None:
    with pytest.raises(CorruptTileError):
        read_leaf_glb(changed(LEAF, change), "geometry/x", lambda _: WHITE)


def test_more_transforms_than_objects() -> None:
    def change(document: dict[str, Any]) -> None:
        listed = document["scenes"][0]["extras"]["farfield"]["instances"][0]
        document["accessors"][listed["objects"]]["count"] -= 1

    with pytest.raises(CorruptTileError, match="more transforms"):
        read_leaf_glb(changed(LEAF, change), "geometry/x", lambda _: WHITE)


def png(width: int, height: int) -> bytes:
    """A PNG that claims a size, with nothing in it."""
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks
    )


@pytest.mark.parametrize("size", [(8193, 1), (1, 60_000), (12_000, 12_000), (65_535, 65_535), (2**31 - 1, 1)])
def test_textures_that_claim_to_be_huge(size: tuple[int, int]) -> None:
    with pytest.raises(CorruptTileError):
        decode_texture(png(*size), "texture/x")


def test_textures_larger_than_any_that_is_written() -> None:
    stream = io.BytesIO()
    Image.new("L", (8193, 1)).save(stream, "PNG")
    with pytest.raises(CorruptTileError, match="8193 x 1"):
        decode_texture(stream.getvalue(), "texture/x")


def test_other_formats_are_no_textures() -> None:
    """Only those of the format: Pillow reads forty, some of them by starting other programs."""
    stream = io.BytesIO()
    Image.new("RGB", (3, 3)).save(stream, "BMP")
    with pytest.raises(CorruptTileError):
        decode_texture(stream.getvalue(), "texture/x")


@pytest.mark.parametrize("name", ["leaf", "mesh"])
def test_vectors_are_as_they_are_written_today(name: str) -> None:
    assert (NEAR / f"{name}.bin").read_bytes() == decoders()[name].corpus[1], "run scripts/write_near_vectors.py"
