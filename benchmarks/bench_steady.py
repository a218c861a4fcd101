"""How steady a moving picture is: temporal error along a path of 20 s at 30 frames a second, fading or not (OV 5.3).

    farfield bench steady [--quick] [--json]
    python benchmarks/bench_steady.py [SCENE ...] [--fade SECONDS,…] [--pairs N] [--pictures DIR] [--data DIR]

The real page at 320 x 240, its whole picture with near geometry, flies through the worlds of bench_quality on a clock
that the frames move on (flights.py); its link is a local one, so that tiles come a frame or two after they are wanted.
Of pairs of neighbouring frames, evenly along the path, each is compared with the true picture (64 samples a pixel) by
FLIP. The error of the first is moved to where its surfaces are in the second (by the true depths), since an error that
stays on its wall is not seen to flicker; the mean difference over covered pixels is the temporal error, `moved`. What
is in excess is more than that of the geometry itself with the same 2 x 2 samples. `held`: the second frame drawn with
the cells and tiles of the first; what is less than that without fading is what swaps add. `plain`: nothing is moved.
Quick: the town of the tests, two pairs.
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
from math import inf
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page
from scipy.ndimage import map_coordinates

from bench_quality import DATA, WORK
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.quality.metrics import covered, flip_map, psnr
from farfield.scene.model import Scene
from farfield.scene.read import read_scene
from farfield.serve.clock import SteppedClock
from farfield.serve.run import ServeOptions, serving
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.view.truth import TruthOptions, draw_truth
from flights import STALL_SECONDS, Journey, Pose, on_the_clock, settle
from scenes import make

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser
from e2e.world import town

FRAME = 1 / 30
"""Seconds."""
SECONDS = 20.0
SIZE = (320, 240)
PAIRS = 30
FADES = (0.0, 0.5)
"""Seconds that fading takes; the second is the viewer's default."""
SKY = np.array([158, 191, 235]) / 255
MARGIN = 4
"""Pixels at the picture's border that do not count: what comes in there has no past."""
FEW = 2
"""Samples along a side of a pixel, as the page has."""
SAME_SURFACE = 0.02
"""Share by which distances of one surface may differ."""
MEMORY = 1.2
"""Of the time of fading, for which frames before a pair are drawn, and no others: 3 % of them is left then."""
OPTIONS = {"frameMs": 0, "cacheBytes": 2 << 30, "uploadBytes": 1 << 30, "farGeometry": False}
"""Of the page, beside its defaults: everything is drawn in every frame."""
SCRIPT = Path(__file__).with_suffix(".js")
JOURNEYS = {
    "tokyo": ((300.0, 100.0, 100.0), 20.0, 90.0, 0.0),
    "forest": ((48.0, 0.0, 30.0), 5.0, 90.0, 60.0),
    "statues": ((12.0, 0.0, 3.0), 1.0, 90.0, 75.0),
}
"""Start, metres a second, heading in degrees from east, and seconds of a circle or 0 for swinging."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Way:
    """A path through a world and the scene that it shows."""

    scene: Scene
    journey: Journey
    truths: Path
    """Folder of the true pictures, made when they are missing."""
    samples: int = 8

    @property
    def poses(self) -> list[Pose]:
        """One a frame."""
        return list(self.journey.poses())


def run(quick: bool = False) -> dict[str, Any]:
    """Figures by scene and seconds of fading; of scenes whose worlds are there."""
    if not quick:
        return figures([name for name in JOURNEYS if (WORK / name / "world.json").exists()], FADES, PAIRS, WORK, DATA)
    with tempfile.TemporaryDirectory(prefix="farfield-steady-") as folder, opened_browser() as browser:
        way = _town(Path(folder))
        return {"town": measured(browser, way, FADES, pairs_of(way, 2))}


def figures(
    names: Sequence[str], fades: Sequence[float], pairs: int, work: Path, data: Path, pictures: Path | None = None
) -> dict[str, Any]:
    """Scene -> seconds of fading -> figures. pictures: folder for what is drawn."""
    found = {}
    for name in names:
        way = way_of(name, work, data)
        with opened_browser() as browser:
            found[name] = measured(browser, way, fades, pairs_of(way, pairs), pictures and pictures / name)
        print(name, found[name], file=sys.stderr, flush=True)
    return found


def way_of(name: str, work: Path, data: Path) -> Way:
    """Through the world of a scene that bench_quality has baked."""
    start, speed, heading, circle = JOURNEYS[name]
    turns = (inf, circle) if circle else (40.0, 20.0)
    journey = Journey(open_store(work / name), start, speed, heading, turns, -12.0, SECONDS, OPTIONS, SIZE, frame=FRAME)
    return Way(read_scene([make(name, data, work / "scenes")]), journey, work / f"{name}-truth-steady")


def _town(folder: Path) -> Way:
    scene = town()
    store = DirectoryStore(folder / "world")
    bake(scene, store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    options = OPTIONS | {"nearRadius": 20}
    journey = Journey(store, (-30.0, -30.0, 12.0), 8.0, 45.0, seconds=1.0, options=options, size=SIZE, frame=FRAME)
    return Way(scene, journey, folder / "truths", samples=4)


def pairs_of(way: Way, count: int) -> list[int]:
    """Numbers of the second frames of so many pairs, from the second second on where there are as many."""
    frames = round(way.journey.seconds / FRAME)
    first = min(round(1 / FRAME), frames // 2)
    return [first + (frames - 1 - first) * (n + 1) // count for n in range(count)]


def measured(
    browser: Browser, way: Way, fades: Sequence[float], pairs: Sequence[int], pictures: Path | None = None
) -> dict[str, Any]:
    """Seconds of fading -> figures."""
    flown = {fade: flights_pictures(browser, way, fade, pairs) for fade in fades}
    without, held = flown[fades[0]]
    rows: dict[float, list[dict[str, float]]] = {fade: [] for fade in fades}
    for n in pairs:
        pair = Pair.of(way, n)
        for fade, (drawn, _) in flown.items():
            rows[fade].append(pair.figures(drawn[n - 1], drawn[n]) | pair.floors(without[n - 1], held[n]))
            if pictures:
                side = np.concatenate([pair.after.pixels, drawn[n], held[n]], axis=1)
                pictures.mkdir(parents=True, exist_ok=True)
                Image.fromarray(side).save(pictures / f"{n:03d}-{fade}.png")
    found: dict[str, Any] = {}
    for fade, own in rows.items():
        found[str(fade)] = {name: round(fmean(row[name] for row in own), 5) for name in own[0]}
        found[str(fade)]["excess"] = round(found[str(fade)]["moved"] - found[str(fade)]["geometry"], 5)
    for fade in fades[1:]:
        found[str(fade)] |= less(found[str(fades[0])], found[str(fade)])
    return found


def less(off: dict[str, float], on: dict[str, float]) -> dict[str, float]:
    """How much less of each is left, as shares."""
    return {f"less_{name}": round(1 - on[name] / off[name], 3) for name in ("plain", "moved", "excess") if off[name]}


def flights_pictures(
    browser: Browser, way: Way, fade: float, pairs: Sequence[int]
) -> tuple[dict[int, Pixels], dict[int, Pixels]]:
    """Frame -> picture of both frames of each pair, and of the second with the cells and tiles of the first."""
    clock = SteppedClock()
    options = ServeOptions(port=0, clock=clock, stall_seconds=STALL_SECONDS)
    journey = replace(way.journey, options=way.journey.options | {"fade": fade})
    wanted = set(pairs) | {n - 1 for n in pairs}
    past = round(MEMORY * fade / FRAME)
    needed = {n - before for n in pairs for before in range(past + 2)}
    drawn, held = {}, {}
    with serving(journey.store, options) as url, on_the_clock(browser, url, journey, clock) as page:
        page.evaluate(SCRIPT.read_text())
        for n, pose in enumerate(way.poses):
            page.evaluate("given => flight.step(...given)", [1000 * FRAME, pose.given, n in needed])
            if n in wanted:
                drawn[n] = _picture(page, "steady.picture()")
            if n in pairs:
                held[n] = _picture(page, "steady.held()")
            page.evaluate("steady.keep()")
            clock.advance(FRAME)
            settle(page, clock)
    return drawn, held


def _picture(page: Page, script: str) -> Pixels:
    """(h, w, 3) uint8."""
    address: str = page.evaluate(script)
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        return np.array(image.convert("RGB"))


@dataclass(frozen=True, slots=True)
class TruePicture:
    """A true picture."""

    camera: Camera
    pixels: Pixels
    few: Pixels
    """With as few samples as the page has."""
    depth: NDArray[np.float32]
    alpha: NDArray[np.uint8]

    @classmethod
    def of(cls, way: Way, n: int) -> TruePicture:
        """Of a frame; kept."""
        pose = way.poses[n]
        camera = Camera(pose.eye, pose.target, pose.fov)
        file = way.truths / f"{n:03d}.npz"
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            picture, few = (
                draw_truth(way.scene, camera, way.journey.size, TruthOptions(s)) for s in (way.samples, FEW)
            )
            sky, alpha = linear_from_srgb(SKY), np.ceil(picture.alpha * 255).astype(np.uint8)
            both = {"pixels": picture.pixels(sky), "few": few.pixels(sky)}
            np.savez_compressed(file, **both, depth=picture.depth, alpha=alpha)
        kept = np.load(file)
        return cls(camera, kept["pixels"], kept["few"], kept["depth"], kept["alpha"])


@dataclass(frozen=True, slots=True)
class Pair:
    """Two true pictures, one after the other, and where what the second shows was in the first."""

    before: TruePicture
    after: TruePicture
    place: NDArray[np.float64]
    """(2, h, w) row and column in the first, pixels."""
    counts: NDArray[np.bool_]
    """(h, w): surfaces that both show."""

    @classmethod
    def of(cls, way: Way, n: int) -> Pair:
        """Of a second frame."""
        before, after = TruePicture.of(way, n - 1), TruePicture.of(way, n)
        size = way.journey.size
        found = np.isfinite(after.depth)
        depth = np.where(found, after.depth, 1.0)[..., None]
        points = after.camera.rays(size) * depth + np.array(after.camera.eye)
        projected = before.camera.project(points.reshape(-1, 3), size).reshape(*found.shape, 3)
        place = np.stack([projected[..., 1], projected[..., 0]]) - 0.5
        rows, columns = (
            np.clip(np.rint(axis).astype(int), 0, limit - 1) for axis, limit in zip(place, found.shape, strict=True)
        )
        then = before.depth[rows, columns]
        same = np.abs(then - projected[..., 2]) < SAME_SURFACE * projected[..., 2]
        inside = np.zeros_like(found)
        inside[MARGIN:-MARGIN, MARGIN:-MARGIN] = True
        return cls(before, after, place, found & same & inside & covered(after.alpha))

    def figures(self, first: Pixels, second: Pixels) -> dict[str, float]:
        """Of what was drawn: temporal error moved and plain; FLIP and PSNR of the second."""
        error, then = self._errors(first, second)
        counts = self.counts
        return {
            "moved": self._difference(error, then),
            "plain": float(np.abs(error - then)[counts].mean()),
            "flip": float(error[counts].mean()),
            "psnr": psnr(self.after.pixels, second, counts),
        }

    def floors(self, first: Pixels, held: Pixels) -> dict[str, float]:
        """Temporal error moved of the second with the cells and tiles of the first, and of the geometry itself."""
        pairs = {"held": (first, held), "geometry": (self.before.few, self.after.few)}
        return {name: self._difference(*self._errors(*pair)) for name, pair in pairs.items()}

    def _errors(self, first: Pixels, second: Pixels) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """FLIP of the second and of the first."""
        return flip_map(self.after.pixels, second), flip_map(self.before.pixels, first)

    def _difference(self, error: NDArray[np.float32], before: NDArray[np.float32]) -> float:
        moved = map_coordinates(before, self.place, order=1, mode="nearest")
        return float(np.abs(error - moved)[self.counts].mean())


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(JOURNEYS))
    parser.add_argument("--fade", default=",".join(map(str, FADES)))
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    fades = [float(seconds) for seconds in given.fade.split(",")]
    print(json.dumps(figures(given.scenes, fades, given.pairs, given.work, given.data, given.pictures), indent=2))


if __name__ == "__main__":
    main()
