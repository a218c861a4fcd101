"""Writes tests/vectors/servers: keys and the servers that have them, for Python and TypeScript to agree on.

Run from a clone: python scripts/write_server_vectors.py
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from farfield.octree.grid import CellKey, Grid
from farfield.world import keys
from farfield.world.servers import RULE, ServersRecord, is_address

FOLDER = Path(__file__).parent.parent / "tests/vectors/servers"
GRIDS = {
    "flat": (Grid(8.0, 64, (0.0, 0.0, 0.0), (6, 6, 1)), 2, 3),
    "deep": (Grid(0.5, 512, (-3.25, 1.0, 0.0), (9, 8, 10)), 4, 7),
    "leaves": (Grid(16.0, 16, (0.0, 0.0, 0.0), (3, 3, 0)), 0, 2),
    "alone": (Grid(1.0, 16, (0.0, 0.0, 0.0), (40, 40, 40)), 40, 1),
}
"""Name → grid, level of the rule, number of servers."""

ELSEWHERE = [
    "world.json", "index.html", "viewer/app.js", "record/order.json", "record/chunk/0123456789abcdef", "mesh", "mesh/",
    "mesh/0123456789abcde", "mesh/0123456789ABCDEF", "texture/0123456789abcdef0", "geometry/0/0/0", "geometry/0/0/0/",
    "geometry/00/0/0/0-aa", "geometry/0/-0/0/0-aa", "index/41/0/0/0-aa", "index/0/9999999999999/0/0-aa", "/0/0/0/0-aa",
    "Index/0/0/0/0-aa", "index/0/0/0/0-",
]  # fmt: skip
"""Keys of no cell and without a hash of their own."""

ADDRESSES = [
    "https://a.example.org/", "http://a.example.org/city/", "https://a.example.org:8443/maps/city.2/", "https://a/",
    "http://127.0.0.1:8001/", "http://[::1]:8001/city/", "https://a.example.org/~maps/", "./", "b/", "../b/",
    "../b-2.c/", "", "/", "..", "../", ".", "b", "../b", "../../b/", "b/c/", "../b/c/", "b/../c/", "b//",
    "//a.example.org/", "/etc/", "../.ssh/", ".ssh/", "../../etc/", "~/", "file:///etc/", "ftp://a.example.org/",
    "s3://bucket/", "javascript:alert(1)/", "https://", "https:///", "https://a.example.org",
    "https://a.example.org/b", "https://user@a.example.org/", "https://user:secret@a.example.org/",
    "https://a.example.org/?key=", "https://a.example.org/#/", "https://a.example.org/../b/",
    "https://a.example.org/./", "https://a.example.org//", "https://a.example.org/%2e%2e/",
    "https://a.example.org/b c/", "https://a.example.org\\b/", "HTTPS://A.EXAMPLE.ORG/", "https://a.example.org/\n",
    "b/\n", " b/", "b\u0000/", "\u00fc/", "https://\u00fc.example.org/", "https://a.example.org:/",
    "https://a.example.org:123456/", "https://-a/", "https://a./", "https://" + "a" * 240 + "/",
    "https://" + "a" * 247 + "/", "https://" + "a" * 248 + "/", "b" * 200 + "/", "b" * 201 + "/",
]  # fmt: skip


def keys_of(grid: Grid, random: np.random.Generator) -> list[str]:
    """Keys of every kind, of cells on both sides of 0 and of all levels."""
    made = []
    for level in (*range(min(grid.top_level, 6) + 1), grid.top_level):
        for _ in range(8):
            x, y, z = (int(v) for v in random.integers(-200 >> level, (200 >> level) + 1, 3))
            cell, name = CellKey(level, x, y, z), random.bytes(8).hex()
            direction, layer = int(random.integers(26)), int(random.integers(2))
            made += [
                keys.index_key(cell, name),
                keys.orthoview_key(cell, direction, layer, name),
                keys.objects_key(cell, direction, layer, name),
                keys.geometry_key(cell, name),
                keys.record_key(cell),
            ]
    for kind in ("mesh", "texture", "attributes"):
        made += [f"{kind}/{random.bytes(8).hex()}" for _ in range(6)]
    return made


def written() -> dict[str, str]:
    """File name → its text."""
    random = np.random.default_rng(20)
    files = {}
    for name, (grid, level, count) in GRIDS.items():
        servers = ServersRecord(RULE, level, tuple(f"../{number}/" for number in range(count)))
        listed = [*keys_of(grid, random), *ELSEWHERE]
        content = {
            "grid": {
                "leaf_size": grid.leaf_size,
                "resolution": grid.resolution,
                "corner": grid.corner,
                "axis_levels": grid.axis_levels,
            },
            "servers": {"rule": servers.rule, "level": level, "addresses": servers.addresses},
            "keys": [[key, servers.server_of(key, grid)] for key in listed],
        }
        files[f"{name}.json"] = _text(content)
    files["addresses.json"] = _text([[address, is_address(address)] for address in ADDRESSES])
    return files


def _text(content: object) -> str:
    return json.dumps(content, separators=(",", ":")).replace("],[", "],\n[") + "\n"


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file_name, text in written().items():
        (FOLDER / file_name).write_text(text)
        print(FOLDER / file_name, len(text))
