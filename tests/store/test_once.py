"""A value named by its content is written where it is not, or is another."""

from __future__ import annotations

import pytest

from farfield.store import MemoryStore
from farfield.store.once import put_once


@pytest.mark.parametrize(("before", "written"), [(None, True), (b"whole", False), (b"whule", True), (b"", True)])
def test_what_is_there_is_left_if_it_is_whole(before: bytes | None, written: bool) -> None:
    store = MemoryStore()
    if before is not None:
        store.put("a/b", before)
    assert put_once(store, "a/b", b"whole") is written
    assert store.get("a/b") == b"whole"
