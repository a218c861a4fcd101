"""What is drawn of all that is held, and what leaving out the rest is worth (OV Figure 10).

    farfield bench culling [--quick] [--json]

The three scenes of `bench_quality.py` and all of Tokyo, where their worlds have been left (worlds/quality, `farfield
bench tokyo`), each from the street, from a roof and as birds see it: splats in memory, in the frustum and drawn; draw
calls; milliseconds of a frame with nothing left out but tiles outside the picture, with their parts outside it left
out, and with all that is hidden or faces away, one after the other in the same page, until the card is done (a read of
a pixel waits for it); whether the three pictures are the same to the last bit. Then a flight of small steps through
each: the median frame of both, and the share of pixels that a frame drawn by the one before lacks until the next.
640 x 480, one sample a pixel. Quick: the town of the tests from pictures alone, one camera.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Browser

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import Visit, opened_browser, visiting
from e2e.world import town

Triple = tuple[float, float, float]
SIZE = 640, 480
FOV = 46.8
WORLDS = Path(__file__).parents[1] / "worlds"
CULLINGS = ("none", "frustum", "all")

TAKE_OVER = """async () => {
  const {world} = farfield, {update} = world;
  const [camera, renderer] = await new Promise((taken) => {
    world.update = (...parts) => (taken(parts), false);
  });
  const gl = renderer.getContext(), pixel = new Uint8Array(4);
  const wait = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  const later = () => new Promise((resolve) => setTimeout(resolve, 2));
  window.bench = {
    give: () => delete world.update,
    async frame(culling) {
      world.setOptions({culling});
      wait();
      const begun = performance.now();
      update.call(world, camera, renderer, true);
      const made = performance.now();
      wait();
      const done = performance.now();
      return {frame: done - begun, script: made - begun};
    },
    async read() {
      const {session} = world;
      while (session.reader.waiting.length > 0) await later();
    },
    pixels() {
      const {target} = world.frame, {width, height} = target;
      const bytes = new Uint8Array(4 * width * height);
      renderer.readRenderTargetPixels(target, 0, 0, width, height, bytes);
      return new Uint32Array(bytes.buffer);
    },
    unlike: (a, b) => a.reduce((sum, pixel, n) => sum + (pixel !== b[n] ? 1 : 0), 0) / a.length,
  };
}"""
"""Takes drawing over from the page: `bench.frame` draws what the camera sees and waits for the card, once more even if
nothing has changed."""

STILL = """async ({cullings, repeats}) => {
  const found = {}, pictures = {};
  for (let n = 0; n < repeats; n++) {
    for (const culling of cullings) {
      // The first of them is drawn by what was seen before, with whatever that lacks.
      if (culling === "all" && n === 0) await bench.frame(culling);
      await bench.read();
      const times = await bench.frame(culling);
      await bench.read();
      pictures[culling] = bench.pixels();
      const stats = farfield.stats();
      (found[culling] ??= []).push({...times, drawn: stats.splats_drawn, runs: stats.splat_runs, tiles: stats.tiles,
        memory: stats.splats_in_memory, frustum: stats.splats_in_frustum});
    }
  }
  return {found, unlike: cullings.map((culling) => bench.unlike(pictures.none, pictures[culling]))};
}"""

FLIGHT = """async ({cameras, cullings}) => {
  const found = {}, pictures = [];
  for (const culling of cullings) {
    farfield.setCamera(cameras[0]);
    await bench.frame(culling);
    await bench.read();
    found[culling] = {times: [], drawn: [], unlike: []};
    for (let n = 1; n < cameras.length; n++) {
      farfield.setCamera(cameras[n]);
      found[culling].times.push((await bench.frame(culling)).frame);
      found[culling].drawn.push(farfield.stats().splats_drawn);
      if (culling === cullings[0]) pictures[n] = bench.pixels();
      else found[culling].unlike.push(bench.unlike(pictures[n], bench.pixels()));
      await bench.read();
    }
  }
  return found;
}"""


@dataclass(frozen=True)
class Course:
    """A world and what is looked at in it: an eye and a target by name; the first two are what is flown from and to."""

    store: Store
    cameras: dict[str, tuple[Triple, Triple]]
    step: float
    """Metres a frame of the flight."""
    steps: int = 12
    near_radius: float | None = None
    """Metres; None: the page's own choice."""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of all worlds that are there."""
    with tempfile.TemporaryDirectory(prefix="farfield-culling-") as folder, opened_browser() as browser:
        courses = {"town": _town(Path(folder))} if quick else _courses()
        return {name: _measured(browser, course, 1 if quick else 3) for name, course in courses.items()}


