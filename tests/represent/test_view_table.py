"""Which views are chosen for which viewpoint."""

from __future__ import annotations

import numpy as np
import pytest

from bake.scenes import quad_mesh
from farfield.geometry.directions import PRINCIPAL, TOP, Direction, parse
from farfield.kernels.coverage import greedy_cover
from farfield.octree.grid import CellKey, Grid
from farfield.represent.blocks import BlockedMesh
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.connectivity import mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.leaf import draw_leaf
from farfield.represent.orthoview.view_table import MOST_VIEWS, choose_views
from farfield.scene.model import Material
from represent.plain_coverage import greedy

GRID = Grid(64.0, 128, (0.0, 0.0, 0.0), (2, 2, 0))
LEAF = CellKey(0, 1, 0, 0)


def box(x: float, y: float, width: float, height: float) -> np.ndarray:
    """(5, 4, 3): the walls and roof of a square tower."""
    a, b = np.array([x, y]), np.array([x + width, y + width])
    c = [[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]]
    walls = [[[*c[k], 0], [*c[(k + 1) % 4], 0], [*c[(k + 1) % 4], height], [*c[k], height]] for k in range(4)]
    return np.array([*walls, [[*p, height] for p in c]], dtype=np.float64)


@pytest.fixture(scope="module")
def town() -> dict[int, list[OrthoLayer]]:
    """Nine towers on a ground, in the second leaf along x; 26 directions, two layers."""
    ground = np.array([[[64.0, 0, 0.5], [128, 0, 0.5], [128, 64, 0.5], [64, 64, 0.5]]])
    towers = [box(68 + 20 * i, 4 + 20 * j, 12, 20 + 8 * ((i + j) % 3)) for i in range(3) for j in range(3)]
    material = Material("wall")
    mesh = BlockedMesh.from_mesh(quad_mesh(np.concatenate([ground, *towers]), material))
    chunk = mesh.cell_chunk(np.eye(3, 4), GRID, LEAF[1:])
    layers = {d.number: draw_leaf(chunk, MaterialTable.build([material]), GRID, LEAF, d, 2, 2) for d in parse("26")}
    for drawn in layers.values():
        for layer in drawn:
            mark_connected(layer)
    return layers


def chosen(town: dict[int, list[OrthoLayer]], directions: tuple[Direction, ...]) -> tuple[tuple[int, ...], ...]:
    return choose_views({d.number: town[d.number] for d in directions}, directions, GRID, LEAF)


def test_the_direction_of_the_eye_comes_first(town: dict[int, list[OrthoLayer]]) -> None:
    table = chosen(town, parse("26"))
    upper = [n for n, d in enumerate(PRINCIPAL) if d[2] > 0]
    assert table[TOP][0] == TOP
    assert sum(table[n][0] == n for n in upper) >= len(upper) - 2


def test_lists_are_short_distinct_and_of_what_was_baked(town: dict[int, list[OrthoLayer]]) -> None:
    directions = parse("9")
    table = chosen(town, directions)
    assert len(table) == 26
    for views in table:
        assert 1 <= len(views) <= MOST_VIEWS
        assert len(set(views)) == len(views)
        assert set(views) <= {d.number for d in directions}


def test_the_ground_between_towers_is_not_lost(town: dict[int, list[OrthoLayer]]) -> None:
    """From the side the three nearest of the sides and the top are sides only; the ground is seen from above."""
    for views in (chosen(town, parse("5"))[n] for n, d in enumerate(PRINCIPAL) if d[2] >= 0):
        assert TOP in views[:3]


def test_from_the_horizon_roofs_and_ground_count(town: dict[int, list[OrthoLayer]]) -> None:
    """Eyes of these bins are up to half a right angle above the horizon; one eye in the middle sees walls alone."""
    table = chosen(town, parse("17"))
    for n in (n for n, d in enumerate(PRINCIPAL) if d[2] == 0):
        assert sum(PRINCIPAL[view][2] > 0 for view in table[n][:3]) >= 2


def test_the_same_every_time(town: dict[int, list[OrthoLayer]]) -> None:
    assert chosen(town, parse("17")) == chosen(town, parse("17"))


def test_nothing_drawn_nothing_chosen() -> None:
    assert choose_views({}, parse("5"), GRID, LEAF) == ((),) * 26


@pytest.mark.parametrize("seed", range(5))
def test_greedy_equals_plain_twin(seed: int) -> None:
    r = np.random.default_rng(seed)
    nearest = r.uniform(10, 12, (3, 7, 12, 12)).astype(np.float32)
    nearest[r.random(nearest.shape) < 0.3] = 1e30
    # Halves and quarters add up exactly, whatever the order.
    quality = np.where(nearest < 1e30, r.integers(1, 5, nearest.shape) / 2, 0).astype(np.float32)
    expected = greedy(nearest, quality, 0.5, 0.5, 5)
    found = np.empty(5, np.int64)
    count = greedy_cover(nearest, quality, np.float32(0.5), np.float32(0.5), found)
    assert found[:count].tolist() == expected
