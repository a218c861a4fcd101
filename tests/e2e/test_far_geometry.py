"""Cells farther away than near that are geometry, where that shows more for its bytes than their pictures."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from e2e.browsing import Visit
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.quality.metrics import psnr
from farfield.store import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

EYE, TARGET = (-60.0, -62.0, 24.0), (0.0, 0.0, 2.0)
SETTINGS = {"supersampling": 2, "nearRadius": 4, "fade": 0, "sky": "rgb(158, 191, 235)"}
SKY = linear_from_srgb([158 / 255, 191 / 255, 235 / 255])


@pytest.mark.parametrize("query", ["", "?sessions=0"])
def test_houses_are_geometry_and_come_for_fewer_bytes(
    address: str, world: DirectoryStore, visit: Callable[..., Visit], query: str
) -> None:
    camera = Camera(EYE, TARGET, 46.8)
    options = RenderOptions(supersampling=2, near_radius=1e9)
    true = render_world(World.open(world), camera, (640, 480), options).pixels(SKY)
    found = []
    for far in (True, False):
        page = visit(address + query)
        page.options(**SETTINGS, farGeometry=far)
        page.look(EYE, TARGET)
        page.quiet()
        stats = page.stats()
        assert stats["tiles_missing"] == stats["tiles_pending"] == 0
        found.append((psnr(page.picture(), true), stats["geometry_cells"], stats["splats"]))
        print(found[-1], stats)
    free, pictures = found
    assert pictures[1] == 0
    assert free[1] > 0
    assert free[2] < 0.5 * pictures[2]
    assert free[0] > pictures[0] + 1


def test_pictures_are_drawn_as_soon_as_geometry_is_not_wanted(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address + "?sessions=0")
    page.options(**SETTINGS)
    page.look(EYE, TARGET)
    assert page.stats()["geometry_cells"] > 0
    page.options(farGeometry=False)
    page.complete()
    stats = page.stats()
    assert stats["geometry_cells"] == 0
    assert stats["splats"] > 1000
    page.options(farGeometry=True)
    page.complete()
    assert page.stats()["geometry_cells"] > 0
