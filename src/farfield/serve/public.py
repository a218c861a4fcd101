"""Which keys of a world the public may read, how long each may be cached, and what it is."""

from __future__ import annotations

import re
from hashlib import blake2b

from farfield.store.keys import is_key

MANIFEST = "world.json"

BROWSER_YEAR = "public, max-age=31536000, immutable"
"""For values whose name carries their hash: they never change."""

BROWSER_ASKS = "no-cache"
"""For the rest: may be kept, but the server is asked each time whether it still holds."""

_HASHED = re.compile(r"(?:.*[/-])?[0-9a-f]{16}")

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".map": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".wasm": "application/wasm",
    ".woff2": "font/woff2",
    ".txt": "text/plain; charset=utf-8",
}

_FOLDER_TYPES = {"attributes": "application/json"}

OCTETS = "application/octet-stream"


def tag_of(value: bytes) -> str:
    """16 hexadecimal digits that tell a value whose name has no hash from every other."""
    return blake2b(value, digest_size=8).hexdigest()


def is_permanent(key: str) -> bool:
    """Whether the key ends in a hash, so that its value never changes."""
    return _HASHED.fullmatch(key) is not None


def is_page_key(key: str) -> bool:
    """Whether the key belongs to the viewer and not to the world."""
    return is_key(key) and (key == "index.html" or key.startswith("viewer/"))


def is_world_key(key: str) -> bool:
    """Whether the key is one that readers of a world need: the manifest, or what carries a hash.

    The bake's records carry none, and neither does anything that somebody else put into the folder.
    """
    return is_key(key) and (key == MANIFEST or (is_permanent(key) and not key.startswith("record/")))


def cache_control(key: str) -> str:
    """The Cache-Control of a key's value."""
    return BROWSER_YEAR if is_permanent(key) else BROWSER_ASKS


def content_type(key: str, head: bytes) -> str:
    """The Content-Type of a key's value, of which `head` are the first 12 bytes or more."""
    folder, slash, _ = key.partition("/")
    if slash and folder in _FOLDER_TYPES:
        return _FOLDER_TYPES[folder]
    if folder == "texture":
        return _image_type(head)
    return OCTETS if is_permanent(key) else _TYPES.get(key[key.rfind(".") :], OCTETS)


def is_compressible(kind: str) -> bool:
    """Whether values of this Content-Type get smaller by gzip; everything else is packed already."""
    return kind.startswith("text/") or kind in ("application/json", "application/wasm", "image/svg+xml")


def _image_type(head: bytes) -> str:
    """Only what a browser can do no harm with: anything else stays opaque."""
    if head.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if head.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "image/webp"
    return OCTETS
