"""Values made to take as much memory as they can: the bounds that are stated hold for them too."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator

import pytest
from PIL import Image

from farfield.represent.orthoview.planes import DEPTH
from farfield.represent.orthoview.quality import quality
from farfield.represent.orthoview.tile import encode_tile
from farfield.world.manifest import KEY
from fuzz.apart import Apart
from fuzz.decoders import decoders, golden
from fuzz.judge import Outcome
from fuzz.shells import (
    BLOCKMAP_OBJECTS_STREAM,
    GLB_BODY,
    GLB_JSON,
    INDEX_TEXT,
    blockmap_stream,
    plane,
    sealed,
)
from represent.random_layers import random_layer

COUNT = 4000
HASH = "0" * 16


def index(**members: object) -> bytes:
    """An index tile of many cells, with as little text for each as will do."""
    cells = [{"key": f"0/{n}/0/0", "bounds": [[0] * 3] * 2, "error": 0, **members} for n in range(COUNT)]
    text = json.dumps({"root": "0/0/0/0", "cells": cells}, separators=(",", ":")).encode()
    return INDEX_TEXT.close(decoders()["index"].corpus[0], text)


def manifest(text: str) -> bytes:
    """The golden one with a member more."""
    return golden()[KEY].rstrip()[:-1] + f",{text}}}".encode()


def with_json(glb: bytes, **members: object) -> bytes:
    document = json.loads(GLB_JSON.open(glb) or b"")
    return GLB_JSON.close(glb, json.dumps({**document, **members}, separators=(",", ":")).encode())


def many_primitives(vertices: int) -> bytes:
    """A GLB of as many primitives as there can be in so many bytes, with bytes of their own or none."""
    sizes = {"VEC3": (5126, 12), "NORMAL": (5120, 3), "ID": (5126, 4), "INDEX": (5123, 2)}
    counts = {"VEC3": vertices, "NORMAL": vertices, "ID": vertices, "INDEX": 3 * (vertices > 0)}
    accessors, views, primitives, at = [], [], [], 0
    for n in range(COUNT // 4):
        for name, (component, size) in sizes.items():
            kind = "VEC3" if name in ("VEC3", "NORMAL") else "SCALAR"
            accessors.append(
                {"bufferView": len(views), "componentType": component, "count": counts[name], "type": kind}
            )
            views.append({"byteOffset": at, "byteLength": counts[name] * size})
            at += counts[name] * size
        attributes = {"POSITION": 4 * n, "NORMAL": 4 * n + 1, "_FEATURE_ID_0": 4 * n + 2}
        primitives.append({"attributes": attributes, "indices": 4 * n + 3, "material": 0})
    surface = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]}}
    document = {"accessors": accessors, "bufferViews": views, "meshes": [{"primitives": primitives}]}
    text = json.dumps({**document, "materials": [surface]}, separators=(",", ":")).encode()
    return GLB_BODY.close(GLB_JSON.close(golden_mesh(), text), bytes(at))


def golden_mesh() -> bytes:
    return decoders()["mesh"].corpus[0]


def picture(mode: str, form: str = "PNG") -> bytes:
    stream = io.BytesIO()
    Image.new(mode, (700, 700)).save(stream, form)
    return stream.getvalue()


def with_picture(blockmap: bytes, side: int) -> bytes:
    """With a picture of another size."""
    end = 40 + sum(struct.unpack_from("<III", blockmap, 24))
    stream = io.BytesIO()
    Image.new("RGB", (side, side)).save(stream, "WEBP")
    return sealed(blockmap[:end] + stream.getvalue())


def values() -> Iterator[tuple[str, str, bytes]]:
    """Decoder, what it is, and the value."""
    yield "index", "cells", index()
    yield "index", "views", index(views=[[1]] * 26)
    yield "index", "tiles", index(tiles=[[0, 0, 0]] * 60)
    yield "index", "geometry", index(geometry={"hash": HASH, "bytes": 0, "meshes": [[HASH, 0]] * 9})
    yield "index", "zeros", INDEX_TEXT.close(decoders()["index"].corpus[0], bytes(4 << 20))
    yield "index", "a bomb", decoders()["index"].corpus[0][:8] + struct.pack("<II", 0, 0) + INDEX_TEXT.close(
        decoders()["index"].corpus[0], bytes(64 << 20)
    )[16:]  # fmt: skip
    yield "manifest", "lists", manifest('"format":[' + ",".join(["[]"] * COUNT) + "]")
    yield "manifest", "objects", manifest('"version":[' + ",".join(['{"":0}'] * COUNT) + "]")
    yield "manifest", "strings", manifest('"credits":[' + ",".join(['"ab"'] * COUNT) + "]")
    yield "keys", "strings", ("[" + ",".join(['"ab"'] * COUNT) + "]").encode()
    yield (
        "mesh",
        "materials",
        with_json(golden_mesh(), materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1] * 4}}] * COUNT),
    )
    yield "mesh", "extensions", with_json(golden_mesh(), materials=[
        {"pbrMetallicRoughness": {"baseColorFactor": [1] * 4}, "extensions": {str(n): 0 for n in range(COUNT)}}
    ])  # fmt: skip
    yield "mesh", "accessors", with_json(golden_mesh(), accessors=[
        {"bufferView": 0, "componentType": 5126, "count": 0, "type": "VEC3"}
    ] * COUNT)  # fmt: skip
    shared = json.loads(GLB_JSON.open(golden_mesh()) or b"")["meshes"][0]["primitives"] * COUNT
    yield "mesh", "shared accessors", with_json(golden_mesh(), meshes=[{"primitives": shared}])
    yield "mesh", "empty primitives", many_primitives(0)
    yield "mesh", "primitives", many_primitives(30)
    yield "mesh", "large primitives", many_primitives(400)
    yield "texture", "one bit", picture("1")
    yield "texture", "palette", picture("P")
    yield "texture", "16 bits", picture("I;16")
    yield "texture", "grey and alpha", picture("LA")
    yield "texture", "JPEG", picture("CMYK", "JPEG")
    yield "orthoview", "large", encode_tile(random_layer(5, 400, 400), 0, 0, 0, quality("normal"))
    yield "blockmap", "a bomb", blockmap_stream(0).close(decoders()["blockmap"].corpus[0], bytes(64 << 20))
    yield "blockmap", "a large picture", with_picture(decoders()["blockmap"].corpus[0], 4000)
    yield (
        "blockmap_objects",
        "a bomb",
        BLOCKMAP_OBJECTS_STREAM.close(decoders()["blockmap_objects"].corpus[0], bytes(64 << 20)),
    )
    small, depth = encode_tile(random_layer(5, 2, 2), 0, 0, 0, quality("normal")), plane(DEPTH)
    yield "orthoview", "long plane", depth.close(small, (depth.open(small) or b"") + bytes(1 << 20))


VALUES = {f"{decoder}: {what}": (decoder, value) for decoder, what, value in values()}


@pytest.mark.parametrize("name", VALUES)
def test_memory_stays_within_its_bound(apart: Apart, name: str) -> None:
    decoder, value = VALUES[name]
    found = apart.judge(decoder, value, seconds=20.0)
    assert isinstance(found, Outcome), str(found)
