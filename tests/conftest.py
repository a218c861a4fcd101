"""What every test may ask for."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


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
