"""Cells above the leaves as geometry of their own: in the place of their pictures, and where they stand in."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Set
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

from e2e.browsing import Pixels, psnr
from e2e.pushing import opened_with
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World
from view.test_merged import scene

LEAF = 16.0
NEAR, ABOVE = Camera((-40.0, -42.0, 14.0), (0.0, 0.0, 2.0)), Camera((3.0, -2.0, 85.0), (0.0, 0.0, 0.0))
SIDE = Camera((58.0, -12.0, 12.0), (0.0, 0.0, 2.0))
FAR = Camera((-360.0, -370.0, 120.0), (0.0, 0.0, 2.0), 12.0)
BIAS = 3.0
"""With which the roots are the cut from there."""
SETTINGS = {"supersampling": 2, "nearRadius": 1, "fade": 0, "sky": "rgb(158, 191, 235)"}
SKY = linear_from_srgb([158 / 255, 191 / 255, 235 / 255])

LIKE, PATIENCE = 40.0, 15.0
"""dB to the reference renderer, and seconds until a page has it."""
Shown = tuple[Pixels, dict[str, Any]]


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> DirectoryStore:
    """Hills and two houses, which the index lists, baked."""
    store = DirectoryStore(tmp_path_factory.mktemp("hlod") / "hills")
    bake(scene(), store, BakeOptions(leaf_size=LEAF, resolution=64, directions="9", workers=2))
    return store


@pytest.fixture(scope="module")
def server(hills: DirectoryStore) -> Iterator[str]:
    """Where they are served."""
    with serving(hills, ServeOptions(port=0)) as url:
        yield url


def keys(store: DirectoryStore, *beginnings: str) -> set[str]:
    return {key for key in store.list() if key.startswith(beginnings)}


def merged(store: DirectoryStore, *levels: int) -> set[str]:
    """Geometry of the cells of these levels above the leaves, and all images."""
    return keys(store, "texture/", *(f"geometry/{level}/" for level in levels))


def half(store: DirectoryStore) -> set[str]:
    """Pictures of every other leaf."""
    cells = {key: key.split("/")[2:4] for key in keys(store, "orthoview/0/")}
    return {key for key, (x, y) in cells.items() if (int(x) + int(y)) % 2}


class Page:
    """A page that is sent some values, and to which there are no others."""

    def __init__(self, browser: Browser, server: str, store: DirectoryStore) -> None:
        self._browser, self._server, self._store = browser, server, store

    @contextmanager
    def holding(self, held: Set[str], bias: float = 0.0) -> Iterator[Callable[[Camera], Shown]]:
        """Gives what shows it from somewhere."""
        # Coarse geometry first, as a server would send it.
        values = {key: self._store.get(key) for key in sorted(held, key=lambda key: (key.startswith("orthoview"), key))}
        with opened_with(self._browser, self._server, set(held), values) as page:
            page.options(**SETTINGS, bias=bias)

            def shown(camera: Camera) -> Shown:
                way = {"eye": camera.eye, "target": camera.target, "fov": camera.fov}
                page.do("camera => farfield.setCamera(camera)", way)
                page.quiet()
                expected, end = rendered(self._store, camera, held, bias), time.monotonic() + PATIENCE
                # What is sent is no request: on a busy machine it may still come.
                while psnr(page.picture(), expected) < LIKE and time.monotonic() < end:
                    page.quiet()
                return page.picture(), page.stats()

            yield shown


@pytest.fixture
def page(browser: Browser, server: str, hills: DirectoryStore) -> Page:
    return Page(browser, server, hills)


def rendered(store: DirectoryStore, camera: Camera, held: Set[str] | None, bias: float = 0.0) -> Pixels:
    """By the reference renderer; held: None: all, as geometry."""
    options = RenderOptions(supersampling=2, near_radius=1e9 if held is None else 1.0, held=held, bias=bias)
    return render_world(World.open(store), camera, (640, 480), options).pixels(SKY)


def gaps(picture: Pixels, true: Pixels) -> float:
    """Share of the picture in which there is sky where none should be."""
    sky = np.array([158, 191, 235])
    is_sky, should_be = ((np.abs(one.astype(int) - sky) < 3).all(-1) for one in (picture, true))
    return float((is_sky & ~should_be).mean())


@pytest.mark.parametrize("levels", [(1, 2), (2,)])
def test_it_shows_all_that_is_not_there(page: Page, hills: DirectoryStore, levels: tuple[int, ...]) -> None:
    held = merged(hills, *levels) | keys(hills, "mesh/")
    with page.holding(held) as shown:
        for camera in (NEAR, SIDE, ABOVE):
            picture, stats = shown(camera)
            assert stats["geometry_cells"] == stats["stand_ins"] > 0
            assert stats["splats"] == stats["cells_empty"] == 0
            assert psnr(picture, rendered(hills, camera, held)) > 40
            true = rendered(hills, camera, None)
            assert psnr(picture, true) > (24 if levels == (2,) else 29)
            assert gaps(picture, true) < 0.01


@pytest.mark.parametrize("levels", [(1, 2), (2,)])
def test_it_stands_in_between_what_is_there(page: Page, hills: DirectoryStore, levels: tuple[int, ...]) -> None:
    held = merged(hills, *levels) | keys(hills, "mesh/") | half(hills)
    with page.holding(held) as shown:
        for camera in (NEAR, SIDE, ABOVE):
            picture, stats = shown(camera)
            assert stats["geometry_cells"] == stats["stand_ins"] > 0
            assert stats["splats"] > 1000
            assert stats["cells_empty"] == 0
            # It is clipped to what is missing: elsewhere pictures are seen, neither hidden nor twice.
            assert psnr(picture, rendered(hills, camera, held)) > 38
            assert gaps(picture, rendered(hills, camera, None)) < 0.003


def test_from_afar_it_is_drawn_in_the_place_of_pictures_if_houses_are(page: Page, hills: DirectoryStore) -> None:
    geometry, pictures, houses = merged(hills, 2), keys(hills, "orthoview/2/"), keys(hills, "mesh/")
    true, found = rendered(hills, FAR, None), []
    for held in (geometry, geometry | pictures, geometry | pictures | houses):
        with page.holding(held, BIAS) as shown:
            picture, stats = shown(FAR)
        assert psnr(picture, rendered(hills, FAR, held, BIAS)) > 45
        assert stats["stand_ins"] == stats["cells_empty"] == 0
        found.append((stats["geometry_cells"], sum(stats["cells"].values()), psnr(picture, true)))
    alone, beside, whole = found
    # Both houses stand in one of the four.
    assert (alone[:2], beside[:2], whole[:2]) == ((4, 0), (3, 1), (4, 0))
    assert whole[2] > beside[2] > alone[2] > 29
