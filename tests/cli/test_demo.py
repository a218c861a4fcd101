"""The demo: baked where there is none yet, only served where there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from farfield.cli import demo, main
from farfield.cli.serving import ServeRequest, cache_folder
from farfield.world.manifest import GridRecord, Manifest, encode_manifest

BOUNDS = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What was done, in order, with stand-ins for the bake and the server."""
    seen: list[str] = []

    def bake(place: Path) -> None:
        seen.append("bake")
        place.mkdir(parents=True)
        manifest = Manifest(bounds=BOUNDS, grid=GridRecord(1.0, 64, (0.0, 0.0, 0.0), (0, 0, 0)), directions=())
        (place / "world.json").write_bytes(encode_manifest(manifest))

    def serve(place: Path, request: ServeRequest) -> None:
        assert place.parent == cache_folder()
        assert request.open_browser
        seen.append("serve")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(demo, "_bake", bake)
    monkeypatch.setattr(demo, "serve_world", serve)
    return seen


def test_it_is_baked_once(seen: list[str]) -> None:
    assert main(["demo"]) == 0
    assert main(["demo"]) == 0
    assert seen == ["bake", "serve", "serve"]


def test_it_is_baked_again_after_a_change(seen: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert main(["demo"]) == 0
    (tmp_path / "scene.toml").write_text("# another")
    monkeypatch.setattr(demo, "SCENE", tmp_path / "scene.toml")
    assert main(["demo"]) == 0
    assert seen == ["bake", "serve", "bake", "serve"]


def test_the_bundled_scene_is_there_with_its_credits() -> None:
    assert demo.SCENE.is_file()
    assert "credits" in demo.SCENE.read_text(encoding="utf-8")
    assert any((demo.SCENE.parent / "LICENSES").iterdir())
