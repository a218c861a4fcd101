"""Records come back in order, whatever the memory for them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.scene.stored import sorting
from farfield.scene.stored.sorting import SortedRecords, grouped

KIND = np.dtype([("first", "<i8"), ("second", "<i8"), ("rest", "<i4")])
KEYS = st.lists(st.tuples(st.integers(-3, 3), st.integers(-(1 << 62), 1 << 62)), unique=True, max_size=60)


@given(KEYS, st.integers(1, 9), st.integers(1, 20))
def test_records_are_sorted(keys: list[tuple[int, int]], rows: int, portion: int) -> None:
    records = np.array([(a, b, number) for number, (a, b) in enumerate(keys)], KIND)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sorting, "_LEAST", 2)
        held = SortedRecords(Path(folder) / "records", KIND, rows)
        for start in range(0, len(records), portion):
            held.add(records[start : start + portion])
        batches = list(held.batches())
        groups = list(grouped(iter(batches)))
    expected = np.sort(records, order=["first", "second"])
    found = np.concatenate([*batches, np.empty(0, KIND)])
    np.testing.assert_array_equal(found, expected)
    assert [value for value, _ in groups] == sorted({a for a, _ in keys})
    for value, group in groups:
        np.testing.assert_array_equal(group, expected[expected["first"] == value])


def test_memory_is_that_of_a_few_batches() -> None:
    with tempfile.TemporaryDirectory() as folder:
        held = SortedRecords(Path(folder) / "records", KIND, 5000)
        for start in range(0, 100_000, 1000):
            records = np.zeros(1000, KIND)
            records["first"] = np.arange(start, start + 1000) * 7919 % 100_003
            held.add(records)
        sizes = [len(batch) for batch in held.batches()]
    assert sum(sizes) == 100_000
    assert max(sizes) <= 20 * 1024
