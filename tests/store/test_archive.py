"""Archives: what they hold comes back, where it should lie, and every kind of damage is said to be one."""

from __future__ import annotations

import json
import os
import random
import zlib
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripts.write_archive_vectors import FOLDER, values, write

from farfield.errors import DamagedValueError, FarfieldError, MissingKeyError, NotAWorldError, StoreError, VersionError
from farfield.store import open_store
from farfield.store.archive import ArchiveStore
from farfield.store.archive.layout import (
    HEADER_BYTES,
    VALUES_FROM,
    Entry,
    Header,
    Span,
    decode_directory,
    decode_header,
    encode_directory,
    encode_header,
)
from farfield.store.archive.order import rank
from farfield.store.archive.writer import writing_archive
from store.archives import write_archive

DAMAGED = json.loads((FOLDER / "damaged.json").read_text(encoding="utf-8"))


def test_the_script_writes_the_vectors(tmp_path: Path) -> None:
    write(tmp_path)
    for name in ("cells.farfield", "cells.json", "damaged.json"):
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes()


def test_the_shared_archive_holds_what_it_should() -> None:
    expected = json.loads((FOLDER / "cells.json").read_text(encoding="utf-8"))
    store = ArchiveStore(FOLDER / "cells.farfield")
    assert {key: zlib.crc32(store.get(key)) for key in store.list()} == expected
    assert store.get("world.json") == values()["world.json"]
    for key in ("world.jso", "orthoview/0/0/0/0/9/0-0000000000000000", "a", "zz"):
        assert not store.exists(key)


@pytest.mark.parametrize("case", DAMAGED["directories"], ids=lambda case: case["what"])
def test_damaged_directories_are_refused(case: dict[str, str]) -> None:
    with pytest.raises(DamagedValueError, match="farfield copy the world again"):
        decode_directory(bytes.fromhex(case["block"]), DAMAGED["total"], "here")


@pytest.mark.parametrize("case", DAMAGED["headers"], ids=lambda case: case["what"])
def test_damaged_headers_are_refused(case: dict[str, str]) -> None:
    with pytest.raises(DamagedValueError):
        decode_header(bytes.fromhex(case["bytes"]), "here")


@given(st.binary(max_size=300))
def test_any_bytes_are_a_directory_or_refused(data: bytes) -> None:
    for block in (data, len(data).to_bytes(4, "little") + (1).to_bytes(4, "little") + _deflated(data)):
        try:
            decode_directory(block, 1 << 40, "here")
        except DamagedValueError:
            continue


@given(st.binary(max_size=100))
def test_any_bytes_are_a_header_or_refused(data: bytes) -> None:
    for head in (data, b"FFAR" + data):
        with pytest.raises(FarfieldError):
            decode_header(head, "here")


keys = st.lists(
    st.from_regex(r"[a-z]{1,9}/[0-9]{1,2}/-?[0-9]{1,3}/[0-9]/[0-9]-[0-9a-f]{4}", fullmatch=True), unique=True
)


@given(keys, st.randoms(use_true_random=False))
def test_a_directory_comes_back(names: list[str], chance: random.Random) -> None:
    def span() -> Span:
        return Span(chance.randrange(HEADER_BYTES, 1 << 45), chance.randrange(1 << 40), chance.getrandbits(32))

    entries = [Entry(name, span()) for name in sorted(names, key=rank)]
    assert decode_directory(encode_directory(entries), 1 << 46, "here") == entries


def test_what_a_picture_needs_lies_together() -> None:
    """The manifest, the index and the upper levels come first; a block of 4 x 4 cells is one stretch."""
    cells = [f"orthoview/0/{x}/{y}/0/22/0-aa" for x in range(-8, 8) for y in range(-8, 8)]
    cells += [f"geometry/0/{x}/{y}/0-aa" for x in range(-8, 8) for y in range(-8, 8)]
    ids = ["objects/9/0/0/0/22/0-aa", "objects/0/0/0/0/22/0-aa"]
    others = [*ids, "world.json", "index/3/0/0/0-aa", "index/9/0/0/0-aa", "orthoview/1/0/0/0/22/0-aa", "mesh/aa"]
    order = sorted(cells + others, key=rank)
    assert order[:4] == ["world.json", "index/9/0/0/0-aa", "index/3/0/0/0-aa", "orthoview/1/0/0/0/22/0-aa"]
    assert order[-3:] == [*ids, "mesh/aa"]
    for x in range(-8, 8, 4):
        for y in range(-8, 8, 4):
            block = [f"{x + i}/{y + j}/0" for i in range(4) for j in range(4)]
            places = [order.index(f"orthoview/0/{cell}/22/0-aa") for cell in block]
            places += [order.index(f"geometry/0/{cell}-aa") for cell in block]
            places.sort()
            assert all(after == before + 1 for before, after in pairwise(places))


def test_the_first_request_brings_all_that_opening_needs(tmp_path: Path) -> None:
    """Header and root directory lie before the values, of a million keys too: here in directories of 3."""
    content = {f"orthoview/0/{n}/{n % 7}/0/22/0-{n:016x}": b"" for n in range(9000)}
    write_archive(tmp_path / "a.farfield", content | {"world.json": b"{}"}, directory_keys=3)
    head = (tmp_path / "a.farfield").read_bytes()[: VALUES_FROM + 2]
    root = decode_header(head, "here").root
    assert root.offset + root.length <= VALUES_FROM
    assert len(decode_directory(head[root.offset : root.offset + root.length], 1 << 30, "here")) > 100
    store = ArchiveStore(tmp_path / "a.farfield")
    assert sorted(store.list()) == sorted([*content, "world.json"])


