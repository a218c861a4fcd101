"""What the page of the comparison needs, on one server: itself, the npm packages, and a world or a tileset."""

from __future__ import annotations

import mimetypes
from pathlib import Path

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from farfield.serve.app import create_app
from farfield.serve.viewer_files import page_store
from farfield.store.opening import open_store
from mesh_levels.packages import FOLDER, node_modules

WORLD, TILES = "/world/", "/tiles/"


def site(shown: Path) -> ASGIApp:
    """shown: folder of a world or of a tileset."""
    world = (shown / "world.json").exists()
    farfield = create_app(open_store(shown), page_store()) if world else None

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        path = scope["path"]
        if farfield is not None and path.startswith(WORLD):
            inner = path[len(WORLD) - 1 :]
            await farfield({**scope, "path": inner, "raw_path": inner.encode()}, receive, send)
            return
        folders = {"/packages/": node_modules(), "/page/": FOLDER, TILES: shown}
        for prefix, folder in folders.items():
            if path.startswith(prefix):
                await _file(folder / path[len(prefix) :], Request(scope))(scope, receive, send)
                return
        await PlainTextResponse("nothing here", 404)(scope, receive, send)

    return app


def counted(path: str) -> bool:
    """Whether a path is part of what is shown, and not of the page that shows it."""
    values = path.startswith((WORLD, TILES)) and not path.startswith((WORLD + "viewer/", WORLD + "events"))
    return values


def _file(path: Path, request: Request) -> Response:
    """A file for ever, or FILE.gz beside it."""
    if not path.is_file():
        return PlainTextResponse(f"no {path.name}", 404)
    headers = {"Cache-Control": "public, max-age=31536000, immutable"}
    small = path.with_name(path.name + ".gz")
    if small.exists() and "gzip" in request.headers.get("Accept-Encoding", ""):
        headers["Content-Encoding"] = "gzip"
        path, kind = small, mimetypes.guess_type(path.name)[0]
    else:
        kind = mimetypes.guess_type(path.name)[0]
    return Response(path.read_bytes(), media_type=kind or "application/octet-stream", headers=headers)
