"""`farfield view`: a world, or anything that can be read, in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import BandwidthOption, HostOption, JsonOption, OpenedOption, PortOption
from farfield.cli.progress import shown_progress
from farfield.cli.serving import ServeRequest, cache_folder, serve_world

PathArgument = Annotated[Path, typer.Argument(metavar="PATH", help="Folder of a world, or a source as for bake.")]
OutputOption = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="WORLD", help="Where to bake a source to; default: the user's cache."),
]


def command(
    path: PathArgument,
    output: OutputOption = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = None,
    open_browser: OpenedOption = True,
    bandwidth: BandwidthOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show PATH in the browser; a source is baked first, unless it is baked already."""
    request = ServeRequest(host, port, bandwidth, open_browser, as_json)
    serve_world(path if path.is_dir() else _baked(path, output or _place_for(path)), request)


def _baked(source: Path, place: Path) -> Path:
    from farfield.pipeline import bake_sources

    with shown_progress() as progress:
        bake_sources([source], place, progress=progress)
    return place


def _place_for(source: Path) -> Path:
    """A folder of the cache that belongs to this source alone."""
    from hashlib import blake2b

    digest = blake2b(str(source.resolve()).encode(), digest_size=6).hexdigest()
    return cache_folder() / f"{source.stem or 'world'}-{digest}"
