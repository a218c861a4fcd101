"""Worlds of BlockMaps in the page: alone, beside geometry, and beside orthoviews."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from bake.test_blockmaps import city
from e2e.browsing import Visit, psnr
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.serve.run import ServeOptions, serving
from farfield.store.directory import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

MAPS = BakeOptions(leaf_size=32.0, resolution=32, corner=(0.0, 0.0, -8.0), workers=2, orthoviews=False,
                   blockmap="32:192")  # fmt: skip
ALL = replace(MAPS, orthoviews=True, directions="9")
FAR = Camera((-90.0, -70.0, 75.0), (64.0, 64.0, 5.0), 46.8)
SETTINGS: dict[str, Any] = {"supersampling": 2, "nearRadius": 1, "fade": 0, "sky": "rgb(158, 191, 235)"}
SKY = linear_from_srgb([158 / 255, 191 / 255, 235 / 255])
LIKE = 40.0
"""dB to the reference renderer."""
BEHIND = tuple(
    Camera(eye, target, 46.8)
    for eye, target in (
        ((61.0, 38.0, 1.5), (61.0, 100.0, 2.0)),
        ((61.5, 37.5, 1.5), (60.0, 100.0, 2.0)),
        ((36.0, 60.0, 2.0), (100.0, 62.0, 2.0)),
    )
)
"""Right before the large building."""
NONE = {"orthoview": 0, "blockmap": 0, "geometry": 0}


@dataclass(frozen=True)
class Served:
    world: World
    address: str


@contextmanager
def served(folder: Path, options: BakeOptions) -> Iterator[Served]:
    store = DirectoryStore(folder / "city")
    bake(city(), store, options)
    with serving(store, ServeOptions(port=0)) as url:
        yield Served(World.open(store), url)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """BlockMaps and geometry."""
    with served(tmp_path_factory.mktemp("mapped"), MAPS) as found:
        yield found


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """BlockMaps, orthoviews and geometry."""
    with served(tmp_path_factory.mktemp("mixed"), ALL) as found:
        yield found


def seen(visit: Callable[..., Visit], address: str, camera: Camera, **options: Any) -> Visit:
    page = visit(address)
    page.options(**SETTINGS | options)
    page.look(camera.eye, camera.target, camera.fov)
    return page


@pytest.mark.parametrize("query", ["", "?sessions=0"])
@pytest.mark.parametrize("bias", [0.0, 1.0, 6.0])
def test_is_what_the_reference_renderer_draws(
    mapped: Served, visit: Callable[..., Visit], query: str, bias: float
) -> None:
    page = seen(visit, mapped.address + query, FAR, farGeometry=False, bias=bias)
    stats, options = page.stats(), RenderOptions(supersampling=2, near_radius=1, bias=bias, far_geometry=False)
    assert stats["kinds"] == NONE | {"blockmap": stats["cut_cells"]}
    assert stats["blockmaps"] > 0
    assert stats["triangles"] == stats["splats"] == stats["tiles_missing"] == 0
    assert psnr(page.picture(), render_world(mapped.world, FAR, (640, 480), options).pixels(SKY)) > LIKE


def test_of_all_kinds_those_are_drawn_that_show_most_for_their_bytes(
    mixed: Served, visit: Callable[..., Visit]
) -> None:
    """And the figures tell which."""
    options = RenderOptions(supersampling=2, near_radius=1e9)
    true = render_world(mixed.world, FAR, (640, 480), options).pixels(SKY)
    found = {}
    for far in (True, False):
        page = seen(visit, mixed.address, FAR, farGeometry=far)
        page.quiet()
        stats = page.stats()
        assert stats["tiles_missing"] == stats["tiles_pending"] == 0
        assert sum(stats["kinds"].values()) >= stats["cut_cells"]
        assert stats["kinds"]["geometry"] == stats["geometry_cells"]
        found[far] = stats["kinds"], psnr(page.picture(), true), stats["bytes"]
        print(far, found[far])
    free, pictures = found[True], found[False]
    assert pictures[0]["orthoview"] > 0
    assert free[0]["blockmap"] + free[0]["geometry"] > 0
    assert free[1] > pictures[1] - 0.5
    assert free[2] < pictures[2]


def test_near_leaves_are_geometry_among_blockmaps(mapped: Served, visit: Callable[..., Visit]) -> None:
    camera = Camera((20.0, -14.0, 9.0), (40.0, 64.0, 5.0), 60.0)
    page = seen(visit, mapped.address, camera, nearRadius=40, farGeometry=False)
    stats, options = page.stats(), RenderOptions(supersampling=2, near_radius=40, far_geometry=False)
    assert stats["kinds"]["geometry"] > 0
    assert stats["kinds"]["blockmap"] > 0
    assert stats["triangles"] > 0
    assert psnr(page.picture(), render_world(mapped.world, camera, (640, 480), options).pixels(SKY)) > 35


def test_blockmaps_behind_others_are_left_out(mapped: Served, visit: Callable[..., Visit]) -> None:
    """And the picture is that of all of them, to the bit; also after the eye has moved."""
    page = seen(visit, mapped.address, BEHIND[0], farGeometry=False, shadows=False)
    for camera in (*BEHIND[1:], BEHIND[0]):
        page.look(camera.eye, camera.target, camera.fov)
        pictures, drawn = {}, {}
        for culling in ("all", "frustum"):
            page.options(culling=culling)
            page.complete()
            # The first picture from here told what is hidden.
            page.do("farfield.setOptions({})")
            page.complete()
            pictures[culling], drawn[culling] = page.picture(), page.stats()["blockmaps"]
        page.options(culling="all")
        assert 0 < drawn["all"] < drawn["frustum"]
        assert (pictures["all"] == pictures["frustum"]).all()
