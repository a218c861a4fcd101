"""Where cases are judged."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from fuzz.apart import Apart


@pytest.fixture(scope="session")
def apart() -> Iterator[Apart]:
    """A process of its own."""
    process = Apart()
    yield process
    process.end()