def test_values_that_come_in_any_order_are_found(tmp_path: Path) -> None:
    content = list(values().items())
    random.Random(1).shuffle(content)
    store = write_archive(tmp_path / "a.farfield", dict(content), directory_keys=10)
    assert {key: store.get(key) for key in store.list()} == dict(content)


def test_an_archive_cannot_be_changed(tmp_path: Path) -> None:
    store = write_archive(tmp_path / "a.farfield", {"world.json": b"{}"})
    for act in (lambda: store.put("a", b""), lambda: store.delete("world.json"), store.writing):
        with pytest.raises(StoreError, match="written by farfield copy"):
            act()


def test_an_archive_that_is_replaced_is_read_on(tmp_path: Path) -> None:
    path = tmp_path / "a.farfield"
    old = write_archive(path, {"world.json": b"old"})
    new = write_archive(path, {"world.json": b"new, and longer"})
    assert (old.get("world.json"), new.get("world.json")) == (b"old", b"new, and longer")


def test_damage_to_one_value_is_its_own(tmp_path: Path) -> None:
    path = tmp_path / "a.farfield"
    write_archive(path, {"world.json": b"{}", "mesh/aa": b"mesh" * 100, "mesh/bb": b"other"})
    data = bytearray(path.read_bytes())
    data[data.index(b"meshmesh") + 200] ^= 1
    path.write_bytes(data)
    store = ArchiveStore(path)
    with pytest.raises(DamagedValueError, match=r"mesh/aa: .*checksum") as caught:
        store.get("mesh/aa")
    assert "farfield copy" in caught.value.hint
    assert store.get_range("mesh/aa", 0, 4) == b"mesh"
    assert store.get("mesh/bb") == b"other"


def test_damage_to_a_directory_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.farfield"
    write_archive(path, {"world.json": b"{}"})
    data = bytearray(path.read_bytes())
    data[-2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedValueError, match=r"byte 16,386: .*checksum"):
        ArchiveStore(path).get("world.json")
    data[HEADER_BYTES + 9] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedValueError, match="byte 44"):
        ArchiveStore(path)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda data: b"", NotAWorldError, "no farfield archive"),
        (lambda data: b"PK\3\4" + data[4:], NotAWorldError, "no farfield archive"),
        (lambda data: data[:30], DamagedValueError, "cut short"),
        (lambda data: data[:-1], DamagedValueError, r"cut short: \d+ of \d+ bytes"),
        (lambda data: data + b"x", DamagedValueError, "cut short"),
        (lambda data: data[:4] + b"\2" + data[5:], VersionError, "version 2, this farfield reads up to 1"),
        (lambda data: encode_header(Header(Span(44, 2**31, 0), 2**62, 1)) + data[44:], DamagedValueError, "cut short"),
    ],
)
def test_what_is_no_whole_archive(tmp_path: Path, change, error: type[FarfieldError], message: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "a.farfield"
    write_archive(path, {"world.json": b"{}"})
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(error, match=message) as caught:
        open_store(path)
    assert str(path) in str(caught.value)


def test_altered_anywhere_it_gives_what_was_stored_or_an_error(tmp_path: Path) -> None:
    """A byte of the header, a directory or a value at a time; never anything else, whoever reads."""
    original = (FOLDER / "cells.farfield").read_bytes()
    path = tmp_path / "a.farfield"
    content = values()
    chance = random.Random(5)
    places = [*range(HEADER_BYTES + 60), *chance.sample(range(HEADER_BYTES, len(original)), 60)]
    found = 0
    for place in places:
        data = bytearray(original)
        data[place] ^= chance.randrange(1, 256)
        path.write_bytes(data)
        found += _is_noticed(path, content)
    assert found > HEADER_BYTES


def _is_noticed(path: Path, content: dict[str, bytes]) -> bool:
    """Whether reading everything says that something is wrong. Fails when anything wrong is read."""
    try:
        store = ArchiveStore(path)
    except FarfieldError:
        return True
    noticed = False
    for key, value in content.items():
        try:
            assert store.get(key) == value
        except DamagedValueError:
            noticed = True
    return noticed


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "below" / "a.farfield"

    def fail() -> None:
        with writing_archive(path) as writer:
            writer.put("world.json", b"{}")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list(path.parent.iterdir()) == []
    write_archive(path, {})
    with pytest.raises(StoreError, match="something of that name"), writing_archive(path):
        pytest.fail("not reached")


def test_a_writer_takes_each_key_once_and_only_keys(tmp_path: Path) -> None:
    with writing_archive(tmp_path / "a.farfield") as writer:
        writer.put("mesh/aa", b"")
        for key in ("mesh/aa", "../x"):
            with pytest.raises(StoreError):
                writer.put(key, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins

    ordinary = builtins.open
    monkeypatch.setattr(builtins, "open", lambda path, mode="r": ordinary("/dev/full" if "x" in mode else path, "wb"))
    with (
        pytest.raises(StoreError, match="free some space") as caught,
        writing_archive(tmp_path / "a.farfield") as writer,
    ):
        writer.put("mesh/aa", b"x" * 100_000)
    assert str(tmp_path / "a.farfield") in caught.value.where


def test_what_is_missing_has_a_name(tmp_path: Path) -> None:
    store = write_archive(tmp_path / "a.farfield", {})
    with pytest.raises(MissingKeyError, match=r"a\.farfield: mesh/aa"):
        store.get("mesh/aa")
    assert os.path.getsize(tmp_path / "a.farfield") == VALUES_FROM


def _deflated(data: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(data) + packer.flush()