def _town(folder: Path) -> Course:
    store = DirectoryStore(folder / "town")
    bake(town(), store, BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1))
    return Course(store, {"street": ((-40.0, -42.0, 2.0), (0.0, 0.0, 2.0))}, 0.5, 2, near_radius=0.0)


def _courses() -> dict[str, Course]:
    found = {
        "tokyo": ("quality/tokyo", 1.0, ((401, 1693, 1.7), (250, 1500, 12)), ((192, 1388, 60), (400, 1500, 20)),
                  ((-100, 1000, 350), (250, 1450, 0))),
        "forest": ("quality/forest", 0.2, ((-60, -60, 1.7), (0, 0, 3)), ((-90, -90, 25), (0, 0, 8)),
                   ((-110, -110, 90), (0, 0, 0))),
        "statues": ("quality/statues", 0.05, ((-9, -9, 0.5), (0, 0, 0.5)), ((-10, -10, 2.5), (0, 0, 0.5)),
                    ((-14, -14, 10), (0, 0, 0))),
        "all of Tokyo": ("tokyo23/world-1", 5.0, ((15820, 16564, 2), (17000, 16200, 20)),
                         ((16000, 16000, 150), (18000, 17000, 30)), ((13000, 13000, 2500), (16000, 16000, 0))),
    }  # fmt: skip
    return {
        name: Course(open_store(str(WORLDS / path)), dict(zip(("street", "roof", "bird"), cameras, strict=True)), step)
        for name, (path, step, *cameras) in found.items()
        if (WORLDS / path / "world.json").exists()
    }


def _measured(browser: Browser, course: Course, repeats: int) -> dict[str, Any]:
    with serving(course.store, ServeOptions(port=0)) as url, visiting(browser, url, SIZE) as page:
        page.options(supersampling=1, nearRadius=course.near_radius)
        facts = {name: _still(page, eye, target, repeats) for name, (eye, target) in course.cameras.items()}
        return facts | {"flight": _flight(page, course)}


def _still(page: Visit, eye: Triple, target: Triple, repeats: int) -> dict[str, Any]:
    """The counts, draw calls and times of a view."""
    page.look(eye, target, FOV)
    page.do(TAKE_OVER)
    seen = page.do(STILL, {"cullings": CULLINGS, "repeats": repeats})
    page.do("bench.give()")
    last = {culling: frames[-1] for culling, frames in seen["found"].items()}
    times = {culling: [f["frame"] for f in frames] for culling, frames in seen["found"].items()}
    return {
        "splats_in_memory": last["all"]["memory"],
        "splats_in_frustum": last["all"]["frustum"],
        "splats_drawn": last["all"]["drawn"],
        "splats_drawn_without_culling": last["none"]["drawn"],
        "draw_calls": {culling: last[culling]["tiles"] for culling in CULLINGS},
        "runs": {culling: last[culling]["runs"] for culling in CULLINGS},
        "frame_ms": {culling: round(median(times[culling]), 1) for culling in CULLINGS},
        "script_ms": {culling: round(median(f["script"] for f in seen["found"][culling]), 1) for culling in CULLINGS},
        "same_picture": not any(seen["unlike"]),
    }


def _flight(page: Visit, course: Course) -> dict[str, Any]:
    """Forward from the first camera, and a little to the left."""
    eye, target = (np.array(point, dtype=float) for point in next(iter(course.cameras.values())))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    move = course.step * (0.8 * ahead + 0.6 * np.array((-ahead[1], ahead[0], 0.0)))
    cameras = [
        {"eye": (eye + n * move).tolist(), "target": (target + n * move).tolist(), "fov": FOV}
        for n in range(course.steps + 1)
    ]
    for camera in cameras:
        page.look(camera["eye"], camera["target"], FOV)
    page.do(TAKE_OVER)
    flown = page.do(FLIGHT, {"cameras": cameras, "cullings": ["none", "all"]})
    page.do("bench.give()")
    return {
        "frame_ms": {culling: round(median(found["times"]), 1) for culling, found in flown.items()},
        "splats_drawn": {culling: round(median(found["drawn"])) for culling, found in flown.items()},
        "pixels_that_lack_something": {
            "mean": float(np.mean(flown["all"]["unlike"])),
            "most": float(np.max(flown["all"]["unlike"])),
        },
    }
