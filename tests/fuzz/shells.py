"""Ways into a value: what lies inside is damaged, and lengths and checksums are made right around it.

Without them a checksum would refuse nearly every damaged value, and nothing behind it would ever be tried.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import DracoPy
import numpy as np

from farfield.packed import pack, unpack
from farfield.represent.geometry.dictionary import DICTIONARY
from farfield.represent.geometry.write import MAGIC
from farfield.represent.orthoview import container
from farfield.represent.orthoview.container import CODED, DEFLATE, WEBP, Plane


@dataclass(frozen=True, slots=True)
class Shell:
    """What surrounds a part of a value."""

    name: str
    open: Callable[[bytes], bytes | None]
    """The part of a valid value; None when it has none."""
    close: Callable[[bytes, bytes], bytes]
    """A valid value and what replaces its part: the value with it."""
    json: bool = False
    """The part is JSON: its nodes are damaged as well as its bytes."""


BARE = Shell("bare", lambda value: value, lambda _, part: part)
"""Nothing is made right: what accidents do."""
BARE_JSON = Shell("bare", lambda value: value, lambda _, part: part, json=True)


def deflated(content: bytes) -> bytes:
    """A deflate stream without header."""
    stream = zlib.compressobj(6, zlib.DEFLATED, -15)
    return stream.compress(content) + stream.flush()


def sealed(tile: bytes) -> bytes:
    """An orthoview or object tile with a right checksum."""
    if len(tile) < 40:
        return tile
    empty = tile[:36] + bytes(4) + tile[40:]
    return empty[:36] + struct.pack("<I", zlib.crc32(empty)) + empty[40:]


SEALED = Shell("sealed", lambda value: value, lambda _, part: sealed(part))


def plane(kind: int) -> Shell:
    """The content of one plane of a tile, as it is stored when it is coded or a picture."""

    def opened(tile: bytes) -> bytes | None:
        found = container.unpack(tile, tile[:4], "")[1].get(kind)
        if found is None or found.codec in (WEBP, CODED):
            return None if found is None else found.stored
        return zlib.decompress(found.stored, -15) if found.codec == DEFLATE else found.stored

    def close(tile: bytes, part: bytes) -> bytes:
        codec = container.unpack(tile, tile[:4], "")[1][kind].codec
        if codec in (WEBP, CODED):
            return _with_plane(tile, Plane(kind, codec, part))
        return _with_plane(tile, Plane(kind, DEFLATE, deflated(part)))

    return Shell(f"plane {kind}", opened, close)


def _with_plane(tile: bytes, plane: Plane) -> bytes:
    header, planes = container.unpack(tile, tile[:4], "")
    return container.pack(tile[:4], header, list((planes | {plane.kind: plane}).values()))


def tables(kind: int) -> Shell:
    """The tables of one coded plane of a tile."""

    def opened(tile: bytes) -> bytes | None:
        found = container.unpack(tile, tile[:4], "")[1].get(kind)
        if found is None or found.codec != CODED:
            return None
        return zlib.decompress(found.stored[4 : 4 + int.from_bytes(found.stored[:2], "little")], -15)

    def close(tile: bytes, part: bytes) -> bytes:
        stored = container.unpack(tile, tile[:4], "")[1][kind].stored
        stream = stored[4 + int.from_bytes(stored[:2], "little") :]
        packed, told = deflated(part)[:65535], min(len(part), 65535)
        return _with_plane(tile, Plane(kind, CODED, struct.pack("<HH", len(packed), told) + packed + stream))

    return Shell(f"tables {kind}", opened, close)


def _index_close(tile: bytes, text: bytes) -> bytes:
    return tile[:8] + struct.pack("<II", len(text), zlib.crc32(text)) + deflated(text)


INDEX_TEXT = Shell("text", lambda tile: zlib.decompress(tile[16:], -15), _index_close, json=True)


def _header_closed(_: bytes, part: bytes) -> bytes:
    return part[:-4] + struct.pack("<I", zlib.crc32(part[:-4]))


HEADER = Shell("header", lambda header: header, _header_closed)


def _directory_close(block: bytes, columns: bytes) -> bytes:
    return struct.pack("<I", len(columns)) + block[4:8] + deflated(columns)


DIRECTORY_COLUMNS = Shell("columns", lambda block: zlib.decompress(block[8:], -15), _directory_close)


def unpacked_glb(packed: bytes) -> bytes:
    """The GLB of a packed value of near geometry."""
    return unpack(packed, MAGIC, 1 << 20, "near geometry", "", dictionary=DICTIONARY)


def _chunks(glb: bytes) -> tuple[bytes, bytes]:
    """JSON and body of a GLB, plain or packed."""
    if glb[:4] == MAGIC:
        glb = unpacked_glb(glb)
    (length,) = struct.unpack_from("<I", glb, 12)
    return glb[20 : 20 + length], glb[28 + length :]


def _glb(text: bytes, body: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


GLB_JSON = Shell("json", lambda glb: _chunks(glb)[0], lambda glb, part: _glb(part, _chunks(glb)[1]), json=True)
GLB_BODY = Shell("body", lambda glb: _chunks(glb)[1], lambda glb, part: _glb(_chunks(glb)[0], part))


def _packed_close(_: bytes, glb: bytes) -> bytes:
    return pack(MAGIC, glb, dictionary=DICTIONARY)


PACKED = Shell("packed", lambda value: unpacked_glb(value) if value[:4] == MAGIC else None, _packed_close)


def _stream_close(value: bytes, stream: bytes) -> bytes:
    """With length and checksum of what comes out of the stream, if anything does."""
    try:
        content = zlib.decompressobj(-15, zdict=DICTIONARY).decompress(stream, 1 << 20)
    except zlib.error:
        return value[:16] + stream
    return value[:8] + struct.pack("<II", len(content), zlib.crc32(content)) + stream


PACKED_STREAM = Shell("stream", lambda value: value[16:] if value[:6] == MAGIC + b"\2\0" else None, _stream_close)


def plain_glb(packed: bytes) -> bytes:
    """A value of near geometry as it was before there was compression: its GLB, with the attributes as they are."""
    text, body = _chunks(packed)
    document = json.loads(text)
    del document["extensionsUsed"], document["extensionsRequired"]
    rows = [
        (accessor, None if (view := accessor.pop("bufferView", None)) is None else _view(document, body, view))
        for accessor in document["accessors"]
    ]
    for primitive in document["meshes"][0]["primitives"]:
        draco = primitive.pop("extensions")["KHR_draco_mesh_compression"]
        mesh = DracoPy.decode(_view(document, body, draco["bufferView"]))
        stored = {one["unique_id"]: one["data"] for one in mesh.attributes}
        for name, number in draco["attributes"].items():
            accessor, _ = rows[primitive["attributes"][name]]
            values = stored[number]
            if name == "NORMAL":
                accessor["componentType"], values = (
                    5120,
                    np.pad(np.round(values * 127).astype(np.int8), ((0, 0), (0, 1))),
                )
            elif name == "_FEATURE_ID_0":
                accessor["componentType"], values = 5126, values.astype(np.float32)
            elif name == "COLOR_0":
                values = values.astype(np.uint16)
            rows[primitive["attributes"][name]] = accessor, values.tobytes()
        rows[primitive["indices"]] = rows[primitive["indices"]][0], np.asarray(mesh.faces, np.uint32).tobytes()
    views, at = [], bytearray()
    for n, (accessor, data) in enumerate(rows):
        accessor["bufferView"] = n
        views.append({"buffer": 0, "byteOffset": len(at), "byteLength": len(data or b"")})
        if accessor["componentType"] == 5120:
            views[-1]["byteStride"] = 4
        at += data or b""
    document |= {"bufferViews": views, "buffers": [{"byteLength": len(at)}]}
    return _glb(json.dumps(document).encode(), bytes(at))


def _view(document: Any, body: bytes, index: int) -> bytes:
    view = document["bufferViews"][index]
    start = view.get("byteOffset", 0)
    return body[start : start + view["byteLength"]]


def _png_sealed(data: bytes) -> bytes:
    """A PNG with the right checksum behind every chunk that can be found."""
    fixed, at = bytearray(data), 8
    while at + 12 <= len(fixed):
        end = at + 8 + int.from_bytes(fixed[at : at + 4], "big")
        if end + 4 > len(fixed):
            break
        fixed[end : end + 4] = zlib.crc32(fixed[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(fixed)


PNG = Shell("png", lambda data: data if data[1:4] == b"PNG" else None, lambda _, part: _png_sealed(part))


def _sealed_chunk(head: bytes, text: bytes, body: bytes) -> bytes:
    """A scene chunk whose lengths and checksum are right."""
    text += b" " * (-(len(text) + 16) % 8)
    return head[:8] + struct.pack("<II", len(text), zlib.crc32(text + body)) + text + body


def _chunk_parts(chunk: bytes) -> tuple[bytes, bytes]:
    """Listing and arrays."""
    (length,) = struct.unpack_from("<I", chunk, 8)
    return chunk[16 : 16 + length], chunk[16 + length :]


CHUNK_JSON = Shell(
    "listing", lambda c: _chunk_parts(c)[0], lambda c, part: _sealed_chunk(c, part, _chunk_parts(c)[1]), json=True
)
CHUNK_BODY = Shell("arrays", lambda c: _chunk_parts(c)[1], lambda c, part: _sealed_chunk(c, _chunk_parts(c)[0], part))


def blockmap_stream(number: int) -> Shell:
    """The content of a stream of a BlockMap: heights, slopes, turns."""

    def ends(value: bytes) -> tuple[int, int]:
        lengths = struct.unpack_from("<III", value, 24)
        return 40 + sum(lengths[:number]), 40 + sum(lengths[: number + 1])

    def opened(value: bytes) -> bytes | None:
        first, end = ends(value)
        return zlib.decompress(value[first:end], -15) if end > first else None

    def close(value: bytes, part: bytes) -> bytes:
        (first, end), stream, at = ends(value), deflated(part), 24 + 4 * number
        head = value[:at] + struct.pack("<I", len(stream)) + value[at + 4 : first]
        return sealed(head + stream + value[end:])

    return Shell(f"stream {number}", opened, close)


def _objects_sealed(_: bytes, part: bytes) -> bytes:
    checksum = struct.pack("<I", zlib.crc32(part[:12] + bytes(4) + part[16:]))
    return part if len(part) < 16 else part[:12] + checksum + part[16:]


BLOCKMAP_OBJECTS = Shell("sealed", lambda value: value, _objects_sealed)
BLOCKMAP_OBJECTS_STREAM = Shell(
    "stream",
    lambda value: zlib.decompress(value[16:], -15),
    lambda value, part: _objects_sealed(value, value[:16] + deflated(part)),
)
