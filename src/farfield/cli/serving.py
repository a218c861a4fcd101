"""What `serve`, `view` and `demo` have in common: serving a world and saying where."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import typer

from farfield.cli.output import report


@dataclass(frozen=True, slots=True)
class ServeRequest:
    """What the user asked for; the options are those of `farfield serve`."""

    host: str
    port: int | None
    bandwidth: float | None
    open_browser: bool
    as_json: bool
    delay: float = 0.0
    """Milliseconds."""


def serve_world(place: str | Path, request: ServeRequest) -> None:
    """Serve the world at `place` until interrupted; says the URL on stdout. Raises FarfieldError."""
    from farfield.serve.run import ServeOptions, serve
    from farfield.store import CachedStore
    from farfield.store.opening import is_url
    from farfield.world.manifest import KEY
    from farfield.world.split import open_served

    # Only the manifest is read: whatever reads tiles loads the kernels, 2 s that a server has no need of.
    store = open_served(place)
    if is_url(store.location):
        # A browser's request for a tile is then one request to the bucket, not one for each of its size and parts.
        store = CachedStore(store, frozenset({KEY}))
    options = ServeOptions(
        request.host, request.port, request.bandwidth, request.delay / 1000, open_browser=request.open_browser
    )

    def announce(url: str) -> None:
        report({"url": url}, as_json=request.as_json, text=f"{place} is at {url} (Ctrl-C ends it)")

    serve(store, options, announce)
    if not request.as_json:
        typer.echo("", err=True)


def cache_folder() -> Path:
    """Where worlds are kept that nobody gave a place: `worlds` in farfield's folder of the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "farfield" / "worlds"


def is_world(place: Path) -> bool:
    """Whether there is a finished world at `place` that this version reads."""
    from farfield.errors import FarfieldError
    from farfield.store import open_store
    from farfield.world.manifest import read_manifest

    try:
        read_manifest(open_store(place))
    except FarfieldError:
        return False
    return True
