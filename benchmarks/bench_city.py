"""A city in the page, by BlockMaps and as all its geometry: frames, bytes and pictures (BLK 5).

    farfield bench city [--quick] [--json]
    python benchmarks/bench_city.py [--work DIR] [--data DIR] [--views whole,roofs,street] [--plot FILE]

The 80,414 buildings of `cities.py`, baked with `--represent blockmap,geometry`. For each view a page of its own with an
empty cache, 640 x 480, 2 x 2 samples: bytes of all that came until the first complete picture and seconds until then,
milliseconds a frame until a pixel can be read (median), and the picture against the true one. `blockmaps`: geometry
where leaves are near alone; `free`: geometry also where it shows more for its bytes; `geometry`: all leaves.
Rates (BLK figures 6 and 7): the whole city seen from ever farther, by BlockMaps of three sizes with texels of 4 m in
their leaves, and by 64:256 held to levels, 1 sample; beside all geometry and that of a quarter of the city.
Quick: a small town of boxes.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser

from bench_culling import TAKE_OVER
from bench_quality import DATA
from cities import make
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import compare
from farfield.quality.pictures import read_picture
from farfield.scene.model import Scene
from farfield.scene.read import read_scene
from farfield.serve.run import ServeOptions, serving
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from bake.scenes import village
from e2e.browsing import Visit, opened_browser, visiting

WORK = Path(__file__).parents[1] / "worlds"
SIZE = (640, 480)
SKY = (158, 191, 235)
FOV = 45.0
FRAMES = 7
ALL = 1e9
"""Metres: a near radius within which everything is geometry."""
VIEWS = {"whole": ((0.0, -0.95, 0.55), (0.0, -0.05, 0.0)), "roofs": ((0.0, -0.08, 0.03), (0.05, 0.3, 0.0)),
         "street": ((0.003, -0.02, 0.004), (0.02, 0.2, 0.004))}  # fmt: skip
"""Eye and target from the middle of the ground, in parts of the world's width."""
MODES: dict[str, dict[str, Any]] = {
    "blockmaps": {"farGeometry": False},
    "free": {},
    "geometry": {"nearRadius": ALL, "cacheBytes": 3 << 30},
}
MAPS = {"farGeometry": False, "nearRadius": 0}
STILL: dict[str, Any] = {"frameMs": 0, "fade": 0, "shadows": False, "supersampling": 2}
SIZES = {"16:64": 64.0, "32:192": 128.0, "64:256": 256.0}
"""Leaf size, metres, by that of BlockMaps."""
AWAY = (1.2, 1.7, 2.4, 3.4, 4.8, 6.8, 9.6)
"""Distances in widths of the city."""
BIASES = (-2.0, -1.0, 0.0, 1.0, 2.0)
FRAMES_DRAWN = """async ({frames}) => {
  const times = [];
  for (let n = 0; n < frames; n++) times.push((await bench.frame("all")).frame);
  return times;
}"""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of the city whose world is there."""
    if not quick:
        return figures(WORK, DATA, list(VIEWS))
    with tempfile.TemporaryDirectory(prefix="farfield-city-") as folder, opened_browser() as browser:
        scene = village()
        store = DirectoryStore(Path(folder) / "world")
        bake(scene, store, BakeOptions(leaf_size=16.0, resolution=16, orthoviews=False, blockmap="16:64", workers=1))
        world = World.open(store)
        found = {"views": seen(browser, world, scene, ["whole"], Path(folder))}
        return found | {"rates": {"16:64": rates(browser, world, AWAY[:2], MAPS)}}


def figures(work: Path, data: Path, views: Sequence[str]) -> dict[str, Any]:
    """Of all views, and the rates."""
    scene = make("city", data, work / "scenes")
    world = baked(scene, work / "city", options_of_a_city())
    found: dict[str, Any] = {}
    with opened_browser() as browser:
        found["views"] = seen(browser, world, read_scene([scene]), views, work / "city-pictures")
    found["rates"] = {}
    for size, leaf in SIZES.items():
        side = int(size.split(":")[0])
        options = BakeOptions(leaf_size=leaf, resolution=side, orthoviews=False, blockmap=size, geometry=False)
        own = baked(scene, work / f"city-{side}", options)
        with opened_browser() as browser:
            found["rates"][size] = rates(browser, own, AWAY, MAPS)
            if size == "64:256":
                levels = {f"{bias:+.0f}": MAPS | {"bias": bias} for bias in BIASES}
                found["rates by level"] = {n: rates(browser, own, AWAY, chosen) for n, chosen in levels.items()}
    quarter = baked(make("quarter", data, work / "scenes"), work / "quarter", options_of_a_city())
    for name, own in (("geometry", world), ("geometry of a quarter", quarter)):
        with opened_browser() as browser:
            found["rates"][name] = rates(browser, own, AWAY, MODES["geometry"])
    return found


def options_of_a_city() -> BakeOptions:
    """As a user has it without options of their own but `--represent blockmap,geometry`."""
    return BakeOptions(orthoviews=False, blockmap="64:256", resolution=64)


def plot(found: dict[str, Any], file: Path) -> None:
    """Milliseconds a frame over pixels that the city covers: by size of BlockMaps, and by level."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4), dpi=100, sharex=True)
    levels = {f"64:256, bias {bias}": rows for bias, rows in found["rates by level"].items()}
    for axes, curves in zip(panels, (found["rates"], levels), strict=True):
        for name, rows in curves.items():
            style = "--" if name.startswith("geometry") else "-"
            axes.plot(
                [row["pixels"] for row in rows],
                [row["frame_ms"] for row in rows],
                f"o{style}",
                label=name,
                markersize=3,
            )
        axes.set(xscale="log", yscale="log", xlabel="pixels that the city covers", ylabel="milliseconds a frame")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(file)


