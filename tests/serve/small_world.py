"""The values of a small world, enough for a server, and of a small page."""

from __future__ import annotations

import json

from farfield.store import Store

TILE = "orthoview/3/-1/0/-12/17/0-0123456789abcdef"
BIG = "mesh/00000000000000ff"
PNG = "texture/00000000000000aa"
MANIFEST = json.dumps({"format": "farfield-world", "padding": "x" * 2000}).encode()

VALUES = {
    "world.json": MANIFEST,
    TILE: bytes(range(256)) * 10,
    BIG: bytes(range(251)) * 4000,
    PNG: b"\x89PNG\r\n\x1a\n" + b"x" * 100,
    "texture/00000000000000bb": b"<svg onload='alert(1)'/>",
    "geometry/0/-1/0/0-1111111111111111": b"glTF",
    "index/3/-1/0/0-2222222222222222": b"FFIX",
    "attributes/3333333333333333": b'{"height": [1, 2]}' * 100,
    "record/0/-1/0/0": b"private",
    "notes.txt": b"private too",
}

PAGE = {
    "index.html": b"<!doctype html><title>farfield</title>",
    "viewer/app.js": b"console.log(1)" * 100,
    "viewer/draco/decoder.wasm": b"\0asm" * 300,
}


def filled(store: Store, values: dict[str, bytes]) -> Store:
    for key, value in values.items():
        store.put(key, value)
    return store
