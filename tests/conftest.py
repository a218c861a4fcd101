"""What every test may ask for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from s3_server import environment, make_bucket, s3_server

REPOSITORY = Path(__file__).parent.parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow tests may take as long as they need; of all others none takes minutes unless it hangs."""
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.timeout(0))


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
def s3_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server that speaks S3, one for all tests; skips where its package is missing."""
    with s3_server(tmp_path_factory.mktemp("s3") / "log.txt") as address:
        yield address


@pytest.fixture
def new_bucket(s3_address: str, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Makes empty buckets there; gives their URLs."""
    for name, value in environment(s3_address).items():
        monkeypatch.setenv(name, value)

    def make() -> str:
        name = f"b{uuid4().hex[:12]}"
        make_bucket(s3_address, name)
        return f"s3://{name}"

    return make
