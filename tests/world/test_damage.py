"""What the fuzzing of index tiles, manifests and records found, and what it cannot find: walks that never end."""

from __future__ import annotations

import json
import struct
import zlib
from itertools import islice
from typing import Any

import pytest

from farfield.bake.cell import decode_record, read_record
from farfield.errors import CorruptTileError, InputError, NotAWorldError, VersionError
from farfield.octree.grid import CellKey
from farfield.store import MemoryStore
from farfield.view.path import read_path
from farfield.world.index import decode_index
from farfield.world.keys import content_hash, index_key
from farfield.world.manifest import KEY, decode_manifest
from farfield.world.verification import verify_world
from farfield.world.world import World
from fuzz.decoders import golden
from fuzz.shells import INDEX_TEXT, deflated

HASH = "0123456789abcdef"
DEEP = b"[" * 100_000


def index_tile(root: str, cells: list[dict[str, Any]]) -> bytes:
    """An index tile of cells that have bounds and an error, and what is given."""
    entries = [{"bounds": [[0, 0, 0], [1, 1, 1]], "error": 1, **cell} for cell in cells]
    text = json.dumps({"root": root, "cells": entries}).encode()
    return INDEX_TEXT.close(b"FFIX\x01\0\0\0", text)


def manifest(**members: Any) -> bytes:
    return json.dumps({**json.loads(golden()[KEY]), **members}).encode()


def world_of(levels: int, cells: list[dict[str, Any]]) -> World:
    """A world with one index tile below the root 0, 0, 0."""
    store, root = MemoryStore(), f"{levels}/0/0/0"
    data = index_tile(root, cells)
    name = content_hash(data)
    store.put(index_key(CellKey.parse(root), name), data)
    grid = {"leaf_size": 1.0, "resolution": 16, "corner": [0, 0, 0], "axis_levels": [levels] * 3}
    facts = {"grid": grid, "roots": [{"key": root, "hash": name}], "index_depth": 16, "attributes": None}
    store.put(KEY, manifest(**facts))
    return World.open(store)


def test_an_index_of_no_length_is_not_inflated_without_limit() -> None:
    """zlib takes a limit of 0 for none."""
    bomb = struct.pack("<4sHHII", b"FFIX", 1, 0, 0, zlib.crc32(b"")) + deflated(bytes(64 << 20))
    with pytest.raises(CorruptTileError, match="damaged"):
        decode_index(bomb, "index")


@pytest.mark.parametrize(
    "text",
    [DEEP, b'{"root":' + DEEP, b'{"root":"\xff"}', b'{"later":' + DEEP, b'{"root":"\\ud800"}', b"\xff\xfe{\0}\0"],
)
def test_text_that_is_none(text: bytes) -> None:
    with pytest.raises(CorruptTileError):
        decode_index(INDEX_TEXT.close(b"FFIX\x01\0\0\0", text), "index")
    with pytest.raises(NotAWorldError):
        decode_manifest(text)
    with pytest.raises(CorruptTileError):
        decode_record(text, CellKey(0, 0, 0, 0))


def test_bytes_behind_the_index_and_reserved_ones() -> None:
    good = index_tile("0/0/0/0", [{"key": "0/0/0/0"}])
    assert decode_index(good, "index").cells[0].cell == CellKey(0, 0, 0, 0)
    for bad in (good + b"x", good[:6] + b"\1" + good[7:]):
        with pytest.raises(CorruptTileError):
            decode_index(bad, "index")


@pytest.mark.parametrize(
    "cell",
    [
        {"key": "1/0/0"},
        {"key": "1/0/0/99999999999999999999"},
        {"key": "99/0/0/0"},
        {"key": "1/0/0/0", "bounds": [[1, 0, 0], [0, 1, 1]]},
        {"key": "1/0/0/0", "bounds": [[0, 0, 0], [1, 1, 1e300]]},
        {"key": "1/0/0/0", "error": -1},
        {"key": "1/0/0/0", "hash": "../../../../etc"},
        {"key": "1/0/0/0", "hash": HASH + "\n"},
        {"key": "1/0/0/0", "tiles": [[256, 0, 1]]},
        {"key": "1/0/0/0", "tiles": [[0, 2, 1]]},
        {"key": "1/0/0/0", "tiles": [[0, 0, -1]]},
        {"key": "1/0/0/0", "tiles": [[0, 0, 10**30]]},
        {"key": "1/0/0/0", "views": [[0]] * 27},
        {"key": "1/0/0/0", "views": [[-1]]},
        {"key": "1/0/0/0", "children": ["1/0/0/0"]},
        {"key": "1/0/0/0", "children": ["0/0/0/0"]},
        {"key": "1/0/0/0", "children": ["0/9/0/0"], "index": HASH},
        {"key": "1/0/0/0", "children": ["0/0/0/0", "0/0/0/0"], "index": HASH},
        {"key": "1/0/0/0", "geometry": {"hash": "mesh", "bytes": 1}},
        {"key": "1/1/0/0"},
    ],
)
def test_cells_that_cannot_be(cell: dict[str, Any]) -> None:
    with pytest.raises(CorruptTileError):
        decode_index(index_tile("1/0/0/0", [cell]), "index")


def test_cells_listed_twice_or_above_the_root() -> None:
    for cells in ([], [{"key": "1/0/0/0"}] * 2, [{"key": "1/0/0/0"}, {"key": "2/0/0/0"}]):
        with pytest.raises(CorruptTileError):
            decode_index(index_tile("1/0/0/0", cells), "index")


