"""The page in a real Chromium on software GL: how soon it is there, whether it is right, what a flight costs.

    farfield bench page [--quick] [--json]

The demo's world at 640 x 480 from a local server: milliseconds from navigation to the first complete picture (median of
five visits, each with an empty cache), PSNR against the reference renderer at the same cameras and samples, pictures
alone and with near geometry, and a scripted flight of 20 seconds. The first picture and a flight in the world of all of
Tokyo too, if `farfield bench tokyo` has left it. Quick: the town of the tests, 2 seconds.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Browser

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.cli.demo import demo_world
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import Visit, opened_browser, psnr, visiting
from e2e.world import town

Triple = tuple[float, float, float]
SKY = linear_from_srgb(np.array([158, 191, 235]) / 255)
SIZE = 640, 480
FOV = 46.8
CACHE_BYTES = 64 << 20
TOKYO = Path(__file__).parents[1] / "worlds/tokyo23/world-1"


@dataclass(frozen=True)
class Course:
    """What is looked at in a world."""

    store: Store
    middle: Triple
    reach: float
    """Metres from the middle to the eyes."""
    near_radius: float
    """Metres, for the pictures with near geometry."""
    seconds: float
    visits: int

    @property
    def eyes(self) -> list[Triple]:
        """Low, middling and far, on three sides."""
        x, y, z = self.middle
        far = self.reach
        return [(x - 0.3 * far, y, z + 0.06 * far), (x, y + 0.8 * far, z + 0.3 * far), (x + far, y - far, z + far)]


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of the page."""
    with tempfile.TemporaryDirectory(prefix="farfield-page-") as folder, opened_browser() as browser:
        course = _town(Path(folder)) if quick else _demo()
        with serving(course.store, ServeOptions(port=0)) as url:
            facts = _first_pictures(browser, url, course.visits) | {
                "psnr_pictures": _against_reference(browser, url, course, 0.0),
                "psnr_with_geometry": _against_reference(browser, url, course, course.near_radius),
                "flight": _flight(browser, url, course),
            }
        if not quick and TOKYO.exists():
            course = Course(open_store(str(TOKYO)), (16_000.0, 16_000.0, 20.0), 3_000.0, 60.0, 20.0, 5)
            with serving(course.store, ServeOptions(port=0)) as url:
                facts["tokyo"] = _first_pictures(browser, url, course.visits)
                facts["tokyo"]["flight"] = _flight(browser, url, course)
        return facts


def _town(folder: Path) -> Course:
    store = DirectoryStore(folder / "town")
    bake(town(), store, BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1))
    return Course(store, (0.0, 0.0, 2.0), 60.0, 60.0, 2.0, 1)


def _demo() -> Course:
    """Tokyo Station."""
    return Course(open_store(demo_world()), (1010.0, 420.0, 10.0), 420.0, 60.0, 20.0, 5)


@contextmanager
def _visit(browser: Browser, url: str) -> Iterator[Visit]:
    """The page with an empty cache. Raises RuntimeError when anything was said on its console."""
    with visiting(browser, url, SIZE) as page:
        page.complete()
        yield page
        # What is said while the page is closed is of connections that are given up.
        said = list(page.errors)
    if said:
        raise RuntimeError(f"on the console: {said[:3]}")


def _first_pictures(browser: Browser, url: str, visits: int) -> dict[str, Any]:
    """Median time of so many visits, each with an empty cache; bytes and splats of the first."""
    first = []
    for _ in range(visits):
        with _visit(browser, url) as page:
            first.append(page.stats())
    return {
        "first_picture_ms": round(median(stats["first_picture_ms"] for stats in first)),
        "first_picture_bytes": first[0]["bytes"],
        "first_picture_splats": first[0]["splats"],
    }


def _against_reference(browser: Browser, url: str, course: Course, near: float) -> list[float]:
    """dB at each of the eyes, 2 x 2 samples."""
    world, found = World.open(course.store), []
    options = RenderOptions(supersampling=2, near_radius=near)
    with _visit(browser, url) as page:
        page.options(supersampling=2, nearRadius=near)
        for eye in course.eyes:
            page.look(eye, course.middle, FOV)
            expected = render_world(world, Camera(eye, course.middle, FOV), SIZE, options).pixels(SKY)
            found.append(round(psnr(page.picture(), expected), 1))
    return found


def _flight(browser: Browser, url: str, course: Course) -> dict[str, Any]:
    with _visit(browser, url) as page:
        page.options(cacheBytes=CACHE_BYTES, supersampling=1)
        page.complete()
        flown = page.fly(course.seconds, course.middle, 0.6 * course.reach, 0.15 * course.reach)
        return {
            "frames": flown["frames"],
            "bytes": flown["fetched"],
            "fetched_while_held": len(flown["again"]),
            "most_held_bytes": flown["most"],
            "budget_bytes": CACHE_BYTES,
            "tiles_missing": flown["last"]["tiles_missing"],
        }
