"""A copy holds what the manifest reaches, is never half a world to a reader, and goes on where it stopped."""

from __future__ import annotations

import json
import threading
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from farfield.cli import main
from farfield.errors import (
    CorruptTileError,
    DamagedValueError,
    FarfieldError,
    MissingKeyError,
    NotAWorldError,
    OptionError,
    StoreError,
)
from farfield.pipeline import copy_place
from farfield.serve import viewer_files
from farfield.store import DirectoryStore, LatencyStore, MemoryStore, Store, open_store
from farfield.store.archive import ArchiveStore
from farfield.store.archive.order import rank
from farfield.store.archive.writer import writing_archive
from farfield.world import copying
from farfield.world.copying import copy_world
from farfield.world.index import IndexTile, decode_index, encode_index
from farfield.world.reach import textures_of
from farfield.world.targets import ArchiveTarget, StoreTarget
from farfield.world.verification import verify_world
from farfield.world.world import World

GOLDEN = Path(__file__).parents[1] / "fixtures/world-v1.zip"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The golden world with what a bake and others leave beside it; and a viewer of two files."""
    with zipfile.ZipFile(GOLDEN) as archive:
        archive.extractall(tmp_path / "golden")
    (tmp_path / "golden/notes.txt").write_text("private")
    page = DirectoryStore(tmp_path / "page")
    page.put("index.html", b"page")
    page.put("viewer/app.js", b"script")
    monkeypatch.setattr(viewer_files, "STATIC", Path(page.location))
    return tmp_path / "golden"


@pytest.fixture
def source(folder: Path) -> DirectoryStore:
    return DirectoryStore(folder)


def public(store: Store) -> dict[str, bytes]:
    """What readers of a world may ask for."""
    return {
        key: store.get(key) for key in store.list() if not key.startswith(("record/", "viewer/")) and "." not in key
    }


class Watched(MemoryStore):
    """Remembers what was read and written, and fails after so many writes."""

    def __init__(self, last: int = 10**9) -> None:
        super().__init__()
        self.written: list[str] = []
        self._last = last
        self._watch = threading.Lock()

    def put(self, key: str, data: bytes) -> None:
        with self._watch:
            if len(self.written) >= self._last:
                raise OSError("pulled the plug")
            self.written.append(key)
        super().put(key, data)


def test_a_copy_is_the_world_and_nothing_else(source: DirectoryStore) -> None:
    target = Watched()
    copied = copy_world(source, StoreTarget(target))
    assert public(target) == public(source)
    assert target.get("world.json") == source.get("world.json")
    assert sorted(target.list()) == sorted([*public(source), "world.json"])
    assert copied.keys == len(list(target.list()))
    assert copied.bytes == sum(map(target.size, target.list()))
    assert copied.skipped == 0
    assert not verify_world(World.open(target)).faults


def test_the_manifest_comes_last(source: DirectoryStore) -> None:
    target = Watched()
    copy_world(source, StoreTarget(target))
    assert target.written[-1] == "world.json"
    assert target.written.count("world.json") == 1


@pytest.mark.parametrize("writes", [1, 10, 100, 171])
def test_an_interrupted_copy_goes_on(source: DirectoryStore, writes: int) -> None:
    target = Watched(writes)
    with pytest.raises(OSError, match="plug"):
        copy_world(source, StoreTarget(target))
    assert not target.exists("world.json")
    target._last = 10**9
    copied = copy_world(source, StoreTarget(target))
    assert copied.skipped == writes
    assert len(target.written) == len(set(target.written)) == copied.keys
    assert public(target) == public(source)


def test_a_value_of_another_size_is_copied_again(source: DirectoryStore) -> None:
    target = MemoryStore()
    copy_world(source, StoreTarget(target))
    keys = [next(iter(target.list(name))) for name in ("orthoview", "objects", "geometry", "index", "texture")]
    for key in keys:
        target.put(key, b"half")
    target.delete(next(iter(target.list("mesh"))))
    copied = copy_world(source, StoreTarget(target))
    assert copied.keys - copied.skipped == len(keys) + 2, "and the mesh, and the manifest"
    assert public(target) == public(source)


def test_a_later_generation_takes_the_place_of_an_earlier_one(source: DirectoryStore) -> None:
    target = MemoryStore()
    copy_world(source, StoreTarget(target))
    text = source.get("world.json").replace(b'"generation": 1', b'"generation": 2')
    source.put("world.json", text)
    copy_world(source, StoreTarget(target))
    assert World.open(target).manifest.generation == 2


def test_another_world_does_not(source: DirectoryStore) -> None:
    target = MemoryStore()
    copy_world(source, StoreTarget(target))
    target.put("world.json", target.get("world.json").replace(b'"leaf_size": 8', b'"leaf_size": 16'))
    with pytest.raises(NotAWorldError, match="another world"):
        copy_world(source, StoreTarget(target))


def test_an_archive_lies_in_order_and_is_the_same_each_time(source: DirectoryStore, tmp_path: Path) -> None:
    paths = [tmp_path / "a.farfield", tmp_path / "b.farfield"]
    for path in paths:
        with writing_archive(path) as writer:
            copy_world(source, ArchiveTarget(writer))
    assert paths[0].read_bytes() == paths[1].read_bytes()
    archive = ArchiveStore(paths[0])
    assert public(archive) == public(source)
    places = {key: archive._span(key).offset for key in archive.list() if archive.size(key)}
    cells = [key for key in places if not key.startswith(("mesh", "texture", "attributes"))]
    assert sorted(cells, key=rank) == sorted(cells, key=places.__getitem__)


def test_values_held_at_once_are_bounded(source: DirectoryStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a large world read ahead of a slow writer no more than the limit is in memory."""
    monkeypatch.setattr(copying, "UNDER_WAY_BYTES", 3000)
    monkeypatch.setattr(copying, "UNKNOWN_BYTES", 1000)
    under_way: list[int] = []
    held = 0
    lock = threading.Lock()

    class Source(DirectoryStore):
        def get(self, key: str) -> bytes:
            nonlocal held
            data = super().get(key)
            with lock:
                held += len(data)
                under_way.append(held)
            return data

    class Slow(ArchiveTarget):
        def put_in_turn(self, key: str, value: bytes) -> None:
            nonlocal held
            super().put_in_turn(key, value)
            with lock:
                held -= len(value)

    with writing_archive(source.location + ".farfield") as writer:
        copy_world(Source(source.location), Slow(writer))
    largest = max(source.size(key) for key in source.list())
    assert held == 0
    assert max(under_way) <= 3000 + 2 * largest


