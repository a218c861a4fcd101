"""A world split over folders, and over web servers: read as one, copied back to the same bytes, and refused where it
would lead elsewhere."""

from __future__ import annotations

import json
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from farfield.cli import main
from farfield.errors import MissingKeyError, NotAWorldError, OptionError, StoreError, WorldError
from farfield.pipeline import bake_sources, copy_place, update_place
from farfield.serve import viewer_files
from farfield.store import DirectoryStore, HttpStore, Store, open_store
from farfield.store.archive import ArchiveStore
from farfield.store.archive.writer import writing_archive
from farfield.world.manifest import KEY, decode_manifest, read_manifest, with_servers
from farfield.world.servers import RULE, ServersRecord
from farfield.world.split import SplitStore, joined, open_served, open_world
from farfield.world.verification import verify_world
from farfield.world.world import World

GOLDEN = Path(__file__).parents[1] / "fixtures/world-v1.zip"
NAMES = ["north", "south", "east"]
VIEW = ["--eye", "-20,-20,15", "--target", "8,8,0", "--size", "160x120", "--json"]


@pytest.fixture
def whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The golden world; and a viewer of two files."""
    with zipfile.ZipFile(GOLDEN) as archive:
        archive.extractall(tmp_path / "whole")
    page = DirectoryStore(tmp_path / "page")
    page.put("index.html", b"page")
    page.put("viewer/app.js", b"script")
    monkeypatch.setattr(viewer_files, "STATIC", Path(page.location))
    return tmp_path / "whole"


@pytest.fixture
def split(whole: Path, tmp_path: Path) -> Path:
    """The same over three folders."""
    copy_place(whole, tmp_path / "split", servers=NAMES)
    return tmp_path / "split"


def public(store: Store) -> dict[str, bytes]:
    """What readers of a world may ask for."""
    return {
        key: store.get(key)
        for key in store.list()
        if key == KEY or (not key.startswith(("record/", "viewer/")) and "." not in key)
    }


class _Files(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Says nothing."""


