"""Instances in 3D Tiles: i3dm tiles that name their model by address, several of them in one cmpt tile."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def i3dm(model: str, transforms: NDArray[np.float64]) -> bytes:
    """A tile of (n, 3, 4) placements, turned and evenly scaled, of the glTF at an address relative to the tile."""
    turn = transforms[:, :, :3]
    scale = np.cbrt(np.linalg.det(turn))
    turn = turn / scale[:, None, None]
    arrays = {
        "POSITION": transforms[:, :, 3],
        "NORMAL_UP": turn[:, :, 1],
        "NORMAL_RIGHT": turn[:, :, 0],
        "SCALE": scale[:, None],
    }
    table: dict[str, object] = {"INSTANCES_LENGTH": len(transforms)}
    binary = b""
    for name, values in arrays.items():
        table[name] = {"byteOffset": len(binary)}
        binary += np.ascontiguousarray(values, np.float32).tobytes()
    head = json.dumps(table, separators=(",", ":")).encode()
    # Both parts of the feature table begin on 8 bytes; the head before them takes 32.
    head += b" " * (-len(head) % 8)
    binary += b"\0" * (-len(binary) % 8)
    address = model.encode()
    address += b" " * (-len(address) % 8)
    body = head + binary + address
    return struct.pack("<4s7I", b"i3dm", 1, 32 + len(body), len(head), len(binary), 0, 0, 0) + body


def cmpt(tiles: Sequence[bytes]) -> bytes:
    """Several tiles as one."""
    body = b"".join(tiles)
    return struct.pack("<4s3I", b"cmpt", 1, 16 + len(body), len(tiles)) + body
