"""Choices: hand-made cases, and the greedy order against the best of all orders."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from farfield.stream.accuracy import level_accuracy
from farfield.stream.levels import NONE, Levels, MeshLevels, SentLevel
from farfield.stream.link import OVERHEAD, Link
from farfield.stream.motion import Viewing
from farfield.stream.offers import FixedObjects
from farfield.stream.outlook import look
from farfield.stream.scheduler import OTHERWISE, Choice, Scheduler
from stream.test_motion import predicted, viewing

FAR = 100.0
MESH = MeshLevels(faces=(50, 500, 5000), sizes=(1_000, 10_000, 100_000))


def scheduler(boxes: Sequence[Sequence[float]], meshes: Sequence[MeshLevels], mesh_of: Sequence[int]) -> Scheduler:
    levels = Levels(meshes, np.array(mesh_of, np.int32))
    return Scheduler(
        FixedObjects(np.array(boxes, float).reshape(-1, 6)), [levels], FAR, Link(bandwidth=10_000, latency=0.0)
    )


def chosen(scheduler: Scheduler, seen: Viewing, most: int = 99) -> list[Choice]:
    """What is sent, one after the other, as the link takes it."""
    now, found = seen.time, []
    while len(found) < most:
        scheduler.follow(Viewing(now, seen.eye, seen.forward, seen.fov, seen.size, seen.velocity, seen.turning), now)
        choice = scheduler.next(now)
        if choice is None:
            break
        found.append(choice)
        now += choice.seconds
    return found


def test_what_is_large_in_the_picture_comes_first_and_what_is_behind_last() -> None:
    near, far, behind = (-1, 4, -1, 1, 6, 1), (2, 20, -1, 4, 22, 1), (-1, -6, -1, 1, -4, 1)
    found = chosen(scheduler([far, behind, near], [MESH] * 3, [0, 1, 2]), viewing())
    assert found[0].item.mesh == 2
    order = [choice.item.mesh for choice in found]
    assert order.index(1) > order.index(0)


def test_a_short_stop_sends_what_is_quick() -> None:
    one = scheduler([(-1, 4, -1, 1, 6, 1)], [MESH], [0])
    one.follow(viewing(), 0.0)
    assert one.next(0.0).item == SentLevel(0, 0)
    # The full mesh takes ten seconds: it is sent to who has stood for as long, and while there is nothing else.
    near, beside = (-1, 4, -1, 1, 6, 1), (3, 12, -1, 5, 14, 1)
    found = chosen(scheduler([near, beside], [MESH] * 2, [0, 1]), viewing())
    assert {choice.item.level for choice in found[:4]} == {0, 1}
    assert {choice.item.level for choice in found[4:]} == {2}
    stands = scheduler([near, beside], [MESH] * 2, [0, 1])
    stands.follow(viewing(0.0), 0.0)
    found = chosen(stands, viewing(60.0))
    assert SentLevel(0, 2) in [choice.item for choice in found[:4]]


def test_turning_left_sends_what_is_left() -> None:
    left, right = (-21, 1, -1, -19, 3, 1), (19, 1, -1, 21, 3, 1)
    found = chosen(scheduler([right, left], [MESH] * 2, [0, 1]), viewing(turning=0.3), most=1)
    assert found[0].item.mesh == 1


def test_going_on_sends_what_will_be_near() -> None:
    beside, ahead = (3, 3, -1, 5, 5, 1), (-1, 30, -1, 1, 32, 1)
    found = chosen(scheduler([beside, ahead], [MESH] * 2, [0, 1]), viewing(velocity=(0, 8, 0)), most=1)
    assert found[0].item.mesh == 1


def test_a_mesh_placed_many_times_is_worth_more() -> None:
    crowd = [(3 * n, 20, -1, 3 * n + 2, 22, 1) for n in range(-3, 3)]
    alone = (-1, 12, -1, 1, 14, 1)
    found = chosen(scheduler([*crowd, alone], [MESH] * 2, [0] * 6 + [1]), viewing(), most=1)
    assert found[0].item.mesh == 0


def test_textures_come_in_between() -> None:
    textured = MeshLevels((50, 500, 5000), (1_000, 10_000, 100_000), (256, 4096, 65536), (200, 2_000, 20_000))
    one = scheduler([(-1, 4, -1, 1, 6, 1)], [textured], [0])
    one.follow(viewing(0.0), 0.0)
    found = chosen(one, viewing(100.0))
    assert found[0].item == SentLevel(0, 0)
    assert any(choice.item.is_texture for choice in found[1:3])
    assert [choice.item for choice in found][-1] in (SentLevel(0, 2), SentLevel(0, 2, is_texture=True))
    # Each adds something: nothing coarser after something finer.
    for texture in (False, True):
        levels = [choice.item.level for choice in found if choice.item.is_texture == texture]
        assert levels == sorted(set(levels))


def test_importance_and_small_changes() -> None:
    boxes = np.array([(-3, 10, -1, -1, 12, 1), (1, 10, -1, 3, 12, 1)], float)
    levels = Levels([MESH] * 2, np.array([0, 1], np.int32))
    dear = Scheduler(FixedObjects(boxes, np.array([1.0, 2.0], np.float32)), [levels], FAR, Link(10_000, 0.0))
    assert chosen(dear, viewing(), most=1)[0].item.mesh == 1
    # A finer level that is hardly to be told from the one that is there stays away.
    alike = MeshLevels((5000, 5100), (1_000, 1_000))
    assert len(chosen(scheduler([(-1, 4, -1, 1, 6, 1)], [alike], [0]), viewing())) == 1


def test_nothing_to_send() -> None:
    empty = scheduler([], [], [])
    assert empty.next(0.0) is None
    assert chosen(empty, viewing()) == []
    assert chosen(scheduler([(-1, 4, -1, 1, 6, 1)], [], [NONE]), viewing()) == []


@dataclass
class Case:
    """What is expected of each object in each interval, and what each (mesh, level) gives and takes."""

    bounds: list[float]
    visible: list[list[float]]
    accuracy: dict[tuple[int, int], list[float]]
    seconds: dict[tuple[int, int], float]


def total(order: Sequence[tuple[int, int]], case: Case) -> float:
    """Pixel seconds of all objects up to the cut-off when levels are sent in this order, the link never idle."""
    arrivals, now = [], 0.0
    for item in order:
        now += case.seconds[item]
        arrivals.append(now)
    benefit = 0.0
    steps = sorted({*case.bounds, *(t for t in arrivals if t < case.bounds[-1])})
    for begin, end in itertools.pairwise(steps):
        k = bisect_right(case.bounds, begin) - 1
        best = dict.fromkeys(range(len(case.visible)), 0.0)
        for (mesh, level), arrival in zip(order, arrivals, strict=True):
            if arrival <= begin:
                best[mesh] = max(best[mesh], case.accuracy[mesh, level][k])
        benefit += (end - begin) * sum(case.visible[mesh][k] * best[mesh] for mesh in best)
    return benefit


def small_case(r: np.random.Generator) -> tuple[np.ndarray, list[MeshLevels], Viewing]:
    """Two or three objects of two levels each ahead of a viewer."""
    count = int(r.integers(2, 4))
    low = np.column_stack([r.uniform(-15, 15, count), r.uniform(8, 40, count), np.full(count, -1.0)])
    boxes = np.concatenate([low, low + r.uniform(0.5, 4, count)[:, None]], axis=1)
    meshes = []
    for _ in range(count):
        few, times, each = int(r.integers(20, 200)), int(r.integers(2, 30)), r.uniform(15, 40)
        meshes.append(MeshLevels((few, few * times), (int(few * each), int(few * times * each))))
    velocity, turning = (((0, 0, 0), 0.0), ((0, 3, 0), 0.0), ((2, 1, 0), 0.2), ((0, 0, 0), 0.2))[int(r.integers(4))]
    return boxes, meshes, viewing(velocity=velocity, turning=turning)


def share_of_the_best(boxes: np.ndarray, meshes: Sequence[MeshLevels], seen: Viewing) -> float:
    """What the greedy order gives, of what the best of all orders does."""
    link = Link(10_000, 0.0)
    one = Scheduler(FixedObjects(boxes), [Levels(meshes, np.arange(len(meshes), dtype=np.int32))], FAR, link)
    one.follow(seen, 0.0)
    now, greedy = 0.0, []
    while choice := one.next(now):
        greedy.append((choice.item.mesh, choice.item.level))
        now += choice.seconds
    outlook = look(predicted(seen), boxes, 0.0, FAR, OTHERWISE)
    items = [(mesh, level) for mesh in range(len(meshes)) for level in range(2)]
    case = Case(
        outlook.bounds.tolist(),
        outlook.visible.tolist(),
        {(m, n): level_accuracy(outlook.whole[m], meshes[m].faces[n], meshes[m].faces[-1]).tolist() for m, n in items},
        {(m, n): meshes[m].sizes[n] / link.bandwidth + OVERHEAD for m, n in items},
    )
    orders = (order for count in range(len(items) + 1) for order in itertools.permutations(items, count))
    most = max(total(order, case) for order in orders)
    return total(greedy, case) / most if most else 1.0


def test_the_greedy_order_is_nearly_the_best() -> None:
    shares = np.array([share_of_the_best(*small_case(np.random.default_rng(seed))) for seed in range(150)])
    assert shares.mean() > 0.999
    assert shares.min() > 0.9


def test_bandwidth_is_what_is_acknowledged_while_something_is_under_way() -> None:
    link = Link(latency=0.0)
    for n in range(20):
        link.sent(n / 10, 1_000)
        link.acknowledged(n / 10 + 0.1, 1_000)
    assert link.bandwidth == pytest.approx(10_000, rel=0.1)
    # Idle, then faster.
    for n in range(40):
        link.sent(100 + n / 10, 5_000)
        link.acknowledged(100 + n / 10 + 0.1, 5_000)
    assert link.bandwidth == pytest.approx(50_000, rel=0.1)
    before = link.bandwidth
    # Said twice, or of nothing.
    link.acknowledged(200.0, 10**9)
    assert link.bandwidth == before
    assert link.under_way == 0
