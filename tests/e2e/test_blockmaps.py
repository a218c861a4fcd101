"""BlockMaps as the page's shaders draw them, beside those that the reference renderer casts."""

from __future__ import annotations

import base64
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser
from scripts.viewer import VIEWER, find_node

from e2e.browsing import Pixels, Visit, psnr
from farfield.geometry.cameras import Camera
from farfield.represent.blockmap.blockmap import SIZES, BlockMap
from farfield.represent.blockmap.coding import decode_blockmap, encode_blockmap
from farfield.view.blockmaps import CastableMap, draw_blockmap
from farfield.view.frame import Frame
from farfield.view.shading import Light
from represent.blockmaps import EXTENT, blockmap_of_town

SIZE = (640, 480)
NEAR = 0.1
LIGHT = Light()
HOLE, COVERED = 1, 0
HARNESS = "http://blockmaps.test/"
"""Never asked for: the test answers."""


@dataclass(frozen=True)
class Placed:
    """A BlockMap of the town in a cell."""

    lower: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size: str = "64:256"
    seed: int = 1
    by_area: bool = True
    sloped: bool = True
    holes: Any = HOLE
    behind: bool = False
    height: float = EXTENT[2]
    """Of the cell, metres."""

    @property
    def extent(self) -> tuple[float, float, float]:
        return EXTENT[0], EXTENT[1], self.height

    @property
    def stored(self) -> bytes:
        return blockmap_of_town(self.size, self.seed, self.by_area, self.sloped)[0]

    @property
    def blockmap(self) -> BlockMap:
        return blockmap_of_town(self.size, self.seed, self.by_area, self.sloped)[1]

    @property
    def told(self) -> dict[str, object]:
        """As the harness takes it."""
        upper = [low + extent for low, extent in zip(self.lower, self.extent, strict=True)]
        text = base64.b64encode(self.stored).decode()
        return {
            "bytes": text, "lower": self.lower, "upper": upper, "level": 1, "holes": self.holes, "behind": self.behind,
        }  # fmt: skip