def test_requests_to_a_far_store_do_not_wait_for_each_other(source: DirectoryStore) -> None:
    """172 values at 20 ms each, one after the other, would take 3.4 s to read and as long to write."""
    import time

    far = LatencyStore(MemoryStore("s3://far/world"), 0.02)
    begun = time.monotonic()
    copy_world(source, StoreTarget(far))
    assert time.monotonic() - begun < 2.0


def test_what_is_missing_in_the_source_is_named(source: DirectoryStore) -> None:
    for name in ("orthoview", "geometry", "mesh", "texture", "index"):
        key = next(iter(source.list(name)))
        data = source.get(key)
        source.delete(key)
        target = MemoryStore()
        with pytest.raises(MissingKeyError, match=key):
            copy_world(source, StoreTarget(target))
        assert not target.exists("world.json")
        source.put(key, data)


def test_a_damaged_index_is_named(source: DirectoryStore) -> None:
    key = next(iter(source.list("index")))
    source.put(key, source.get(key)[:-3])
    with pytest.raises(CorruptTileError, match=key):
        copy_world(source, StoreTarget(MemoryStore()))


@pytest.mark.parametrize("changed", [{"key": "level/x/y/z"}, {"tiles": ((-4, 0, 100),)}])
def test_an_index_that_names_what_cannot_be(source: DirectoryStore, changed: dict[str, Any]) -> None:
    """Well packed, with a checksum that is right."""
    root = World.open(source).manifest.roots[0]
    key = f"index/{root.key}-{root.hash}"
    entry = decode_index(source.get(key), key).cells[0]
    source.put(key, encode_index(IndexTile(root.key, (replace(entry, **changed),))))
    with pytest.raises(CorruptTileError, match=key):
        copy_world(source, StoreTarget(MemoryStore()))


