"""What the orthoviews of a world take: bytes of a valid pixel, and the paper's ratio to geometry."""

from __future__ import annotations

from farfield.represent.orthoview import container
from farfield.represent.orthoview.tile import MAGIC
from farfield.world.keys import orthoview_key
from farfield.world.world import World

BYTES_A_TRIANGLE = 28
"""Of the paper's objects scene (OV 6, Table 1); its landscape has 38."""


def orthoview_storage(world: World, bytes_a_triangle: int = BYTES_A_TRIANGLE) -> dict[str, float]:
    """orthoview_bytes; bytes_per_valid_pixel; storage_ratio: to the triangles as the paper counts them."""
    pixels = size = 0
    for entry in world.cells():
        for direction, layer, _ in entry.tiles:
            key = orthoview_key(entry.cell, direction, layer, entry.hash)
            data = world.store.get(key)
            pixels += container.unpack(data, MAGIC, key)[0].valid
            size += len(data)
    triangles = world.manifest.statistics.triangles
    return {
        "orthoview_bytes": size,
        "bytes_per_valid_pixel": round(size / pixels, 3),
        "storage_ratio": round(size / (triangles * bytes_a_triangle), 4),
    }