def baked(scene: Path, folder: Path, options: BakeOptions) -> World:
    """The world of a scene, baked unless it is there."""
    store = open_store(folder, create=True)
    if not (folder / "world.json").exists():
        bake(read_scene([scene]), store, options)
    return World.open(store)


def seen(browser: Browser, world: World, scene: Scene, views: Sequence[str], kept: Path) -> dict[str, Any]:
    """View -> mode -> figures. kept: folder for true pictures and those of the page."""
    kept.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    for name in views:
        camera = camera_of(world, *VIEWS[name])
        file = kept / f"{name}-true.png"
        if not file.exists():
            Image.fromarray(draw_truth(scene, camera, SIZE, TruthOptions(8)).pixels(None)).save(file)
        true = read_picture(file)
        for mode, settings in MODES.items():
            facts, picture = opened(browser, world, camera, settings)
            Image.fromarray(picture).save(kept / f"{name}-{mode}.png")
            alpha = 255 * (np.abs(picture.astype(int) - SKY).max(-1, keepdims=True) > 1).astype(np.uint8)
            likeness = compare(true, np.concatenate([picture, alpha], axis=-1))
            facts |= {key: round(likeness[key], 4) for key in ("psnr", "flip", "psnr_covered", "flip_covered")}
            found.setdefault(name, {})[mode] = facts
            print(name, mode, json.dumps(facts), file=sys.stderr, flush=True)
    return found


def camera_of(world: World, eye: Sequence[float], target: Sequence[float]) -> Camera:
    """eye, target: see VIEWS."""
    lower, upper = np.array(world.manifest.bounds)
    width = float((upper - lower)[:2].max())
    middle = np.array([*((lower + upper) / 2)[:2], lower[2]])
    ends = [tuple((middle + width * np.array(end)).tolist()) for end in (eye, target)]
    return Camera(ends[0], ends[1], FOV)


def opened(
    browser: Browser, world: World, camera: Camera, settings: dict[str, Any]
) -> tuple[dict[str, Any], NDArray[np.uint8]]:
    """What a page takes to show a view, and the picture."""
    with serving(world.store, ServeOptions(port=0)) as url, visiting(browser, url, SIZE) as page:
        page.do("farfield.hideInterface()")
        page.options(**STILL, **settings)
        before, begun = page.stats()["bytes"], time.monotonic()
        page.look(camera.eye, camera.target, camera.fov)
        seconds, stats = time.monotonic() - begun, page.stats()
        picture = page.picture()
        times = frame_times(page)
        facts = {name: stats[name] for name in ("bytes", "blockmaps", "blockmap_calls", "triangles", "cut_cells")}
        facts |= {"bytes_before": before, "seconds": round(seconds, 1), "frame_ms": round(median(times), 1)}
        return facts, picture


def rates(browser: Browser, world: World, away: Sequence[float], settings: dict[str, Any]) -> list[dict[str, float]]:
    """For each distance, in widths of the world, milliseconds a frame and pixels that it covers."""
    found = []
    with serving(world.store, ServeOptions(port=0)) as url, visiting(browser, url, SIZE) as page:
        page.do("farfield.hideInterface()")
        page.options(**STILL | {"supersampling": 1}, **settings)
        for distance in away:
            camera = camera_of(world, (0.0, -0.8 * distance, 0.6 * distance), (0.0, 0.0, 0.0))
            page.look(camera.eye, camera.target, camera.fov)
            stats = page.stats()
            pixels = int((np.abs(page.picture().astype(int) - SKY).max(axis=-1) > 1).sum())
            row = {"away": distance, "pixels": pixels, "frame_ms": round(median(frame_times(page)), 1)}
            found.append(row | {name: stats[name] for name in ("blockmaps", "blockmap_calls", "triangles")})
            print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    return found


def frame_times(page: Visit) -> list[float]:
    """Milliseconds of some frames, one after the other; the first is drawn by what was seen before, and left out."""
    page.do(TAKE_OVER)
    times: list[float] = page.do(FRAMES_DRAWN, {"frames": FRAMES + 1})
    page.do("bench.give()")
    return times[1:]


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--views", default=",".join(VIEWS))
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    found = figures(given.work, given.data, given.views.split(","))
    print(json.dumps(found, indent=2))
    if given.plot:
        plot(found, given.plot)


if __name__ == "__main__":
    main()
