"""A small world to serve, and servers for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from farfield.serve import batch, viewer_files
from farfield.serve.app import create_app
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore, MemoryStore, Store
from farfield.world.manifest import GridRecord, Manifest, encode_manifest
from serve.small_world import PAGE, VALUES, filled


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
