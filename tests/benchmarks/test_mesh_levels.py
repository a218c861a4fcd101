"""What benchmarks/mesh_levels makes without npm packages: the cut link, tiles of instances, unique façades."""

from __future__ import annotations

import json
import struct
import sys
import threading
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from farfield.scene.footprints.prisms import Buildings, prism_mesh
from farfield.scene.footprints.rings import Rings
from farfield.scene.model import Mesh
from mesh_levels.cells import above
from mesh_levels.facades import GUTTER, TEXEL, WIDTH, packed, with_unique_facades
from mesh_levels.gate import Gate, served
from mesh_levels.glb import joined, placed, subset
from mesh_levels.i3dm import cmpt, i3dm


async def _kilobyte(scope: Scope, receive: Receive, send: Send) -> None:
    await Response(b"x" * 1000)(scope, receive, send)


def test_the_link_is_cut_in_the_middle_of_an_answer() -> None:
    gate = Gate(_kilobyte, lambda path: path.startswith("/counted"))
    with served(gate) as url:
        assert len(urllib.request.urlopen(f"{url}free").read()) == 1000
        assert gate.sent == 0
        gate.limit = 1400
        assert len(urllib.request.urlopen(f"{url}counted").read()) == 1000
        got: list[bytes] = []
        rest = threading.Thread(target=lambda: got.append(urllib.request.urlopen(f"{url}counted").read()))
        rest.start()
        rest.join(0.5)
        assert rest.is_alive()
        assert (gate.sent, gate.waiting) == (1400, 1)
        gate.limit = 5000
        rest.join(10)
        assert got == [b"x" * 1000]
        assert (gate.sent, gate.waiting) == (2000, 0)


def test_a_tile_of_instances_says_where_they_stand() -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    transforms = np.array([np.column_stack([2 * turn, [1.0, 2, 3]]), np.column_stack([np.eye(3), [4.0, 5, 6]])])
    raw = cmpt([i3dm("model.glb", transforms)])
    assert struct.unpack("<4s3I", raw[:16]) == (b"cmpt", 1, len(raw), 1)
    magic, _, length, head, binary, _, _, embedded = struct.unpack("<4s7I", raw[16:48])
    assert (magic, length, embedded) == (b"i3dm", len(raw) - 16, 0)
    table: dict[str, Any] = json.loads(raw[48 : 48 + head])
    body = raw[48 + head : 48 + head + binary]

    def values(name: str, width: int) -> list[list[float]]:
        found = np.frombuffer(body, np.float32, 2 * width, table[name]["byteOffset"])
        return found.reshape(2, width).tolist()

    assert values("POSITION", 3) == [[1, 2, 3], [4, 5, 6]]
    assert values("SCALE", 1) == [[2], [1]]
    assert values("NORMAL_RIGHT", 3) == [[0, 1, 0], [1, 0, 0]]
    assert values("NORMAL_UP", 3) == [[-1, 0, 0], [0, 1, 0]]
    assert raw[48 + head + binary :].decode().strip() == "model.glb"


@pytest.fixture
def prisms() -> Mesh:
    """Two houses of 12 x 9 m beside each other, 6 and 15 m high."""
    corners = np.array([[0, 0], [12, 0], [12, 9], [0, 9]], np.float32)
    xy = np.concatenate([corners, corners + (20, 0)]).astype(np.float32)
    rings = Rings(xy, np.array([0, 4, 8]), np.array([0, 1, 2]), np.array([0, 1]))
    heights = np.array([6, 15], np.float32)
    return prism_mesh(Buildings(rings, np.zeros(2, np.float32), heights, np.array([5, 6], np.uint32)), facades=True)


def test_every_wall_has_a_picture_of_its_own(prisms: Mesh) -> None:
    unique = with_unique_facades(prisms, seed=1)
    texture = unique.materials[1].texture
    assert texture is not None
    assert unique.uvs is not None
    walls = subset(unique, unique.triangle_material == 1)
    assert walls.uvs is not None
    size = texture.pixels.shape[1::-1]
    boxes = np.stack([walls.uvs.reshape(-1, 4, 2).min(1), walls.uvs.reshape(-1, 4, 2).max(1)], 1) * size
    assert len(boxes) == 8
    assert np.allclose(boxes[0, 1] - boxes[0, 0], (12 / TEXEL, 6 / TEXEL), atol=0.01)
    cut = [texture.pixels[round(y) : round(v), round(x) : round(u)] for (x, y), (u, v) in boxes]
    assert not any(np.array_equal(a, b) for k, a in enumerate(cut) for b in cut[:k])
    again = with_unique_facades(prisms, seed=1).materials[1].texture
    assert again is not None
    assert np.array_equal(again.pixels, texture.pixels)
    assert len(unique.triangles) == len(prisms.triangles)


def test_rectangles_of_an_atlas_do_not_meet() -> None:
    random = np.random.default_rng(0)
    atlas = packed(random.integers(1, 700, (40, 2)))
    taken = np.zeros((atlas.height, WIDTH), int)
    for (x, y), (width, height) in zip(atlas.corner, atlas.size, strict=True):
        assert min(x, y) >= GUTTER
        taken[y - GUTTER : y + height + GUTTER, x - GUTTER : x + width + GUTTER] += 1
    assert taken.max() == 1
    assert taken.sum() == (atlas.size + 2 * GUTTER).prod(1).sum()


def test_meshes_put_together_and_placed(prisms: Mesh) -> None:
    moved = placed(prisms, np.column_stack([2 * np.eye(3), [100.0, 0, 0]]))
    both = joined([prisms, moved])
    assert len(both.triangles) == 2 * len(prisms.triangles)
    assert len(both.materials) == len(prisms.materials)
    assert np.allclose(both.positions[len(prisms.positions) :], 2 * prisms.positions + (100, 0, 0))
    assert np.allclose(np.linalg.norm(moved.normals, axis=1), 1)


def test_cells_above() -> None:
    assert above([(0, 0), (1, 0), (2, 3)], 1) == {(0, 0): [(0, 0), (1, 0)], (1, 1): [(2, 3)]}
