"""A bake straight into a bucket gives what a bake into memory gives."""

from __future__ import annotations

from collections.abc import Callable

from bake.scenes import village
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.store import MemoryStore, open_store


def test_a_bucket_is_a_place_to_bake(new_bucket: Callable[[], str]) -> None:
    place = f"{new_bucket()}/village"
    bucket, memory = open_store(place, create=True), MemoryStore()
    options = {"leaf_size": 8.0, "resolution": 16, "directions": "5"}
    bake(village(), bucket, BakeOptions(workers=2, **options))  # type: ignore[arg-type]
    bake(village(), memory, BakeOptions(workers=1, **options))  # type: ignore[arg-type]
    assert {key: bucket.get(key) for key in bucket.list()} == {key: memory.get(key) for key in memory.list()}
    again = bake(village(), open_store(place, create=True), BakeOptions(workers=1, **options))  # type: ignore[arg-type]
    assert again.cells_rebuilt == 0
