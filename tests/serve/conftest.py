"""A small world to serve, and servers for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient

from farfield.serve import batch, viewer_files
from farfield.serve.app import create_app
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore, MemoryStore, Store
from farfield.world.index import IndexTile, encode_index
from farfield.world.keys import content_hash, geometry_key, index_key, mesh_key, orthoview_key
from farfield.world.manifest import DirectionRecord, GridRecord, Manifest, RootRecord, encode_manifest
from serve.small_world import PAGE, VALUES, filled
from stream.cells import GRID, SHARED, flat_tree


@pytest.fixture
def world(tmp_path: Path) -> Store:
    return filled(DirectoryStore(tmp_path / "world"), VALUES)


@pytest.fixture
def client(world: Store) -> TestClient:
    return TestClient(create_app(world, filled(MemoryStore(), PAGE)))


@pytest.fixture
def server(world: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """URL of a server that has little patience, and a page of two files."""
    page = filled(DirectoryStore(tmp_path / "static"), PAGE)
    monkeypatch.setattr(viewer_files, "STATIC", Path(page.location))
    monkeypatch.setattr(batch, "BODY_SECONDS", 1.5)
    with serving(world, ServeOptions(port=0, stall_seconds=1.5)) as url:
        yield url


@pytest.fixture
def real_world(tmp_path: Path) -> Store:
    """An empty world with a manifest that readers accept."""
    manifest = Manifest(
        bounds=((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), grid=GridRecord(1.0, 64, (0.0, 0.0, 0.0), (0, 0, 0)), directions=()
    )
    return filled(DirectoryStore(tmp_path / "real"), {"world.json": encode_manifest(manifest)})


@pytest.fixture(scope="session")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The flat tree of the scheduler's tests, with values of the sizes that it names."""
    store = DirectoryStore(tmp_path_factory.mktemp("push") / "world")
    tree, random = flat_tree(), np.random.default_rng(3)
    for entry in tree.entries:
        for direction, layer, size in entry.tiles:
            store.put(orthoview_key(entry.cell, direction, layer, entry.hash), random.bytes(size))
        if entry.geometry:
            store.put(geometry_key(entry.cell, entry.geometry.hash), random.bytes(entry.geometry.bytes))
    store.put(mesh_key(SHARED[0]), random.bytes(SHARED[1]))
    tile = encode_index(IndexTile(tree.entries[0].key, tuple(tree.entries)))
    store.put(index_key(tree.entries[0].cell, content_hash(tile)), tile)
    manifest = Manifest(
        bounds=((0.0, 0.0, 0.0), (64.0, 64.0, 4.0)),
        grid=GridRecord(GRID.leaf_size, GRID.resolution, GRID.corner, GRID.axis_levels),
        directions=tuple(
            DirectionRecord(n, vector) for n, vector in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        ),
        roots=(RootRecord(tree.entries[0].key, content_hash(tile)),),
        generation=4,
    )
    store.put("world.json", encode_manifest(manifest))
    return store
