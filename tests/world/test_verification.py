"""A whole world is found whole; each kind of damage is found, named, and does not hide another."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from bake.scenes import village
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.cli import main
from farfield.store import DirectoryStore, MemoryStore
from farfield.world.verification import Fault, verify_world
from farfield.world.world import World


@pytest.fixture(scope="module")
def values() -> dict[str, bytes]:
    """The village, baked: instances, textures, two layers, object ids, several index tiles."""
    store = MemoryStore()
    bake(village(), store, BakeOptions(leaf_size=4.0, resolution=32, directions="5", workers=1))
    return {key: store.get(key) for key in store.list()}


@pytest.fixture
def store(values: dict[str, bytes]) -> MemoryStore:
    store = MemoryStore()
    for key, value in values.items():
        store.put(key, value)
    return store


def faults(store: MemoryStore) -> list[Fault]:
    return list(verify_world(World.open(store)).faults)


def first(store: MemoryStore, folder: str) -> str:
    return next(iter(store.list(folder)))


def test_a_whole_world(store: MemoryStore) -> None:
    found = verify_world(World.open(store))
    assert found.faults == ()
    public = [key for key in store.list() if key != "world.json" and not key.startswith("record/")]
    assert found.tiles == len(public)
    assert found.bytes == sum(map(store.size, public))
    assert found.cells == World.open(store).manifest.statistics.cells


@pytest.mark.parametrize("folder", ["orthoview", "geometry", "mesh", "texture", "index"])
def test_what_is_missing_is_named(store: MemoryStore, folder: str) -> None:
    key = first(store, folder)
    store.delete(key)
    assert faults(store) == [Fault(key, "nothing is stored there")]


def _flipped(data: bytes) -> bytes:
    return data[:-5] + bytes([data[-5] ^ 1]) + data[-4:]


@pytest.mark.parametrize("damage", [_flipped, lambda data: data[:-1], lambda _: b"", lambda data: data + b"x"])
@pytest.mark.parametrize("folder", ["orthoview", "objects", "geometry", "mesh", "texture", "index"])
def test_what_is_damaged_is_named(store: MemoryStore, folder: str, damage: Callable[[bytes], bytes]) -> None:
    key = first(store, folder)
    store.put(key, damage(store.get(key)))
    assert [fault.key for fault in faults(store)] == [key]


def test_whole_tiles_in_each_others_place(store: MemoryStore) -> None:
    one, other = list(store.list("orthoview/0"))[:2]
    first_value, other_value = store.get(one), store.get(other)
    store.put(one, other_value)
    store.put(other, first_value)
    found = faults(store)
    assert found
    assert all("orthoview/0/" in fault.key for fault in found)


def test_one_fault_does_not_hide_another(store: MemoryStore) -> None:
    keys = [first(store, folder) for folder in ("orthoview", "mesh", "texture")]
    for key in keys:
        store.delete(key)
    assert sorted(fault.key for fault in faults(store)) == sorted(keys)


@pytest.fixture
def folder(store: MemoryStore, tmp_path: Path) -> Path:
    directory = DirectoryStore(tmp_path)
    for key in store.list():
        directory.put(key, store.get(key))
    return tmp_path


def test_the_command_verify(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(folder), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["ok"] is True
    assert facts["bad"] == []
    key = next(DirectoryStore(folder).list("orthoview"))
    (folder / key).write_bytes(b"")
    assert main(["verify", str(folder), "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert facts["ok"] is False
    assert [fault["key"] for fault in facts["bad"]] == [key]
    assert main(["verify", str(folder)]) == 1
    assert key in capsys.readouterr().out


def test_the_command_info(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(folder), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {"bounds", "crs", "origin", "levels", "tiles", "bytes"} <= facts.keys()
    assert sum(facts["cells_by_level"]) == facts["cells"]
    assert len(facts["cells_by_level"]) == facts["levels"]
    assert main(["info", str(folder)]) == 0
    assert f"{facts['orthoviews']:,} orthoviews" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["info", "verify", "serve"])
@pytest.mark.parametrize(
    ("manifest", "complaint"),
    [
        (None, "no world here"),
        (b"", "not a manifest"),
        (b"[]", "not the manifest of a farfield world"),
        (b'{"format": "farfield-world", "version": 99}', "upgrade farfield"),
        (b'{"format": "farfield-world", "version": 1}', "damaged manifest"),
    ],
)
def test_what_is_no_world_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, manifest: bytes | None, complaint: str
) -> None:
    if manifest is not None:
        (tmp_path / "world.json").write_bytes(manifest)
    assert main([command, str(tmp_path)]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert complaint in captured.err
