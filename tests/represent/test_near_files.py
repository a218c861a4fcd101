"""GLBs of near geometry: what they cost besides their triangles, and what their numbers tell."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh

from farfield.geometry.color import srgb_from_linear
from farfield.octree.grid import CellKey
from farfield.packed import pack, unpack
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.geometry import write
from farfield.represent.geometry.dictionary import DICTIONARY
from farfield.represent.geometry.read import read_leaf_glb, read_mesh_glb
from farfield.represent.geometry.write import MAGIC, PlacedMesh, leaf_glb, mesh_glb
from farfield.scene.model import Material, Mesh, Texture
from represent.shapes import mesh_of, rectangle

HASH = "0123456789abcdef"
STONE = Material("", (0.48984138811928646, 0.47514614647570785, 0.0440857249307358, 1.0))
WHITE = Texture(np.full((64, 64, 4), 255, np.uint8))
GRASS = Material("", texture=WHITE)


def ball(subdivisions: int) -> Chunk:
    shape = trimesh.creation.icosphere(subdivisions, radius=1.2)
    shape.apply_translation([0.3141, -0.2718, 1.4142])
    return Chunk.whole(BlockedMesh.from_mesh(mesh_of(shape)))


def ground() -> Chunk:
    flat = rectangle(np.array([0.0, 0, 3.3]), np.array([64.0, 0, 0]), np.array([0, 64.0, 0]))
    uvs = (flat.positions[:, :2] / 8).astype(np.float32)
    textured = Mesh(flat.positions, flat.triangles, flat.normals, flat.materials, flat.triangle_material, uvs=uvs)
    return Chunk.whole(BlockedMesh.from_mesh(textured))


def glb_of(value: bytes) -> tuple[dict[str, Any], bytes, bytes]:
    """(JSON, all before the body, the body)."""
    glb = unpack(value, MAGIC, 1 << 20, "near geometry", "", dictionary=DICTIONARY)
    (length,) = struct.unpack_from("<I", glb, 12)
    return json.loads(glb[20 : 20 + length]), glb[: 20 + length], glb[20 + length :]


def cost(value: bytes) -> int:
    """Bytes of everything before the body."""
    return len(pack(MAGIC, glb_of(value)[1], dictionary=DICTIONARY)) - len(pack(MAGIC, b""))


@pytest.mark.parametrize("subdivisions", [0, 1, 2])
def test_the_json_of_a_mesh_costs_less_than_a_hundred_bytes(subdivisions: int) -> None:
    value = mesh_glb(ball(subdivisions), 2e-3, [STONE], lambda _: HASH)
    assert cost(value) < 100
    assert len(value) < 16 + 100 + len(glb_of(value)[2])


def test_the_json_of_a_leaf_costs_little_more_for_what_it_places() -> None:
    key, turn = CellKey(0, 12, -3, 1), np.eye(3, 4)[None]
    placed = [PlacedMesh(name * 8, turn + n, np.array([n], np.uint32)) for n, name in enumerate(("1a", "7c"))]
    bare = leaf_glb(key, 64.0, ground(), [GRASS], [], lambda _: "9d0e1f2c3b4a5867")
    both = leaf_glb(key, 64.0, ground(), [GRASS], placed, lambda _: "9d0e1f2c3b4a5867")
    assert cost(bare) < 100
    assert cost(both) < 140
    read = read_leaf_glb(both, "", lambda _: WHITE)
    assert [(p.mesh, p.transforms[0, 0, 3]) for p in read.placed] == [("1a" * 8, 0), ("7c" * 8, 1)]


def test_bounds_are_of_few_digits_and_hold_all_positions() -> None:
    for step in (1e-4, 3e-3, 0.05, 20.0):
        value = mesh_glb(ball(2), step, [STONE], lambda _: HASH)
        positions = read_mesh_glb(value, "", lambda _: WHITE).positions
        facts = glb_of(value)[0]["accessors"][0]
        for told, found in ((facts["min"], positions.min(axis=0)), (facts["max"], positions.max(axis=0))):
            apart = (found - told) * (1 if told is facts["min"] else -1)
            assert (apart >= -1e-6).all()
            assert (apart < 10 * step).all()
        assert len(json.dumps(facts["min"], separators=(",", ":"))) < 26


def test_colours_are_told_to_a_quarter_of_a_step() -> None:
    read = read_mesh_glb(mesh_glb(ball(0), 1e-3, [STONE], lambda _: HASH), "", lambda _: WHITE)
    found, told = (srgb_from_linear(np.array(m.base_color[:3])) * 255 for m in (read.materials[0], STONE))
    assert np.abs(found - told).max() < 0.25
    assert found.tolist() != told.tolist()


def test_normals_of_fewer_bits_take_less_and_are_nearly_the_same() -> None:
    fine, coarse = (mesh_glb(ball(2), 1e-3, [STONE], lambda _: HASH, normal_bits=bits) for bits in (8, 6))
    assert len(coarse) < len(fine)
    for value, degrees in ((fine, 1.0), (coarse, 3.5)):
        mesh = read_mesh_glb(value, "", lambda _: WHITE)
        outward = mesh.positions - [0.3141, -0.2718, 1.4142]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        assert np.degrees(np.arccos((mesh.normals * outward).sum(axis=1).clip(-1, 1))).max() < degrees


def test_many_triangles_of_a_material_are_several_primitives(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the same triangles: compressed in one piece they take Draco minutes."""

    def read(most: int) -> tuple[int, Chunk]:
        monkeypatch.setattr(write, "MOST_TRIANGLES", most)
        value = leaf_glb(CellKey(0, 0, 0, 0), 64.0, ball(2), [STONE], [], lambda _: HASH)
        mesh = read_leaf_glb(value, "", lambda _: WHITE).mesh
        assert mesh is not None
        return len(glb_of(value)[0]["meshes"][0]["primitives"]), mesh

    (one, whole), (several, pieces) = read(1 << 17), read(100)
    assert (one, several) == (1, -(-len(whole.triangles) // 100))
    found, others = ({frozenset(map(tuple, m.positions[t].tolist())) for t in m.triangles} for m in (whole, pieces))
    assert found == others
