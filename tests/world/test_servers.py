"""The rule that tells from a key which server has it, and manifests that name servers."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import NotAWorldError, VersionError
from farfield.octree.grid import CellKey, Grid
from farfield.world import keys
from farfield.world.manifest import KEY, decode_manifest, encode_manifest, with_servers
from farfield.world.servers import RULE, ServersRecord, is_address, level_for
from fuzz.decoders import golden

REPOSITORY = Path(__file__).parents[2]
FOLDER = REPOSITORY / "tests/vectors/servers"
RULES = sorted(path.name for path in FOLDER.glob("*.json") if path.name != "addresses.json")
HASH = "0123456789abcdef"


@pytest.fixture(scope="module")
def writer() -> ModuleType:
    """scripts/write_server_vectors.py."""
    name = "write_server_vectors"
    spec = importlib.util.spec_from_file_location(name, REPOSITORY / f"scripts/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", RULES)
def test_servers_are_those_of_the_vectors(name: str) -> None:
    vectors = json.loads((FOLDER / name).read_text())
    grid = Grid(**{k: tuple(v) if isinstance(v, list) else v for k, v in vectors["grid"].items()})
    servers = ServersRecord(**vectors["servers"])
    assert [[key, servers.server_of(key, grid)] for key, _ in vectors["keys"]] == vectors["keys"]
    assert {number for _, number in vectors["keys"]} == {None, *range(len(servers.addresses))}


def test_addresses_are_those_of_the_vectors() -> None:
    vectors = json.loads((FOLDER / "addresses.json").read_text())
    assert [[address, is_address(address)] for address, _ in vectors] == vectors


def test_the_script_writes_the_vectors(writer: ModuleType) -> None:
    assert {path.name: path.read_text() for path in FOLDER.glob("*.json")} == writer.written()


def servers_of(count: int, level: int) -> ServersRecord:
    return ServersRecord(RULE, level, tuple(f"../{number}/" for number in range(count)))


levels = st.integers(0, 12)
grids = st.builds(lambda *axes: Grid(4.0, 16, (0.0, 0.0, 0.0), axes), *[st.integers(0, 12)] * 3)
cells = st.builds(CellKey, levels, *[st.integers(-5000, 5000)] * 3)


@given(grids, st.integers(1, 256), levels, cells)
def test_all_keys_at_and_below_a_cell_of_the_level_are_together(
    grid: Grid, count: int, level: int, cell: CellKey
) -> None:
    servers = servers_of(count, level)
    names = [
        keys.index_key(cell, HASH),
        keys.orthoview_key(cell, 25, 1, HASH),
        keys.objects_key(cell, 0, 0, HASH),
        keys.geometry_key(cell, HASH),
        keys.record_key(cell),
    ]
    found = {servers.server_of(name, grid) for name in names}
    assert len(found) == 1
    (number,) = found
    if cell.level > level:
        assert number is None
        return
    assert number in range(count)
    above = grid.ancestor(cell, level)
    assert servers.server_of(keys.orthoview_key(above, 4, 0, "f" * 16), grid) == number


@given(st.integers(1, 256), levels, st.from_regex(r"\A(mesh|texture|attributes)/[0-9a-f]{16}\Z"))
def test_shared_values_go_by_their_hash(count: int, level: int, key: str) -> None:
    servers, grid = servers_of(count, level), Grid(4.0, 16, (0.0, 0.0, 0.0), (3, 3, 0))
    number = servers.server_of(key, grid)
    assert number in range(count)
    assert servers.server_of(f"mesh/{key[-16:]}", grid) == number


@pytest.mark.parametrize("count", [2, 3, 4, 5, 7, 8, 16])
def test_subtrees_spread_over_the_servers(count: int) -> None:
    """A flat world of 2^k x 2^k cells, as `level_for` would take, with its corner anywhere."""
    side = 1
    while side * side < 16 * count:
        side *= 2
    grid, servers = Grid(4.0, 16, (0.0, 0.0, 0.0), (12, 12, 0)), servers_of(count, 3)
    for first in (0, -side // 2, 100, 777):
        shares = [0] * count
        for x in range(first, first + side):
            for y in range(first, first + side):
                number = servers.server_of(keys.index_key(CellKey(3, x, y, 0), HASH), grid)
                assert number is not None
                shares[number] += 1
        mean = side * side / count
        assert max(shares) < 1.9 * mean
        assert min(shares) > 0.3 * mean


def test_the_level_has_cells_enough() -> None:
    grid = Grid(8.0, 64, (0.0, 0.0, 0.0), (7, 7, 2))
    town = ((0.0, 0.0, 0.0), (1024.0, 1024.0, 10.0))
    assert level_for(grid, town, 4) == 4, "8 x 8 cells of 128 m"
    assert level_for(grid, town, 16) == 3
    assert level_for(grid, town, 1) == 5, "no lower than it must be"
    assert level_for(grid, town, 256) == 1
    assert level_for(grid, ((3.0, 3.0, 0.0), (9.0, 9.0, 1.0)), 2) == 0, "there are fewer"


# Manifests


def manifest(servers: Any) -> bytes:
    return json.dumps({**json.loads(golden()[KEY]), "servers": servers}).encode()


GOOD = {"rule": RULE, "level": 1, "addresses": ["https://a.example.org/", "../b/"]}


def test_a_manifest_with_servers() -> None:
    found = decode_manifest(manifest({**GOOD, "later": 1}))
    assert found.servers == ServersRecord(RULE, 1, ("https://a.example.org/", "../b/"))
    assert decode_manifest(encode_manifest(found)) == found
    assert b"servers" not in encode_manifest(decode_manifest(golden()[KEY]))


def test_servers_come_and_go_without_a_trace() -> None:
    """Members of later versions stay, and numbers are written as they were."""
    plain = golden()[KEY]
    assert plain == encode_manifest(decode_manifest(plain))
    plain = plain.replace(b'"crs": null', b'"later": {"a": [1e-7, 10.0, "\\u00fc"]},\n  "crs": null')
    whole = with_servers(plain, None)
    split = with_servers(plain, servers_of(3, 1))
    assert decode_manifest(split).servers == servers_of(3, 1)
    assert with_servers(split, None) == whole
    assert json.loads(whole) == json.loads(plain)
    assert b"1e-7" in whole


@pytest.mark.parametrize(
    "servers",
    [
        None,
        [],
        "a",
        {},
        {**GOOD, "rule": None},
        {**GOOD, "level": -1},
        {**GOOD, "level": 41},
        {**GOOD, "level": 1.5},
        {**GOOD, "addresses": []},
        {**GOOD, "addresses": ["../a/", "../a/"]},
        {**GOOD, "addresses": ["../a/", 1]},
        {**GOOD, "addresses": ["../a/", "/etc/"]},
        {**GOOD, "addresses": ["../../a/"]},
        {**GOOD, "addresses": ["file:///etc/"]},
        {**GOOD, "addresses": ["https://user:secret@a.example.org/"]},
        {**GOOD, "addresses": ["https://" + "a" * 300 + "/"]},
        {**GOOD, "addresses": [f"../{number}/" for number in range(257)]},
        {"level": 1, "addresses": ["../a/"]},
    ],
)
def test_damaged_servers_are_refused(servers: Any) -> None:
    with pytest.raises(NotAWorldError, match="damaged manifest"):
        decode_manifest(manifest(servers))


@pytest.mark.parametrize("other", [{}, {"level": "x"}, {"shards": [1]}])
def test_a_rule_of_later_versions_is_refused_as_such(other: dict[str, Any]) -> None:
    with pytest.raises(VersionError, match=r"by the rule 'hilbert'.*upgrade farfield"):
        decode_manifest(manifest({**other, "rule": "hilbert"}))
