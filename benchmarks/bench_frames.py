"""Frames of the real page with each mechanism on and off: time, primitives, bytes, picture.

    farfield bench frames [--quick] [--json]
    python benchmarks/bench_frames.py [SCENE ...] [--cameras N,…] [--levels leaf,far] [--data DIR]

The three scenes and cameras of bench_quality, far field alone, 640 x 480, from a local server. At each camera all
settings are drawn one after the other, twice round and three frames each, everything fetched: milliseconds until a
pixel can be read (median and 99th percentile over cameras and rounds), splats drawn, bytes of all that the picture
wants (what a first complete view costs), and the picture against the true one. `plain` draws three directions whole,
both layers, with nothing left out but tiles outside the picture. Then a moving picture with a frame time to keep (a
third of what it takes): steps of a thousandth of the distance, the later half of them. Quick: the small case of
bench_quality.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser

from bench_culling import TAKE_OVER
from bench_quality import DATA, GOALS, LEVELS_UP, WORK, Case, case, small_case, truth
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import compare
from farfield.serve.run import ServeOptions, serving
from flights import percentile

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import Visit, opened_browser, visiting

SKY = (158, 191, 235)
CAMERAS = (0, 4, 8)
"""Of the twelve."""
ROUNDS = 2
FRAMES = 3
"""A round."""
STEPS = 16
PLAIN: dict[str, Any] = {"views": 3, "layers": 2, "culling": "none", "fade": 0, "supersampling": 2, "shadows": False}
PLAIN |= {"patches": False}
PICKS = PLAIN | {"views": None, "leastGain": 10}
SPLATS = PICKS | {"culling": "all"}
CULLED = SPLATS | {"patches": True}
SETTINGS: dict[str, dict[str, Any]] = {
    "plain": PLAIN,
    "plain, culled": PLAIN | {"culling": "all"},
    "picks": PICKS,
    "picks, culled by frustum": PICKS | {"culling": "frustum"},
    "picks, culled, no patches": SPLATS,
    "3 views, culled": PLAIN | {"culling": "all", "patches": True},
    "picks, culled": CULLED,
    "picks of 20 pixels a kB, culled": CULLED | {"leastGain": 20},
    "picks, culled, fading": CULLED | {"fade": 0.5},
    "picks, culled, shadows": CULLED | {"shadows": True},
    "picks, culled, 1 sample": CULLED | {"supersampling": 1},
    "picks, culled, 4 x 4 samples": CULLED | {"supersampling": 4},
    "picks, culled, a level coarser": CULLED | {"bias": 1},
}
DRAWN = """async ({settings}) => {
  farfield.setOptions({bias: 0, leastGain: 10, ...settings});
  await farfield.whenComplete();
  const {session} = farfield.world;
  const bytes = session.seen.reduce((sum, one) => sum + session.loader.sizes.of(one), 0);
  return {bytes};
}"""
FRAMES_DRAWN = """async ({culling, frames}) => {
  const times = [];
  for (let n = 0; n < frames; n++) {
    await bench.read();
    times.push((await bench.frame(culling)).frame);
  }
  await bench.read();
  return {times, splats: farfield.stats().splats_drawn, tiles: farfield.stats().tiles};
}"""
MOVING = """async ({cameras, frameMs}) => {
  farfield.setOptions({frameMs});
  const found = [];
  for (const camera of cameras) {
    farfield.setCamera(camera);
    const {frame} = await bench.frame("all");
    // Cards tell how long a frame took when they are done with it.
    for (let n = 0; n < 3; n++) await new Promise((resolve) => setTimeout(resolve, 2));
    const {splats_drawn, reduction} = farfield.stats();
    found.push({frame, splats: splats_drawn, reduction});
  }
  farfield.setOptions({frameMs: 0});
  return found;
}"""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of the scenes whose worlds are there."""
    if not quick:
        names = [name for name in GOALS if (WORK / name / "world.json").exists()]
        return figures(names, list(LEVELS_UP), CAMERAS, WORK, DATA)
    with tempfile.TemporaryDirectory(prefix="farfield-frames-") as folder, opened_browser() as browser:
        few = {name: SETTINGS[name] for name in ("plain", "picks, culled")}
        return {"small": measured(browser, small_case(Path(folder)), (0,), few)}


