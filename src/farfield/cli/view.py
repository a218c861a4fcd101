"""`farfield view`: a world, or anything that can be read, in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import BandwidthOption, HostOption, JsonOption, OpenedOption, PortOption
from farfield.cli.progress import shown_progress
from farfield.cli.serving import ServeRequest, cache_folder, serve_world

PathArgument = Annotated[str, typer.Argument(metavar="PATH", help="A baked world, or a source as for bake.")]
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
    serve_world(path if _is_store(path) else _baked(Path(path), output or _place_for(Path(path))), request)


def _is_store(path: str) -> bool:
    from farfield.store.opening import is_archive, is_url

    return is_url(path) or is_archive(path) or Path(path).is_dir()


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
