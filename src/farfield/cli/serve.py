"""`farfield serve`: a world over HTTP, with the viewer."""

from __future__ import annotations

from farfield.cli.options import (
    BandwidthOption,
    DelayOption,
    HostOption,
    JsonOption,
    OpenOption,
    PortOption,
    WorldArgument,
)
from farfield.cli.serving import ServeRequest, serve_world


def command(
    world: WorldArgument,
    host: HostOption = "127.0.0.1",
    port: PortOption = None,
    open_browser: OpenOption = False,
    bandwidth: BandwidthOption = None,
    delay: DelayOption = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Serve WORLD and the viewer until interrupted."""
    serve_world(world, ServeRequest(host, port, bandwidth, open_browser, as_json, delay))
