"""`farfield demo`: the bundled scene, baked once, in the browser."""

from __future__ import annotations

from pathlib import Path

from farfield.cli.options import BandwidthOption, HostOption, JsonOption, OpenedOption, PortOption
from farfield.cli.progress import shown_progress
from farfield.cli.serving import ServeRequest, cache_folder, is_world, serve_world

SCENE = Path(__file__).parent.parent / "demo" / "scene.toml"
"""The bundled scene; what it is made of, by whom, stands beside it."""

RESOLUTION = 256
"""Pixels of an orthoview across a leaf: a quarter of the default's work, so that the first time is short."""


def command(
    host: HostOption = "127.0.0.1",
    port: PortOption = None,
    open_browser: OpenedOption = True,
    bandwidth: BandwidthOption = None,
    as_json: JsonOption = False,
) -> None:
    """Bake the bundled scene (the first time), serve it and open the browser."""
    serve_world(demo_world(), ServeRequest(host, port, bandwidth, open_browser, as_json))


def demo_world() -> Path:
    """The folder of the bundled scene's world, baked unless it is there. Raises FarfieldError."""
    place = cache_folder() / f"demo-{_fingerprint()}"
    if not is_world(place):
        _bake(place)
    return place


def _bake(place: Path) -> None:
    from farfield.bake.options import BakeOptions
    from farfield.pipeline import bake_sources

    with shown_progress() as progress:
        bake_sources([SCENE], place, BakeOptions(resolution=RESOLUTION), progress)


def _fingerprint() -> str:
    """Of everything that decides what the demo looks like: after a change it is baked anew, to another place."""
    from hashlib import blake2b

    from farfield.bake.options import BAKE_VERSION

    digest = blake2b(f"{BAKE_VERSION} {RESOLUTION}".encode(), digest_size=6)
    for path in sorted(SCENE.parent.iterdir()):
        if path.is_file():
            digest.update(path.read_bytes())
    return digest.hexdigest()
