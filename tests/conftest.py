"""What every test may ask for."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


def _drop_stale_kernels() -> None:
    """Remove compiled kernels that are older than a module they import from.

    Numba compares a cached kernel with its own file only: after an edit of a helper in another file it would go on
    using what it compiled from the old one, and tests would pass or fail for code that is no longer there.
    """
    folder = REPOSITORY / "src/farfield/kernels"
    sources = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    imported = {name: {other for other in sources if _imports(text, other)} for name, text in sources.items()}
    for name in sources:
        needed, pending = {name}, [name]
        while pending:
            new = imported[pending.pop()] - needed
            needed |= new
            pending += new
        newest = max((folder / f"{one}.py").stat().st_mtime for one in needed)
        for index in (folder / "__pycache__").glob(f"{name}.*.nbi"):
            if index.stat().st_mtime < newest:
                index.unlink(missing_ok=True)


def _imports(text: str, module: str) -> bool:
    return re.search(rf"^from farfield\.kernels(\.{module} import| import .*\b{module}\b)", text, re.M) is not None


_drop_stale_kernels()


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """The path of a file or folder of the large public inputs; skips the test, with a reason, where it is absent."""
    root = Path(os.environ.get("FARFIELD_SHARED_DATA", REPOSITORY.parent / "shared/data"))

    def find(name: str) -> Path:
        path = root / name
        if not path.exists():
            pytest.skip(f"needs {name} of the large inputs: set FARFIELD_SHARED_DATA (now {root})")
        return path

    return find


@pytest.fixture(scope="session")
def chromium() -> str | None:
    """Path of the system's Chromium; None when Playwright's own is to be used."""
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    return next(filter(None, found), None)