@pytest.fixture(scope="module")
def harness(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    """A page with viewer/test/harness/blockmaps.ts."""
    esbuild = VIEWER / "node_modules/.bin/esbuild"
    if not esbuild.exists():
        pytest.skip("the viewer's packages are not installed: npm ci in viewer/")
    script = tmp_path_factory.mktemp("harness") / "blockmaps.js"
    entry, node = VIEWER / "test/harness/blockmaps.ts", find_node()
    environment = {**os.environ, "PATH": f"{node.folder}{os.pathsep}{os.environ.get('PATH', '')}"}
    words = [esbuild, entry, "--bundle", "--loader:.glsl=text", f"--outfile={script}", "--log-level=warning"]
    subprocess.run(words, check=True, env=environment)
    page = browser.new_context().new_page()
    visit = Visit(page, expect_errors=False)
    page.route(f"{HARNESS}*", lambda route: route.fulfill(body="<!doctype html>", content_type="text/html"))
    page.goto(HARNESS)
    page.add_script_tag(path=script)
    yield visit
    visit.leave()
    assert visit.errors == []


def seen_from(camera: Camera, near: float = NEAR) -> dict[str, object]:
    """As the harness takes it."""
    return {"eye": camera.eye, "target": camera.target, "fov": camera.fov, "near": near, "size": SIZE}


def drawn(harness: Visit, camera: Camera, near: float = NEAR) -> tuple[Pixels, NDArray[np.float32], dict[str, int]]:
    """(480, 640, 3) over the sky, (480, 640) metres along the view axis, inf = nothing, and the harness's figures."""
    found = harness.do("seen => harness.draw(seen)", seen_from(camera, near))
    shape = SIZE[1], SIZE[0]
    color = np.frombuffer(base64.b64decode(found["color"]), np.uint8).reshape(*shape, 4)[::-1, :, :3]
    inverse = np.frombuffer(base64.b64decode(found["depth"]), np.float32).reshape(shape)[::-1]
    with np.errstate(divide="ignore"):
        depth = np.float32(near) / inverse
    sky = np.array(LIGHT.sky, np.uint8)
    return np.where(np.isfinite(depth)[..., None], color, sky), depth, found["stats"]


def expected(
    camera: Camera, *placed: Placed, box: NDArray[np.float64] | None = None
) -> tuple[Pixels, NDArray[np.float32]]:
    """The same of the reference renderer; box: to which all are cut."""
    frame = Frame.empty(camera, SIZE, 1)
    for one in placed:
        draw_blockmap(frame, CastableMap.of(one.blockmap, np.array(EXTENT)), np.array(one.lower), LIGHT, box)
    return frame.develop(LIGHT).pixels(LIGHT.sky_linear), frame.depth


def compare(name: str, shown: tuple[Pixels, NDArray[np.float32]], right: tuple[Pixels, NDArray[np.float32]]) -> float:
    """PSNR; depth must agree but at the rims of things. FARFIELD_PICTURES: folder for both pictures, side by side."""
    folder = os.environ.get("FARFIELD_PICTURES")
    if folder:
        Image.fromarray(np.concatenate([shown[0], right[0]], axis=1)).save(Path(folder) / f"{name}.png")
    there = np.isfinite(shown[1]) & np.isfinite(right[1])
    assert (np.isfinite(shown[1]) != np.isfinite(right[1])).mean() < 1e-3
    off = np.abs(shown[1][there] - right[1][there]) > 1e-3 * right[1][there] + 1e-3
    assert off.mean() < 2e-3
    return psnr(shown[0], right[0])


CAMERAS = {
    "afar": Camera((-300.0, -260.0, 180.0), (64.0, 64.0, 10.0), 30.0),
    "above": Camera((70.0, 60.0, 210.0), (64.0, 64.0, 5.0), 50.0),
    "grazing": Camera((-80.0, 50.0, 14.0), (64.0, 64.0, 9.0), 50.0),
    "inside": Camera((28.0, 66.0, 9.0), (90.0, 60.0, 11.0), 80.0),
    "upwards": Camera((64.0, -20.0, 1.5), (64.0, 50.0, 30.0), 60.0),
    "below": Camera((60.0, 70.0, -80.0), (64.0, 64.0, 20.0), 60.0),
}
MAPS = {
    "fine": Placed(),
    "flat": Placed(sloped=False),
    "by-column": Placed(by_area=False),
    "middle": Placed(size="32:192"),
    "coarse": Placed(size="16:64", by_area=False, sloped=False),
}


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("kind", MAPS)
def test_is_what_the_reference_renderer_draws(harness: Visit, view: str, kind: str) -> None:
    harness.do("maps => harness.take(maps)", [MAPS[kind].told])
    *shown, stats = drawn(harness, CAMERAS[view])
    assert stats == {"maps": 1, "calls": 1}
    found = compare(f"{view}-{kind}", (shown[0], shown[1]), expected(CAMERAS[view], MAPS[kind]))
    assert found >= 40


@pytest.mark.parametrize("view", ["grazing", "inside"])
def test_many_maps_take_a_call_for_each_size(harness: Visit, view: str) -> None:
    sizes, (width, depth, _) = ("64:256", "32:192", "16:64"), EXTENT
    places = [(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)]
    many = [
        Placed((i * width, j * depth, float(i + j)), sizes[n % 3], 1 + n % 2, by_area=n % 2 == 0)
        for n, (i, j) in enumerate(places)
    ]
    harness.do("maps => harness.take(maps)", [one.told for one in many])
    *shown, stats = drawn(harness, CAMERAS[view])
    assert 3 < stats["maps"] < 9
    assert stats["calls"] in (2, 3)
    assert compare(f"many-{view}", (shown[0], shown[1]), expected(CAMERAS[view], *many)) >= 40


def test_what_was_drawn_is_there_when_its_page_grows(harness: Visit) -> None:
    maps = [Placed((n * EXTENT[0], 0.0, 0.0), seed=1 + n % 2) for n in (0, 1, -1)]
    harness.do("maps => harness.take(maps)", [])
    for count, one in enumerate(maps, 1):
        harness.do("maps => harness.add(maps)", [one.told])
        *shown, stats = drawn(harness, CAMERAS["above"])
        assert stats["calls"] == 1
        assert compare(f"grown-{count}", (shown[0], shown[1]), expected(CAMERAS["above"], *maps[:count])) >= 40


def test_low_walls_show_all_of_their_texels(harness: Visit) -> None:
    """Of a slab no higher than what the box reaches beyond it: its wall ends at its foot, and not below."""
    size, n = SIZES[0], SIZES[0].side
    codes = np.zeros((n, n), np.uint8)
    codes[6:10, 6:10] = 255
    bare = replace(
        blockmap_of_town("16:64", sloped=False)[1],
        codes=codes, low=0.0, step=0.1 / 254, border=np.zeros((4, n), np.uint8), floors=None, density=0, scale=16,
    )  # fmt: skip
    rows = np.arange(n)[:, None, None]
    colors = np.where(rows < 8, [250, 60, 20], [20, 60, 250]) * np.ones((1, n + size.columns, 1))
    plain = replace(bare, colors=colors.astype(np.uint8))
    walls = plain.with_turns(np.zeros(len(plain.unfolded.sides), np.uint8))
    assert set(walls.unfolded.places[..., 2].ravel()) == {0, 16}
    stored = encode_blockmap(walls, 100)
    camera = Camera((64.0, 45.0, 0.06), (64.0, 48.0, 0.05), 3.0)
    told = {**Placed(size="16:64").told, "bytes": base64.b64encode(stored).decode()}
    harness.do("maps => harness.take(maps)", [told])
    *shown, _ = drawn(harness, camera)
    frame = Frame.empty(camera, SIZE, 1)
    draw_blockmap(frame, CastableMap.of(decode_blockmap(stored, ""), np.array(EXTENT)), np.zeros(3), LIGHT)
    right = frame.develop(LIGHT).pixels(LIGHT.sky_linear), frame.depth
    assert compare("low-walls", (shown[0], shown[1]), right) >= 40


PARTS = [
    ("afar", 0, 128.0), ("afar", 3, 128.0), ("inside", 1, 128.0), ("above", 2, 128.0), ("afar", 5, 64.0),
    ("above", 7, 64.0),
]  # fmt: skip
"""Lower octants with all that stands on them, so that no ray comes out of what is cut off above; and upper ones, seen
from above."""


@pytest.mark.parametrize(("view", "octant", "height"), PARTS)
def test_stands_in_for_parts_of_its_cell(harness: Visit, view: str, octant: int, height: float) -> None:
    placed = Placed(holes=[HOLE if n == octant else COVERED for n in range(8)], behind=True, height=height)
    harness.do("maps => harness.take(maps)", [placed.told])
    *shown, stats = drawn(harness, CAMERAS[view])
    assert stats == {"maps": 1, "calls": 1}
    half = np.array(placed.extent) / 2
    lower = half * [octant >> axis & 1 for axis in range(3)]
    right = expected(CAMERAS[view], placed, box=np.stack([lower, lower + half]))
    # A pitch of its level behind what is finer.
    nearer = shown[1] - np.float32(2.0)
    assert compare(f"part-{view}-{octant}", (shown[0], nearer), right) >= 40


def test_is_exact_from_thirty_kilometres(harness: Visit) -> None:
    camera = Camera((-21_000.3, -20_000.7, 9_000.1), (64.0, 64.0, 10.0), 0.3)
    harness.do("maps => harness.take(maps)", [Placed().told])
    *shown, _ = drawn(harness, camera)
    assert compare("thirty-kilometres", (shown[0], shown[1]), expected(camera, Placed())) >= 40


@pytest.mark.parametrize("radius", [200.0, 5_000.0])
def test_the_sun_sees_it_for_shadows(harness: Visit, radius: float) -> None:
    """From as far and as narrowly as three/shadows.ts looks, to a texel of its maps."""
    away, texel = 1000 * radius, 2 * radius / 2048
    eye = np.array([64.0, 64.0, 10.0]) + LIGHT.sun * away
    camera = Camera(tuple(eye), (64.0, 64.0, 10.0), float(np.degrees(2 * np.arctan(SIZE[1] / 2 * texel / away))))
    harness.do("maps => harness.take(maps)", [Placed().told])
    _, depth, _ = drawn(harness, camera, near=away / 2)
    _, right = expected(camera, Placed())
    there = np.isfinite(depth) & np.isfinite(right)
    assert there.any()
    # Its rim is a fifth of what is there, and falls within a texel of the map.
    assert (np.isfinite(depth) != np.isfinite(right)).sum() <= 0.06 * there.sum()
    assert (np.abs(depth[there] - right[there]) > texel).mean() < 0.05


def test_room_of_maps_that_are_dropped_is_used_again(harness: Visit) -> None:
    before = None
    for seed in (1, 2, 1):
        placed = Placed(seed=seed)
        harness.do("maps => harness.take(maps)", [placed.told])
        *shown, _ = drawn(harness, CAMERAS["afar"])
        assert compare(f"dropped-{seed}", (shown[0], shown[1]), expected(CAMERAS["afar"], placed)) >= 40
        memory = harness.do("harness.memory()")
        assert before in (None, memory)
        before = memory
