"""Orders of a few items: against all permutations, one after the other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from farfield.kernels.benefit import added_benefits
from farfield.kernels.orders import best_totals, gains_beside, largest

INTERVALS, PARTS, THINGS = 3, 2, 6
BOUNDS = np.array([0.0, 0.5, 2.0, 4.0])
LEAST = 0.02


class Items:
    """Items with objects, some of which they share."""

    def __init__(self, random: np.random.Generator, count: int, is_shared: bool) -> None:
        of_each = [np.sort(random.permutation(THINGS)[:3]) if is_shared else np.array([n]) for n in range(count)]
        self.items = np.arange(count)
        self.firsts = np.concatenate([[0], np.cumsum([len(own) for own in of_each])])
        self.objects = np.concatenate(of_each).astype(np.int32)
        self.accuracy = random.random((len(self.objects), INTERVALS), np.float32)
        self.parts = random.integers(1, PARTS + 1, count, dtype=np.int32)
        self.held = random.random((THINGS, INTERVALS, PARTS), np.float32) * np.float32(random.random() < 0.5)
        self.visible = random.random((THINGS, INTERVALS), np.float32) * 100
        self.weights = np.array([0.3, 0.7], np.float32)
        self.seconds = random.uniform(0.05, 1.0, count)

    def gains(self) -> np.ndarray:
        count = len(self.items)
        places, found = np.full((count, THINGS), -1, np.int32), np.zeros((count, count, INTERVALS))
        gains_beside(
            self.items, self.firsts, self.parts, self.objects, self.accuracy, self.held, self.visible, self.weights,
            LEAST, places, found,
        )  # fmt: skip
        return found

    def added(self, item: int, arrival: float, held: np.ndarray) -> float:
        found = np.zeros(1)
        added_benefits(
            np.array([item]), np.array([arrival]), self.firsts, self.parts, self.objects, self.accuracy, held,
            self.visible, BOUNDS, self.weights, LEAST, found,
        )  # fmt: skip
        return float(found[0])

    def beside(self, item: int, held: np.ndarray) -> np.ndarray:
        """What is held with an item."""
        found = held.copy()
        for use in range(self.firsts[item], self.firsts[item + 1]):
            shown = found[self.objects[use], :, : self.parts[item]]
            np.maximum(shown, self.accuracy[use][:, None], out=shown)
        return found

    def total(self, order: tuple[int, ...], before: float) -> float:
        held, total = self.held, 0.0
        for item in order:
            before += self.seconds[item]
            total += self.added(item, before, held)
            held = self.beside(item, held)
        return total


def totals_of(items: Items, before: float) -> np.ndarray:
    count = len(items.items)
    found = np.zeros(count)
    best_totals(items.gains(), items.seconds, before, BOUNDS, np.zeros((2, 1 << count)), found)
    return found


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_the_best_orders_of_items_that_share_nothing(count: int) -> None:
    for seed in range(20):
        items = Items(np.random.default_rng(seed), count, is_shared=False)
        best = [
            max(items.total((first, *rest), 0.3) for rest in itertools.permutations(set(range(count)) - {first}))
            for first in range(count)
        ]
        np.testing.assert_allclose(totals_of(items, 0.3), best, rtol=1e-5)


def test_two_items_that_share_objects() -> None:
    for seed in range(40):
        items = Items(np.random.default_rng(seed), 2, is_shared=True)
        best = [items.total(order, 0.1) for order in ((0, 1), (1, 0))]
        np.testing.assert_allclose(totals_of(items, 0.1), best, rtol=1e-5)


def test_no_item_adds_more_beside_others_than_alone() -> None:
    gains = Items(np.random.default_rng(1), 5, is_shared=True).gains()
    assert (gains <= gains[np.arange(5), np.arange(5)][:, None]).all()


def test_the_largest_first_and_of_equal_ones_the_first() -> None:
    random = np.random.default_rng(2)
    for count in (1, 3, 10, 100):
        values = random.integers(0, 10, count).astype(float)
        found = np.zeros(min(count, 4), np.int64)
        largest(values, found)
        assert found.tolist() == np.argsort(-values, kind="stable")[: len(found)].tolist()
