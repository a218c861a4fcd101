"""Impostors as things to send: made for where the viewer will be, worse the farther it goes from there."""

from __future__ import annotations

import numpy as np
import pytest

from farfield.stream.accuracy import impostor_accuracy
from farfield.stream.impostors import ROWS, SHARP, Impostors, SentImpostor, estimated_bytes
from farfield.stream.link import Link
from farfield.stream.offers import SHARES, FixedObjects
from farfield.stream.outlook import look
from farfield.stream.scheduler import Scheduler
from stream.test_motion import predicted, viewing

AHEAD = (-1.0, 9.0, -1.0, 1.0, 11.0, 1.0)
BOXES = np.array([AHEAD, (19.0, -1.0, -1.0, 21.0, 1.0, 1.0)])
FAR = 100.0


def test_offered_from_where_the_viewer_stands() -> None:
    outlook = look(predicted(viewing()), BOXES, 0.0, FAR)
    impostors = Impostors(BOXES)
    offers = impostors.offers(outlook)
    first = [n for n in range(len(offers.sizes)) if offers.objects[n] == 0]
    taken = [impostors.take(n) for n in first]
    assert [one.rows for one in taken] == [n for n in ROWS if n <= SHARP * outlook.height[0, 0]]
    assert {one.eye for one in taken} == {(0.0, 0.0, 0.0)}
    expected = impostor_accuracy([one.rows for one in taken], outlook.height[0, 0], np.pi / 2)
    np.testing.assert_allclose(offers.accuracy[first, 0], expected, rtol=1e-6)


@pytest.mark.parametrize(("degrees", "left"), [(0, 1.0), (25, 1.0), (60, 3**-1.5), (95, 0.0)])
def test_held_ones_fade_as_the_viewer_goes_round(degrees: float, left: float) -> None:
    """Made from the south; the viewer is so many degrees round the object, as far away, and looks at it."""
    impostors = Impostors(np.array([AHEAD]))
    impostors.held.append(SentImpostor(0, 512, (0.0, 0.0, 0.0)))
    angle = np.radians(degrees)
    eye = (10 * np.sin(angle), 10 - 10 * np.cos(angle), 0.0)
    outlook = look(predicted(viewing(0.0, eye, forward=(-np.sin(angle), np.cos(angle), 0.0))), BOXES[:1], 0.0, FAR)
    best = np.zeros((1, 1, len(SHARES)), np.float32)
    impostors.shown(outlook, best)
    assert best[0, 0] == pytest.approx([left] * len(SHARES), abs=1e-6)


def test_who_moves_gets_the_view_half_way() -> None:
    seen = predicted(viewing(velocity=(0, 2, 0)))
    outlook = look(seen, BOXES[:1], 0.0, FAR)
    impostors = Impostors(BOXES[:1])
    impostors.offers(outlook)
    eye = impostors.take(0).eye
    assert eye in [tuple(row) for row in outlook.eyes.tolist()]
    assert 0 < eye[1] < 10


def test_finer_ones_cost_more() -> None:
    sizes = [int(estimated_bytes(rows, np.array([0.5]))[0]) for rows in ROWS]
    assert sizes == sorted(set(sizes))


def test_the_scheduler_takes_them_with_others() -> None:
    one = Scheduler(FixedObjects(BOXES), [Impostors(BOXES)], FAR, Link(2_000, 0.0))
    one.follow(viewing(), 0.0)
    choice = one.next(0.0)
    assert choice is not None
    assert choice.item.object == 0
    assert choice.size == int(estimated_bytes(choice.item.rows, np.array([2**0.5]))[0])
    # What is behind comes last: the viewer may turn.
    order = [choice.item.object]
    while choice := one.next(0.0):
        order.append(choice.item.object)
    assert order.index(1) > 0
