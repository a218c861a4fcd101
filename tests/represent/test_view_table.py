"""Which views are chosen for which viewpoint."""

from __future__ import annotations

import numpy as np
import pytest

from bake.scenes import quad_mesh
from farfield.geometry.directions import PRINCIPAL, TOP, Direction, parse
from farfield.kernels.coverage import BEST, LOOSE, discount_hidden, greedy_cover
from farfield.octree.grid import CellKey, Grid
from farfield.represent.blocks import BlockedMesh
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.connectivity import mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.leaf import draw_leaf
from farfield.represent.orthoview.view_table import MOST_PICKS, ViewTable, choose_views
from farfield.scene.model import Material
from represent.plain_coverage import discounted, greedy

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


def table_of(
    town: dict[int, list[OrthoLayer]],
    directions: tuple[Direction, ...],
    sizes: dict[tuple[int, int], int] | None = None,
) -> ViewTable:
    """As if a valid pixel took two bytes, unless told otherwise."""
    layers = {d.number: town[d.number] for d in directions}
    sizes = sizes or {
        (number, index): 2 * int(np.count_nonzero(layer.valid))
        for number, drawn in layers.items()
        for index, layer in enumerate(drawn)
    }
    return choose_views(layers, sizes, directions, GRID, LEAF)


def chosen(town: dict[int, list[OrthoLayer]], directions: tuple[Direction, ...]) -> list[list[int]]:
    """The directions of the tiles that are picked for each bin, best first, where all have as many bytes."""
    tiles = [
        (d.number, index) for d in sorted(directions, key=lambda d: d.number) for index in range(len(town[d.number]))
    ]
    table = table_of(town, directions, dict.fromkeys(tiles, 1000))
    return [list(dict.fromkeys(tiles[place][0] for place, _ in own)) for own in table.picks]


def test_the_direction_of_the_eye_comes_first(town: dict[int, list[OrthoLayer]]) -> None:
    table = chosen(town, parse("26"))
    upper = [n for n, d in enumerate(PRINCIPAL) if d[2] > 0]
    assert table[TOP][0] == TOP
    assert sum(table[n][0] == n for n in upper) >= len(upper) - 2


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
    assert table_of(town, parse("17")) == table_of(town, parse("17"))


def test_nothing_drawn_nothing_chosen() -> None:
    assert choose_views({}, {}, parse("5"), GRID, LEAF) == ViewTable(((),) * 26)


def test_picks_are_distinct_tiles_and_add_ever_less(town: dict[int, list[OrthoLayer]]) -> None:
    table = table_of(town, parse("17"))
    assert len(table.picks) == len(PRINCIPAL)
    for picks in table.picks:
        places = [place for place, _ in picks]
        assert 1 <= len(picks) <= MOST_PICKS
        assert len(set(places)) == len(places)
        worth = [gain for _, gain in picks]
        assert worth == sorted(worth, reverse=True)


def test_together_picks_add_about_what_there_is_to_see(town: dict[int, list[OrthoLayer]]) -> None:
    """From above that is about one side of the cell, less what is farther from the eye than the middle."""
    tiles = [(n, index) for n in range(26) for index in range(len(town[n]))]
    size = [2 * np.count_nonzero(town[n][index].valid) / 1000 for n, index in tiles]
    shares = [gain * size[place] / 128**2 for place, gain in table_of(town, parse("26")).picks[TOP]]
    assert 0.6 < sum(shares) < 1.2


def test_a_tile_that_costs_much_comes_later(town: dict[int, list[OrthoLayer]]) -> None:
    directions = parse("5")
    tiles = [(d.number, index) for d in directions for index in range(len(town[d.number]))]
    place = tiles.index((TOP, 0))
    alike = dict.fromkeys(tiles, 1000)
    dear = alike | {(TOP, 0): 40_000}
    ranks = [[p for p, _ in table_of(town, directions, sizes).picks[TOP]].index(place) for sizes in (alike, dear)]
    assert ranks[0] == 0 < ranks[1]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("least", [0.0, 1.0])
def test_greedy_equals_plain_twin(seed: int, least: float) -> None:
    r = np.random.default_rng(seed)
    quality = np.where(r.random((7, 432)) < 0.3, 0, r.integers(1, BEST + 1, (7, 432))).astype(np.uint8)
    quality |= np.where(r.random((7, 432)) < 0.4, LOOSE, 0).astype(np.uint8)
    nearest = r.uniform(10, 12, (7, 432)).astype(np.float32)
    cost = r.integers(1000, 20000, 7).astype(np.float64)
    found, gains = np.empty(5, np.int64), np.empty(5, np.int64)
    count = greedy_cover(quality, nearest, np.float32(0.5), cost, least, found, gains)
    pairs = list(zip(found[:count].tolist(), gains[:count].tolist(), strict=True))
    assert pairs == greedy(quality, nearest, 0.5, cost, least, 5)
    assert 1 <= count <= 5


def test_discount_equals_plain_twin() -> None:
    r = np.random.default_rng(0)
    nearest = r.uniform(10, 12, (7, 432)).astype(np.float32)
    nearest[r.random(nearest.shape) < 0.3] = 1e30
    quality = np.where(nearest < 1e30, r.integers(1, BEST + 1, nearest.shape), 0).astype(np.uint8)
    quality |= np.where(r.random(nearest.shape) < 0.4, LOOSE, 0).astype(np.uint8)
    expected = discounted(nearest, quality, 0.5, 0.6)
    discount_hidden(nearest, quality, np.float32(0.5), np.float32(0.6))
    np.testing.assert_array_equal(quality, expected)


def test_above_the_leaves_both_layers_come_together(town: dict[int, list[OrthoLayer]]) -> None:
    directions = parse("17")
    places = [(d.number, index) for d in directions for index in range(len(town[d.number]))]
    table = choose_views(town, dict.fromkeys(places, 5_000), directions, GRID, CellKey(1, 0, 0, 0))
    for picks in table.picks:
        gains: dict[int, list[float]] = {}
        for place, gain in picks:
            gains.setdefault(places[place][0], []).append(gain)
        for number, of_layers in gains.items():
            assert of_layers == [of_layers[0]] * len(town[number])
