"""A baked world, a server and a real Chromium."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, WebSocketRoute

from e2e.browsing import Visit, opened_browser
from e2e.world import town
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.serve.run import ServeOptions, serving
from farfield.serve.viewer_files import STATIC
from farfield.store import DirectoryStore

Stream = Callable[[WebSocketRoute], None]
"""What answers in place of the server's sessions."""

OPTIONS = BakeOptions(leaf_size=8.0, resolution=32, directions="9", workers=2)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All of these need Chromium."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> DirectoryStore:
    """The town, baked."""
    if not (STATIC / "index.html").exists():
        pytest.skip("the viewer is not built: make viewer")
    store = DirectoryStore(tmp_path_factory.mktemp("e2e") / "town")
    bake(town(), store, OPTIONS)
    return store


@pytest.fixture(scope="session")
def address(world: DirectoryStore) -> Iterator[str]:
    """Where the town is served."""
    with serving(world, ServeOptions(port=0)) as url:
        yield url


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium that draws in software."""
    with opened_browser() as opened:
        yield opened


@pytest.fixture
def visit(browser: Browser) -> Iterator[Callable[..., Visit]]:
    """Opens pages, each of its own; errors on a console fail the test unless it says that it expects them."""
    visits: list[Visit] = []

    def opened(url: str, *, script: str = "", stream: Stream | None = None, expect_errors: bool = False) -> Visit:
        page = browser.new_context(viewport={"width": 640, "height": 480}).new_page()
        page.set_default_timeout(60_000)
        if script:
            page.add_init_script(script)
        if stream:
            page.route_web_socket("**/stream", stream)
        visits.append(Visit(page, expect_errors))
        page.goto(url)
        if "getContext" not in script:
            page.wait_for_function("window.farfield !== undefined")
        return visits[-1]

    yield opened
    for made in visits:
        # Errors may still be on their way.
        time.sleep(0.05)
        made.page.context.close()
    assert [error for made in visits if not made.expect_errors for error in made.errors] == []
