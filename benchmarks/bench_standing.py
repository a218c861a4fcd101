"""What is seen so many seconds after coming to stand somewhere on a slow link, by the order of fetching (BEN-7).

    farfield bench standing [--quick] [--json]
    python benchmarks/bench_standing.py [SCENE ...] [--bandwidth BYTES] [--pictures DIR] [--data DIR]

The real page at 640 x 480, near geometry and all, from an empty cache, on a clock that its frames move on (flights.py):
250 kB/s and a round trip of 40 ms. FLIP and PSNR of what is on the screen to the true picture (16 samples a pixel)
after some seconds, with what adds most for its bytes fetched first (option `benefit`) and with what is nearest first;
and when the picture was complete. From the street, from a roof and as birds see it. Quick: the town of the tests.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser

from bench_quality import DATA, WORK
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.quality.metrics import flip_map, psnr
from farfield.scene.model import Scene
from farfield.scene.read import read_scene
from farfield.serve.clock import SteppedClock
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.view.truth import TruthOptions, draw_truth
from flights import FRAME, SLICES, STALL_SECONDS, Journey, on_the_clock, settle
from scenes import make

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser
from e2e.world import town

BANDWIDTH = 250_000.0
"""Bytes a second."""
DELAY = 0.04
"""Seconds of the round trip."""
LOOKED_AT = (1.0, 2.0, 5.0, 10.0, 20.0)
"""Seconds after which the picture is compared."""
LONGEST = 120.0
"""Seconds that are waited for a complete picture."""
SIZE = (640, 480)
SKY = np.array([158, 191, 235]) / 255
ORDERS = {"nearest": False, "benefit": True}
OPTIONS = {"frameMs": 0, "fade": 0, "uploadBytes": 1 << 30, "cacheBytes": 2 << 30}
"""Of the page, beside its defaults: what is there is shown at once."""
PLACES = {
    "tokyo": (((401, 1693, 1.7), (250, 1500, 12)), ((192, 1388, 60), (400, 1500, 20)),
              ((-100, 1000, 350), (250, 1450, 0))),
    "forest": (((-60, -60, 1.7), (0, 0, 3)), ((-90, -90, 25), (0, 0, 8)), ((-110, -110, 90), (0, 0, 0))),
    "statues": (((-9, -9, 0.5), (0, 0, 0.5)), ((-10, -10, 2.5), (0, 0, 0.5)), ((-14, -14, 10), (0, 0, 0))),
}  # fmt: skip
"""Eyes and targets: street, roof, bird."""
PLACES["avenues"] = PLACES["tokyo"]

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Stand:
    """A place to look from, in a world and in the scene that it shows."""

    scene: Scene
    store: Store
    camera: Camera
    truth: Path
    options: dict[str, Any]
    size: tuple[int, int] = SIZE

    def true_picture(self) -> Pixels:
        """(h, w, 3), drawn once and kept."""
        if not self.truth.exists():
            self.truth.parent.mkdir(parents=True, exist_ok=True)
            picture = draw_truth(self.scene, self.camera, self.size, TruthOptions(4))
            Image.fromarray(picture.pixels(linear_from_srgb(SKY))).save(self.truth)
        with Image.open(self.truth) as image:
            return np.array(image.convert("RGB"))


def run(quick: bool = False) -> dict[str, Any]:
    """Figures by scene and order; of scenes whose worlds are there."""
    if not quick:
        return figures([name for name in PLACES if (WORK / name / "world.json").exists()], BANDWIDTH, DATA)
    with tempfile.TemporaryDirectory(prefix="farfield-standing-") as folder, opened_browser() as browser:
        store = DirectoryStore(Path(folder) / "world")
        bake(town(), store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
        camera = Camera((-40.0, -42.0, 8.0), (0.0, 0.0, 2.0))
        stand = Stand(town(), store, camera, Path(folder) / "truth.png", OPTIONS | {"nearRadius": 20}, (160, 120))
        return {"town": compared(browser, [stand], BANDWIDTH / 10, (1.0, 2.5, 15.0))}


def figures(names: Sequence[str], bandwidth: float, data: Path, pictures: Path | None = None) -> dict[str, Any]:
    """Scene -> figures. pictures: folder for what is seen."""
    found = {}
    for name in names:
        scene = read_scene([make(name, data, WORK / "scenes")])
        stands = [
            Stand(scene, open_store(WORK / name), Camera(*place), WORK / f"{name}-truth-standing/{n}.png", OPTIONS)
            for n, place in enumerate(PLACES[name])
        ]
        with opened_browser() as browser:
            found[name] = compared(browser, stands, bandwidth, LOOKED_AT, pictures and pictures / name)
        print(name, json.dumps(found[name]), file=sys.stderr, flush=True)
    return found


def compared(
    browser: Browser,
    stands: Sequence[Stand],
    bandwidth: float,
    looked_at: Sequence[float],
    pictures: Path | None = None,
) -> dict[str, Any]:
    """Means over places, by order and second; and how much lower FLIP is by benefit."""
    rows: dict[str, list[dict[str, Any]]] = {order: [] for order in ORDERS}
    for number, stand in enumerate(stands):
        for order, benefit in ORDERS.items():
            seen = stood(browser, replace(stand, options=stand.options | {"benefit": benefit}), bandwidth, looked_at)
            rows[order].append(_judged(seen, stand.true_picture()) | {"complete": seen.complete, "bytes": seen.bytes})
            if pictures:
                pictures.mkdir(parents=True, exist_ok=True)
                for second, picture in seen.pictures.items():
                    Image.fromarray(picture).save(pictures / f"{number}-{order}-{second:g}.png")
    means = {order: _means(own) for order, own in rows.items()}
    less = {
        second: round(1 - means["benefit"]["flip"][second] / means["nearest"]["flip"][second], 3)
        for second in means["nearest"]["flip"]
    }
    return means | {"less_flip": less, "places": rows}


@dataclass(slots=True)
class Seen:
    """What came to be seen from a place."""

    pictures: dict[float, Pixels]
    """By seconds."""
    complete: float
    """Seconds until everything was there; LONGEST: longer."""
    bytes: int
    """That had come by then."""


def stood(browser: Browser, stand: Stand, bandwidth: float, looked_at: Sequence[float]) -> Seen:
    """Stands at a place until the picture is complete."""
    clock = SteppedClock()
    served = ServeOptions(port=0, bandwidth=bandwidth, delay=DELAY, clock=clock, stall_seconds=STALL_SECONDS)
    journey = Journey(stand.store, stand.camera.eye, 0.0, 0.0, options=stand.options, size=stand.size)
    pose = {"eye": stand.camera.eye, "target": stand.camera.target, "fov": stand.camera.fov}
    drawn_at = {round(second / FRAME): second for second in looked_at}
    seen = Seen({}, LONGEST, 0)
    with serving(stand.store, served) as url, on_the_clock(browser, url, journey, clock) as page:
        page.evaluate(LOOKED_THROUGH)
        for n in range(round(LONGEST / FRAME)):
            if n in drawn_at:
                page.evaluate(ANEW)
            page.evaluate("given => flight.step(...given)", [1000 * FRAME, pose, n in drawn_at or n == 0])
            if n in drawn_at:
                seen.pictures[drawn_at[n]] = _picture(page.evaluate(SHOWN))
            if seen.complete == LONGEST and page.evaluate("farfield.world.session.complete"):
                seen.complete, seen.bytes = n * FRAME, page.evaluate("farfield.stats().bytes")
            if seen.complete < LONGEST and n >= max(drawn_at):
                break
            for _ in range(SLICES):
                clock.advance(FRAME / SLICES)
                settle(page, clock)
    return seen


LOOKED_THROUGH = """() => {
  const {world} = farfield, update = world.update.bind(world);
  world.update = (camera, ...rest) => update((window.camera = camera), ...rest);
}"""
"""Keeps the page's camera."""