def test_cells_below_several_parents_do_not_make_the_walk_endless() -> None:
    """A child's index is its parent's, or halves to it: 1,100 cells with 2 * 10^10 ways down to one of them."""
    levels, chain = 30, [0, 1, 3, 7, 15, 31]
    cells: list[dict[str, Any]] = []
    for level in range(levels, -1, -1):
        for i, x in enumerate(chain if level < levels else [0]):
            for j, y in enumerate(chain if level < levels else [0]):
                below = [f"{level - 1}/{u}/{v}/0" for u in chain[i : i + 2] for v in chain[j : j + 2]] if level else []
                cells.append({"key": f"{level}/{x}/{y}/0", "children": below})
    world = world_of(levels, cells)
    with pytest.raises(CorruptTileError, match="other parents"):
        list(islice(world.cells(), 10_000))


def test_a_cell_that_is_listed_but_not_told_of() -> None:
    world = world_of(2, [{"key": "2/0/0/0", "children": ["1/0/0/0"], "index": HASH}])
    with pytest.raises(CorruptTileError, match="tells nothing"):
        list(world.cells())
    with pytest.raises(KeyError):
        world.entry(CellKey(1, 1, 1, 1))


def test_the_index_tile_of_another_cell() -> None:
    store = world_of(1, [{"key": "1/0/0/0"}]).store
    key = next(store.list("index"))
    store.put(key, index_tile("1/-1/0/0", [{"key": "1/-1/0/0"}]))
    with pytest.raises(CorruptTileError, match="another cell"):
        list(World.open(store).cells())


@pytest.mark.parametrize(
    "members",
    [
        {"version": 0},
        {"version": True},
        {"version": "1"},
        {"index_depth": 1},
        {"bounds": [[1, 0, 0], [0, 1, 1]]},
        {"origin": [0, 0, 1e300]},
        {"directions": [{"number": 4, "vector": [0, 0, 0]}]},
        {"directions": [{"number": 999, "vector": [0, 0, 1]}]},
        {"roots": [{"key": "1/0/0/0", "hash": "../x"}]},
        {"roots": [{"key": "0/0/0/0", "hash": HASH}]},
        {"roots": [{"key": "1/1/0/0", "hash": HASH}]},
        {"roots": [{"key": "1/0/0/0", "hash": HASH}] * 2},
        {"view": {"eye": [0, 0, 0], "target": [1, 0, 0], "fov": 180}},
        {"grid": {"leaf_size": 1e300, "resolution": 16, "corner": [0, 0, 0], "axis_levels": [1, 1, 0]}},
        {"grid": {"leaf_size": 1, "resolution": 16, "corner": [0, 0, 0], "axis_levels": [41, 0, 0]}},
        {"generation": -1},
        {"attributes": "../secret"},
    ],
)
def test_manifests_that_contradict_themselves(members: dict[str, Any]) -> None:
    with pytest.raises(NotAWorldError, match="damaged manifest"):
        decode_manifest(manifest(**members))


def test_a_newer_manifest_says_so_whatever_else_it_holds() -> None:
    with pytest.raises(VersionError):
        decode_manifest(b'{"format": "farfield-world", "version": 2, "grid": 7}')


def test_a_damaged_record_means_baking_anew() -> None:
    store, key = MemoryStore(), CellKey(0, 0, 0, 0)
    another = golden()["record/1/-1/-1/0"]
    for data in (DEEP, b'{"input":"\xff"}', b"", another):
        store.put("record/0/0/0/0", data)
        assert read_record(store, key, json.loads(another)["input"]) is None


def test_manifests_of_endless_nesting() -> None:
    with pytest.raises(NotAWorldError):
        decode_manifest(manifest()[:-1] + b',"later":' + DEEP + b"}")


def test_a_damaged_path_of_cameras(tmp_path: Any) -> None:
    file = tmp_path / "path.json"
    for data in (DEEP, b'{"later":' + DEEP, b'{"frames":[{"t":"\xff"}]}'):
        file.write_bytes(data)
        with pytest.raises(InputError, match="not a recorded path"):
            read_path(file)


def test_verify_ends_and_names_an_index_that_is_damaged_under_its_own_hash() -> None:
    """Whoever makes a world can give anything the hash that it has."""
    for data in (b"no index", index_tile("1/0/0/0", [{"key": "1/0/0/0", "children": ["1/0/0/0"]}])):
        store = world_of(1, [{"key": "1/0/0/0"}]).store
        name = content_hash(data)
        key = index_key(CellKey(1, 0, 0, 0), name)
        store.put(key, data)
        facts = json.loads(store.get(KEY))
        store.put(KEY, json.dumps({**facts, "roots": [{"key": "1/0/0/0", "hash": name}]}).encode())
        assert [fault.key for fault in verify_world(World.open(store)).faults] == [key]


def test_verify_names_a_glb_that_is_damaged_under_its_own_hash() -> None:
    data = b"glTF" + bytes(40)
    name = content_hash(data)
    geometry = {"hash": name, "bytes": len(data)}
    world = world_of(0, [{"key": "0/0/0/0", "geometry": geometry}])
    world.store.put(f"geometry/0/0/0/0-{name}", data)
    assert [fault.key for fault in verify_world(world).faults] == [f"geometry/0/0/0/0-{name}"]
