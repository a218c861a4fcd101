"""Ids of objects: each its own, and a change is felt nearby only."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.bake.numbering import object_ids
from farfield.errors import InputError
from farfield.octree.grid import Grid
from farfield.scene.model import Instances

GRID = Grid(64.0, 64, (-100.0, -50.0, 0.0), (5, 5, 1))
"""2,048 m wide: squares of 2 m."""
Place = tuple[float, float, int]
PLACES = st.lists(st.tuples(st.floats(-100, 1900), st.floats(-50, 1900), st.integers(1, 9000)), min_size=1, max_size=40)


def instances(places: list[Place]) -> Instances:
    transform = np.tile(np.eye(3, 4), (len(places), 1, 1))
    transform[:, :2, 3] = [place[:2] for place in places]
    objects = np.array([place[2] for place in places], np.int64)
    return Instances(np.zeros(len(places), np.int32), transform, np.cumsum(objects) - objects + 1, objects)


@given(PLACES)
def test_ids_are_unique_and_do_not_depend_on_the_order(places: list[Place]) -> None:
    own = instances(places)
    first = object_ids(own, ["a"], GRID)
    order = np.argsort(first)
    assert first[order][0] >= 1
    assert (np.diff(first[order]) >= own.objects[order][:-1]).all()
    backwards = object_ids(instances(places[::-1]), ["a"], GRID)
    assert sorted(zip(places, first.tolist(), strict=True)) == sorted(
        zip(places[::-1], backwards.tolist(), strict=True)
    )


def test_one_more_is_felt_in_its_square_only() -> None:
    """A thousand squares of 512 buildings; one more building, or a square more."""
    places: list[Place] = [(-100.0 + 64 * x, -50.0 + 64 * y, 512) for x in range(32) for y in range(32)]
    before = object_ids(instances(places), ["a"], GRID)
    places[500] = (*places[500][:2], 513)
    assert (object_ids(instances(places), ["a"], GRID) == before).all()
    after = object_ids(instances([*places, (37.0, 211.0, 512)]), ["a"], GRID)
    assert (after[:-1] == before).all()


def test_meshes_in_one_place_are_told_apart_by_content() -> None:
    both = instances([(0.0, 0.0, 3), (0.0, 0.0, 3)])
    mesh = np.array([0, 1], np.int32)
    first = object_ids(Instances(mesh, both.transform, both.first_object, both.objects), ["b", "a"], GRID)
    assert (np.argsort(first) == [1, 0]).all()


def test_pieces_of_a_mesh_are_one_object() -> None:
    own = instances([(0.0, 0.0, 1), (0.0, 0.0, 1), (500.0, 9.0, 1)])
    pieces = Instances(np.array([0, 1, 2], np.int32), own.transform, np.array([1, 1, 2]), own.objects)
    first = object_ids(pieces, ["b", "c", "a"], GRID)
    assert first[0] == first[1] != first[2]


def test_where_ids_by_place_do_not_reach_they_follow_each_other() -> None:
    many = instances([(1900.0, 1900.0, 1 << 31), (0.0, 0.0, 1 << 30)])
    assert object_ids(many, ["a"], GRID).tolist() == [(1 << 30) + 1, 1]
    with pytest.raises(InputError, match="at most 4,294,967,295 have ids"):
        object_ids(instances([(0.0, 0.0, 1 << 32)]), ["a"], GRID)
