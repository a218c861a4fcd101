"""Builds the viewer into the wheel (and the source distribution) where it is not built yet."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent / "scripts"))
import viewer


class ViewerHook(BuildHookInterface[Any]):
    """Runs before hatchling gathers the files."""

    def dependencies(self) -> list[str]:
        """Node, as a package of the build environment, where the system has none."""
        return [viewer.NODE_PACKAGE] if self._due() and viewer.system_node() is None else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page, except for an editable install: there `make viewer` does it."""
        if version != "editable" and self._due():
            viewer.build()

    def _due(self) -> bool:
        return (viewer.VIEWER / "package.json").exists() and not (viewer.STATIC / "index.html").exists()