@contextmanager
def files(folder: Path, port: int = 0) -> Iterator[str]:
    """A plain server of the files in `folder`; its address."""
    with ThreadingHTTPServer(("127.0.0.1", port), partial(_Files, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


def test_each_value_is_on_one_server_and_the_top_on_all(whole: Path, split: Path) -> None:
    parts = {name: public(DirectoryStore(split / name)) for name in NAMES}
    expected = public(DirectoryStore(whole))
    servers = read_manifest(DirectoryStore(split / "north")).servers
    assert servers == ServersRecord(RULE, 0, ("../north/", "../south/", "../east/"))
    everywhere = set.intersection(*map(set, parts.values()))
    assert KEY in everywhere
    assert {key.split("/")[1] for key in everywhere - {KEY}} == {"1"}, "cells above the level"
    for key, value in expected.items():
        if key != KEY:
            have = [name for name, values in parts.items() if key in values]
            assert len(have) == (3 if key in everywhere else 1)
            assert all(parts[name][key] == value for name in have)
    assert set().union(*parts.values()) == set(expected)
    assert min(len(values) for values in parts.values()) > len(everywhere) + 5
    for name in NAMES:
        assert (split / name / "index.html").exists()
        assert parts[name][KEY] == parts["north"][KEY]


def test_read_as_one_it_is_the_whole(whole: Path, split: Path) -> None:
    expected = public(DirectoryStore(whole))
    for name in NAMES:
        store = open_world(split / name)
        assert isinstance(store, SplitStore)
        assert public(store) == expected
        keys = [key for key in store.list() if key.startswith(("index", "mesh", "orthoview"))]
        assert keys == sorted(keys, key=lambda key: key.split("/"))
        assert list(store.list("mesh")) == [key for key in keys if key.startswith("mesh")]
        for key in (KEY, keys[0], keys[-1]):
            assert store.size(key) == len(expected[key])
            assert store.get_range(key, 3, 5) == expected[key][3:8]
            assert store.exists(key)
        world = World.open(open_store(split / name))
        assert world.manifest.servers
        found, before = verify_world(world), verify_world(World.open(DirectoryStore(whole)))
        assert found == before
    with pytest.raises(MissingKeyError):
        store.get("mesh/0000000000000000")
    with pytest.raises(OptionError):
        store.get_range(KEY, -1, 5)


def test_there_and_back(whole: Path, split: Path, tmp_path: Path, new_bucket: Callable[[], str]) -> None:
    expected = public(DirectoryStore(whole))
    for number, name in enumerate(NAMES):
        copy_place(split / name, tmp_path / f"back{number}")
        assert public(DirectoryStore(tmp_path / f"back{number}")) == expected
    copy_place(split / "south", tmp_path / "a.farfield")
    copy_place(whole, tmp_path / "b.farfield")
    assert (tmp_path / "a.farfield").read_bytes() == (tmp_path / "b.farfield").read_bytes()
    bucket = new_bucket()
    for places in (f"{bucket}/split", bucket):
        copy_place(split / "east", places, servers=["a", "b"])
        copy_place(f"{places}/b", tmp_path / f"from{len(places)}")
        assert public(DirectoryStore(tmp_path / f"from{len(places)}")) == expected
    copy_place(whole, f"{bucket}/other/part")
    parts = ServersRecord(RULE, 0, ("../part/",))
    nowhere = open_store(bucket)
    nowhere.put(KEY, with_servers(nowhere.get("a/world.json"), parts))
    with pytest.raises(NotAWorldError, match="leads out of the bucket"):
        open_world(bucket)


def test_a_copy_that_was_interrupted_goes_on(whole: Path, split: Path) -> None:
    tile = next(DirectoryStore(split / "south").list("orthoview/0"))
    (split / "south" / tile).unlink()
    (split / "south" / KEY).unlink()
    facts = copy_place(whole, split, servers=NAMES)
    assert facts["keys"] == 172
    assert facts["keys"] - facts["skipped"] == 2
    assert not verify_world(World.open(open_store(split / "south"))).faults


def test_the_commands(split: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = str(split / "south")
    assert main(["info", place, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["servers"] == ["../north/", "../south/", "../east/"]
    assert main(["info", place]) == 0
    assert "3: ../north/, ../south/, ../east/" in capsys.readouterr().out
    assert main(["info", str(whole), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {**facts, "servers": []}
    assert main(["verify", place, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    for source, name in ((whole, "whole.png"), (split / "south", "split.png")):
        assert main(["render", str(source), *VIEW, "-o", str(tmp_path / name)]) == 0
    assert (tmp_path / "whole.png").read_bytes() == (tmp_path / "split.png").read_bytes()


def test_a_part_that_is_away_is_drawn_from_above(
    split: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (split / "east").rename(split / "gone")
    assert main(["render", str(split / "north"), *VIEW, "-o", str(tmp_path / "a.png")]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["warnings"] > 0
    assert facts["cells"] > 3
    assert main(["verify", str(split / "north"), "--json"]) == 1
    bad = json.loads(capsys.readouterr().out)["bad"]
    assert bad
    lost = {key for key in public(DirectoryStore(split / "gone")) if key != KEY}
    assert {fault["key"] for fault in bad} <= lost


def test_what_the_copy_says(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    servers = "https://a.example.org/maps/city,http://127.0.0.1:8001/"
    command = ["copy", str(whole), str(tmp_path / "split"), "--servers", servers]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "172 values" in said
    assert f"{tmp_path}/split/a.example.org-maps-city to https://a.example.org/maps/city/ (" in said
    assert f"{tmp_path}/split/127.0.0.1-8001 to http://127.0.0.1:8001/ (" in said
    assert main([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [share["address"] for share in facts["servers"]] == [
        "https://a.example.org/maps/city/",
        "http://127.0.0.1:8001/",
    ]
    for share in facts["servers"]:
        store = DirectoryStore(share["place"])
        values = public(store)
        assert share["keys"] == len(values)
        assert share["bytes"] == sum(map(len, values.values()))


@pytest.mark.parametrize(
    ("target", "servers", "message", "code"),
    [
        ("x", "", "no address of a server", 2),
        ("x", "a,,b", "no address of a server", 2),
        ("x", "a,../b", "no address of a server", 2),
        ("x", "a,/etc", "no address of a server", 2),
        ("x", "a,.ssh", "no address of a server", 2),
        ("x", "a,a/", "is there twice", 2),
        ("x", "http://h/,https://h", "is there twice", 2),
        ("x", "https://user:secret@a.example.org/,b", "no address of a server", 2),
        ("x", "s3://bucket/a,b", "no address of a server", 2),
        ("x", ",".join(map(str, range(257))), "at most 256", 2),
        ("x.farfield", "a,b", "one file for one server", 2),
        ("whole", "a,b", "there is a world", 1),
        (".", "a,whole", "the same place", 2),
        ("taken", "a,b", "there is a world", 1),
        ("full", "a,b", "something other than a world", 1),
    ],
)
def test_refusals_are_one_line(
    whole: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    target: str,
    servers: str,
    message: str,
    code: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    copy_place(whole, tmp_path / "taken")
    (tmp_path / "full/b").mkdir(parents=True)
    (tmp_path / "full/b/cat.png").write_bytes(b"")
    before = set(tmp_path.rglob("*"))
    assert main(["copy", "whole", target, "--servers", servers]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert "Traceback" not in captured.err
    assert set(tmp_path.rglob("*")) == before


def test_a_split_world_is_only_read(whole: Path, split: Path, tmp_path: Path) -> None:
    (tmp_path / "tree.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for act in (
        lambda: bake_sources([tmp_path / "tree.obj"], split / "north"),
        lambda: update_place(split / "north", [tmp_path / "tree.obj"]),
    ):
        with pytest.raises(WorldError, match=r"one part of a world.*farfield copy it into one place"):
            act()
    store = open_world(split / "north")
    for act in (lambda: store.put("a", b""), lambda: store.delete("a"), store.writing):
        with pytest.raises(StoreError, match="only read"):
            act()
    assert main(["gc", str(split / "north")]) == 1


def test_a_part_of_another_world_is_not_overwritten(whole: Path, split: Path) -> None:
    part = DirectoryStore(split / "east")
    part.put(KEY, part.get(KEY).replace(b'"golden"', b'"iron"'))
    with pytest.raises(NotAWorldError, match="another world"):
        copy_place(whole, split, servers=NAMES)


# Where addresses lead


def rewritten(part: Path, *addresses: str) -> Store:
    """The store of a part whose manifest names these servers."""
    store = DirectoryStore(part)
    store.put(KEY, with_servers(store.get(KEY), ServersRecord(RULE, 0, addresses)))
    return store


@pytest.mark.parametrize(
    "address", ["../../x/", "/etc/", "file:///etc/", "../../../", "~user/../", "..", "../.config/"]
)
def test_no_address_leads_out(split: Path, address: str, capsys: pytest.CaptureFixture[str]) -> None:
    rewritten(split / "north", address)
    for command in ("info", "verify", "serve"):
        assert main([command, str(split / "north")]) == 1
        said = capsys.readouterr().err
        assert "neither http(s) nor a folder in or beside the world's own" in said
        assert said.count("\n") == 1


def test_links_are_not_followed(split: Path, whole: Path) -> None:
    (split / "link").symlink_to(whole)
    (split / "north/link").symlink_to(whole)
    for address in ("../link/", "link/"):
        store = rewritten(split / "north", address)
        with pytest.raises(NotAWorldError, match="symbolic link"):
            World.open(store)


def test_folders_in_the_own_one_and_itself(whole: Path, tmp_path: Path) -> None:
    """As somebody may lay it out: the manifest at the top, a part in it, and another below."""
    copy_place(whole, tmp_path / "split", servers=["a", "b"])
    top = tmp_path / "split/a"
    (tmp_path / "split/b").rename(top / "below")
    rewritten(top, "./", "below/")
    store = open_world(top)
    for key, value in public(DirectoryStore(whole)).items():
        assert store.get(key) == value


def test_an_archive_is_not_split(split: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.farfield"
    with writing_archive(path) as writer:
        writer.put(KEY, (split / "north" / KEY).read_bytes())
    with pytest.raises(NotAWorldError, match="not split over servers"):
        World.open(ArchiveStore(path))


# Over HTTP


def test_over_plain_web_servers(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    expected = public(DirectoryStore(whole))
    folders = [tmp_path / f"www{number}" for number in range(3)]
    with ExitStack() as stack:
        for folder in folders:
            folder.mkdir()
        addresses = [stack.enter_context(files(folder)) + "city" for folder in folders]
        facts = copy_place(whole, tmp_path / "split", servers=addresses)
        for folder, share in zip(folders, facts["servers"], strict=True):
            Path(share["place"]).rename(folder / "city")
        copy_place(addresses[2], tmp_path / "back")
        assert public(DirectoryStore(tmp_path / "back")) == expected
        assert main(["verify", addresses[0], "--json"]) == 0
        assert main(["info", f"{addresses[1]}/"]) == 0
        assert main(["render", addresses[2], *VIEW, "-o", str(tmp_path / "web.png")]) == 0
        assert main(["render", str(whole), *VIEW, "-o", str(tmp_path / "whole.png")]) == 0
        assert (tmp_path / "web.png").read_bytes() == (tmp_path / "whole.png").read_bytes()
        # The folder of one server, on a disk, asks the others.
        copy_place(folders[0] / "city", tmp_path / "mixed")
        assert public(DirectoryStore(tmp_path / "mixed")) == expected
    # A disk has one part, and the servers are gone.
    assert main(["render", str(folders[0] / "city"), *VIEW, "-o", str(tmp_path / "rest.png")]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["warnings"] > 0
    with pytest.raises(StoreError, match="does not answer"):
        copy_place(folders[0] / "city", tmp_path / "never")
    assert main(["verify", str(folders[0] / "city")]) == 1
    assert "does not answer" in capsys.readouterr().out


def test_relative_addresses_on_one_web_server(whole: Path, split: Path, tmp_path: Path) -> None:
    with files(split.parent) as address:
        copy_place(f"{address}split/east", tmp_path / "back")
    assert public(DirectoryStore(tmp_path / "back")) == public(DirectoryStore(whole))


def test_what_a_server_offers(split: Path, tmp_path: Path, whole: Path) -> None:
    assert isinstance(open_served(split / "north"), SplitStore)
    (split / "east").rename(split / "elsewhere")
    part = open_served(split / "north")
    assert not isinstance(part, SplitStore), "the others are elsewhere, behind a proxy perhaps"
    assert read_manifest(part).servers
    copy_place(whole, tmp_path / "web", servers=["http://127.0.0.1:9/", "http://127.0.0.1:10/"])
    part = open_served(tmp_path / "web/127.0.0.1-9")
    assert read_manifest(part).servers, "what only this machine reaches stays where it is"
    assert open_served(whole).location == str(whole)


def test_addresses_relative_to_a_web_server() -> None:
    store = HttpStore("https://a.example.org/maps/city/")
    with zipfile.ZipFile(GOLDEN) as archive:
        data = with_servers(archive.read(KEY), ServersRecord(RULE, 0, ("./", "b/", "../c/", "http://d.example.org/")))
    found = joined(store, decode_manifest(data))
    assert isinstance(found, SplitStore)
    assert [part.location for part in found._parts] == [
        "https://a.example.org/maps/city",
        "https://a.example.org/maps/city/b",
        "https://a.example.org/maps/c",
        "http://d.example.org",
    ]
