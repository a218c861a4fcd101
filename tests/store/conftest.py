"""Buckets on a local server."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from uuid import uuid4

import pytest

from store.s3_server import environment, make_bucket, s3_server


@pytest.fixture(scope="session")
def s3_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server that speaks S3, one for all tests."""
    with s3_server(tmp_path_factory.mktemp("s3") / "log.txt") as address:
        yield address


@pytest.fixture
def new_bucket(s3_address: str, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Makes buckets; gives their URLs."""
    for name, value in environment(s3_address).items():
        monkeypatch.setenv(name, value)

    def make() -> str:
        name = f"b{uuid4().hex[:12]}"
        make_bucket(s3_address, name)
        return f"s3://{name}"

    return make
