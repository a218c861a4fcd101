"""How far BlockMaps are from what they were built from: half of a voxel's diagonal at most (BLK 3.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from farfield.represent.blockmap.blockmap import SIZES, STEEP, BlockMap
from farfield.represent.blockmap.build import build_blockmap
from represent.prisms import SQUARE, WHITE, House, chunk_of, distances, random_town, surface_of

WIDTH, DEPTH = SQUARE.width, SQUARE.depth


def built(houses: list[House], number: int, sloped: bool) -> BlockMap:
    found = build_blockmap(chunk_of(houses), WHITE, SQUARE, SIZES[number], by_area=True, sloped=sloped)
    assert found is not None
    return found


def half_diagonal(found: BlockMap) -> float:
    """Of a voxel, metres: it is a texel wide and a step high, or, where tops slope, as high as they rise from corner to
    corner: a plane goes on beyond a ridge or eaves to the end of its texel."""
    texel, rise = np.array([WIDTH, DEPTH]) / found.size.side, 0.0
    if found.slopes is not None:
        rise = float((np.abs(found.slopes.astype(np.float64)) / STEEP @ texel).max())
    return float(np.sqrt((texel**2).sum() + (found.step + rise) ** 2) / 2)


def away(houses: list[House], number: int, sloped: bool) -> tuple[NDArray[np.float64], float]:
    """Metres of points of a map from the true surface, and how far they may be."""
    found = built(houses, number, sloped)
    return distances(surface_of(found, WIDTH, DEPTH), houses), half_diagonal(found)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("gables", [False, True])
@pytest.mark.parametrize("number", [0, 1])
def test_flat_tops_stay_within_half_of_a_voxel_s_diagonal(seed: int, gables: bool, number: int) -> None:
    found, error = away(random_town(seed, gables), number, sloped=False)
    n = SIZES[number].side
    assert error == pytest.approx(np.hypot(WIDTH / n, DEPTH / n) / 2, rel=0.01)
    assert 0.5 * error < found.max() <= error


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("number", [0, 1])
def test_sloping_tops_are_nearer_and_within_the_error_that_they_tell(seed: int, number: int) -> None:
    houses = random_town(seed, gables=True)
    stepped, voxel = away(houses, number, sloped=False)
    found, error = away(houses, number, sloped=True)
    assert found.max() <= error < 3 * voxel
    assert found.mean() < 0.87 * stepped.mean()
    # Beyond a ridge and eaves planes go on to the end of their texel.
    assert (found > voxel).mean() < 0.005


def test_where_all_is_flat_no_slopes_are_kept() -> None:
    assert built(random_town(1, gables=False), 1, sloped=True).slopes is None


@pytest.mark.parametrize("gables", [False, True])
def test_what_is_wider_than_two_texels_is_not_lost(gables: bool) -> None:
    """The other direction, which the paper does not speak of: from the true roofs to the map."""
    number, each = 1, 1.0
    houses = random_town(3, gables, smallest=8.5)
    houses = [replace(house, eaves=house.eaves + 5, ridge=house.ridge + 5) for house in houses]
    found = built(houses, number, sloped=True)
    tree = cKDTree(surface_of(found, WIDTH, DEPTH, each=7))
    y, x = np.mgrid[0:DEPTH:each, 0:WIDTH:each] + 0.5 * each
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    heights = np.max([house.height(places) for house in houses], axis=0)
    roofs = np.concatenate([places, heights[:, None]], axis=1)[heights > -np.inf]
    missed = tree.query(roofs)[0]
    # Points of the map are half a metre apart.
    assert missed.max() < half_diagonal(found) + 0.5
    assert missed.mean() < 0.7