def figures(
    names: Sequence[str], levels: Sequence[str], cameras: Sequence[int], work: Path, data: Path
) -> dict[str, Any]:
    """Scene -> level -> setting -> figures."""
    found: dict[str, Any] = {}
    for name in names:
        for level in levels:
            with opened_browser() as browser:
                facts = measured(browser, case(name, level, work, data), cameras, SETTINGS)
            found.setdefault(name, {})[level] = facts
            print(name, level, json.dumps(facts), file=sys.stderr, flush=True)
    return found


def measured(
    browser: Browser, case: Case, cameras: Sequence[int], settings: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """Setting -> figures, and those of a moving picture."""
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in settings}
    times: dict[str, list[float]] = {name: [] for name in settings}
    moving: list[dict[str, float]] = []
    with serving(case.world.store, ServeOptions(port=0)) as url, visiting(browser, url, case.size) as page:
        page.do("farfield.hideInterface()")
        for number in cameras:
            camera = case.cameras[number]
            page.options(farOnly=True, frameMs=0, nearRadius=case.near_radius(camera), cacheBytes=3 << 30)
            page.look(camera.eye, camera.target, camera.fov)
            for one in range(ROUNDS):
                for name, chosen in settings.items():
                    row, drawn = _drawn(page, chosen)
                    times[name] += drawn
                    if one == 0:
                        found = compare(truth(case, number), _picture(page))
                        rows[name].append(row | {key: found[key] for key in ("psnr_covered", "flip_covered")})
            page.do(DRAWN, {"settings": CULLED})
            moving += _moving(page, camera, median(times["picks, culled"][-FRAMES:]) / 3)
    facts: dict[str, Any] = {name: _figures(rows[name], times[name]) for name in settings}
    return facts | {
        "kept to a third of the time": {key: round(fmean(row[key] for row in moving), 3) for key in moving[0]}
    }


def _drawn(page: Visit, settings: dict[str, Any]) -> tuple[dict[str, float], list[float]]:
    row: dict[str, float] = page.do(DRAWN, {"settings": settings})
    page.do(TAKE_OVER)
    found = page.do(FRAMES_DRAWN, {"culling": settings["culling"], "frames": FRAMES})
    page.do("bench.give()")
    return {"splats": found["splats"], "draw_calls": found["tiles"], "bytes": row["bytes"]}, found["times"]


def _figures(rows: list[dict[str, float]], times: list[float]) -> dict[str, float]:
    spread = {"frame_ms": round(median(times), 1), "frame_ms_p99": round(percentile(times, 0.99), 1)}
    return spread | {key: round(fmean(row[key] for row in rows), 4) for key in rows[0]}


def _moving(page: Visit, camera: Camera, frame_ms: float) -> list[dict[str, float]]:
    """Frames of a picture that moves: how near their times are to what they may take, and how much less they draw."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    aside = np.cross(target - eye, (0.0, 0.0, 1.0)) / 1000
    cameras = [
        {"eye": (eye + n * aside).tolist(), "target": (target + n * aside).tolist(), "fov": camera.fov}
        for n in range(1, STEPS + 1)
    ]
    page.do(TAKE_OVER)
    found = page.do(MOVING, {"cameras": cameras, "frameMs": frame_ms})[STEPS // 2 :]
    page.do("bench.give()")
    return [row | {"share_of_time": row["frame"] / frame_ms} for row in found]


def _picture(page: Visit) -> NDArray[np.uint8]:
    """(h, w, 4) uint8: what is shown; transparent where it is the sky exactly."""
    page.complete()
    pixels = page.picture()
    alpha = 255 * (np.abs(pixels.astype(int) - SKY).max(-1, keepdims=True) > 1)
    return np.concatenate([pixels, alpha.astype(np.uint8)], axis=-1)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(GOALS))
    parser.add_argument("--cameras", default=",".join(map(str, CAMERAS)))
    parser.add_argument("--levels", default=",".join(LEVELS_UP))
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    cameras = [int(number) for number in given.cameras.split(",")]
    print(json.dumps(figures(given.scenes, given.levels.split(","), cameras, given.work, given.data), indent=2))


if __name__ == "__main__":
    main()