ANEW = "() => Object.assign(farfield.world, {drawDirty: true, mustDraw: true})"
"""Frames that are not looked at are not drawn, which nothing but this would make up for."""

SHOWN = """() => {
  // The drawing buffer is gone by now: the same is shown once more.
  farfield.world.renderer.render(farfield.world.parent, window.camera);
  return document.getElementById("picture").toDataURL("image/png");
}"""


def _picture(address: str) -> Pixels:
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        return np.array(image.convert("RGB"))


def _judged(seen: Seen, truth: Pixels) -> dict[str, Any]:
    """FLIP and PSNR by second."""
    return {
        "flip": {f"{second:g}": float(flip_map(truth, picture).mean()) for second, picture in seen.pictures.items()},
        "psnr": {f"{second:g}": float(psnr(truth, picture)) for second, picture in seen.pictures.items()},
    }


def _means(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {
        name: {second: round(fmean(row[name][second] for row in rows), 4) for second in rows[0][name]}
        for name in ("flip", "psnr")
    }
    return found | {name: round(fmean(row[name] for row in rows), 1) for name in ("complete", "bytes")}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(PLACES))
    parser.add_argument("--bandwidth", type=float, default=BANDWIDTH)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--pictures", type=Path)
    given = parser.parse_args()
    print(json.dumps(figures(given.scenes, given.bandwidth, given.data, given.pictures), indent=1))


if __name__ == "__main__":
    main()
