"""The built viewer: `index.html` and what lies under `viewer/`, brought by the package."""

from __future__ import annotations

from pathlib import Path

from farfield.store import DirectoryStore, Store
from farfield.store.once import put_once

STATIC = Path(__file__).parent / "static"
"""Where the viewer's build puts its files; absent in a clone where it has not run."""


def page_store() -> Store:
    """The viewer's files as a store; empty where the viewer is not built."""
    return DirectoryStore(STATIC)


def install_viewer(world: Store) -> int:
    """Copy the viewer into a world, so that any file server shows it; returns how many files changed.

    The page finds `world.json` beside itself. Nothing is copied where the viewer is not built.

    Raises StoreError: the world cannot be written.
    """
    page = page_store()
    changed = 0
    # The page itself comes last: whoever loads it finds the files it names.
    for key in sorted(page.list(), key=lambda key: key == "index.html"):
        changed += put_once(world, key, page.get(key))
    return changed
