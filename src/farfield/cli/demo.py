"""`farfield demo`: the bundled scene, baked once, in the browser."""

from __future__ import annotations

from pathlib import Path

from farfield.cli.options import BandwidthOption, HostOption, JsonOption, OpenedOption, PortOption
from farfield.cli.progress import shown_progress
from farfield.cli.serving import ServeRequest, cache_folder, is_world_of_this_version, serve_world

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
    place = cache_folder() / "demo"
    if not is_world_of_this_version(place):
        _bake(place)
    serve_world(place, ServeRequest(host, port, bandwidth, open_browser, as_json))


def _bake(place: Path) -> None:
    from farfield.bake.options import BakeOptions
    from farfield.pipeline import bake_sources

    with shown_progress() as progress:
        bake_sources([SCENE], place, BakeOptions(resolution=RESOLUTION), progress)