@pytest.mark.parametrize(
    "data",
    [
        b"glTF",
        b"glTF" + b"\0" * 16,
        b"glTF" + b"\0" * 8 + b"\xff\xff\xff\xffJSON[]",
        b"glTF" + b"\0" * 8 + b"\x0e\0\0\0JSON" + b'{"images":[1]}',
    ],
)
def test_a_damaged_glb_is_named(data: bytes) -> None:
    with pytest.raises(CorruptTileError, match="mesh/aa"):
        list(textures_of(data, "mesh/aa"))


def test_round_about_through_every_kind_of_store(folder: Path, tmp_path: Path, new_bucket: Callable[[], str]) -> None:
    bucket = new_bucket() + "/some/town"
    places = [folder, tmp_path / "a.farfield", bucket, tmp_path / "b.farfield", tmp_path / "back", bucket + "-2"]
    for a, b in pairwise(places):
        facts = copy_place(a, b)
        assert facts["keys"] == 172
    for place in places:
        store = open_store(place)
        assert public(store) == public(DirectoryStore(folder))
        assert store.exists("index.html") == (str(place) in (bucket, bucket + "-2", str(tmp_path / "back")))
    assert copy_place(folder, bucket)["skipped"] == 171
    for command in ("info", "verify"):
        for place in (bucket, str(tmp_path / "a.farfield")):
            assert main([command, place, "--json"]) == 0


def test_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["copy", str(folder), str(tmp_path / "a.farfield"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (
        facts["bytes"]
        == sum(map(len, public(DirectoryStore(folder)).values())) + (folder / "world.json").stat().st_size
    )
    assert facts["keys"] == 172
    assert facts["seconds"] >= 0
    assert main(["copy", str(tmp_path / "a.farfield"), str(tmp_path / "back")]) == 0
    assert "172 values" in capsys.readouterr().out


def _line(arguments: list[str], capsys: pytest.CaptureFixture[str], code: int = 1) -> str:
    assert main(arguments) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    said = [line for line in captured.err.splitlines() if " in " not in line or "(" in line]
    assert len(said) == 1
    return said[0]


def test_refusals_are_one_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    archive = tmp_path / "a.farfield"
    assert main(["copy", str(folder), str(archive), "--json"]) == 0
    capsys.readouterr()
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/cat.png").write_bytes(b"")
    for target, message, code in (
        (archive, "something of that name (remove it", 1),
        (folder / ".", "the same place", 2),
        (tmp_path / "photos", "something other than a world", 1),
        (tmp_path / "photos/cat.png", "this is a file", 1),
        ("ftp://a/b", "not read from ftp://", 1),
    ):
        assert message in _line(["copy", str(folder), str(target)], capsys, code)
    assert "no world here" in _line(["copy", str(tmp_path / "photos"), str(tmp_path / "x")], capsys)
    assert "no such folder or file" in _line(["copy", str(tmp_path / "none"), str(tmp_path / "x")], capsys)
    assert "no farfield archive" in _line(["info", str(tmp_path / "photos/cat.png")], capsys)
    archive.write_bytes(archive.read_bytes()[:-5])
    assert "cut short" in _line(["verify", str(archive)], capsys)


def test_one_damaged_value_of_an_archive_is_one_fault(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.farfield"
    copy_place(folder, path)
    archive = ArchiveStore(path)
    key = next(iter(archive.list("texture")))
    data = bytearray(path.read_bytes())
    data[archive._span(key).offset] ^= 1
    path.write_bytes(data)
    world = World.open(open_store(path))
    assert [fault.key for fault in verify_world(world).faults] == [key]
    with pytest.raises(DamagedValueError):
        copy_place(path, tmp_path / "copy")
    assert issubclass(DamagedValueError, CorruptTileError), "so that a renderer lets a parent stand in"


def test_two_do_not_write_one_folder(folder: Path, tmp_path: Path) -> None:
    with DirectoryStore(tmp_path / "copy").writing(), pytest.raises(StoreError, match="another process is writing"):
        copy_place(folder, tmp_path / "copy")


def test_an_archive_is_no_place_to_bake(tmp_path: Path) -> None:
    with pytest.raises(FarfieldError, match="farfield copy"):
        open_store(tmp_path / "a.farfield", create=True)
    with pytest.raises(OptionError):
        copy_place("s3://a/b", "s3://a/b/")
