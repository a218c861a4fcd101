"""Splatting in WebGPU compute beside the page's own WebGL2: time, processor time and whether the pictures are the same.

    farfield bench webgpu [--quick] [--json]
    python benchmarks/bench_webgpu.py [--rounds N]

Worlds of `bench_quality.py` where they have been left (worlds/quality), pictures alone, 640 x 480 with 1 x 1 and 2 x 2
samples, one way after the other in the same page and round after round. The page (`webgl2`) draws, averages and is
waited for until a pixel of its canvas can be read; what it takes to choose what is drawn is left off. WGSL
(benchmarks/webgpu) has the same splats, words and uniforms, and draws depths by `atomicMax`, then colours: over all
splats (`all`), over those that were nearest once (`listed`), or in the same pass (`at once`, which is not safe: a
bound). It goes into the page's frame with its depth by way of memory (`frame`), as near geometry, shadows, haze and a
scene around it need; into a texture of the page by way of a canvas, colour alone (`canvas`); or to a canvas of its own,
which is the screen (`alone`). In all of these every pixel is a splat; the page with its patches (`webgl2, patches`) is
measured right after. Quick: the town of the tests.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Browser

from bench_mesh_levels import processor_ms
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
FOLDER = Path(__file__).parent / "webgpu"
WORLDS = Path(__file__).parents[1] / "worlds/quality"
SIZE = 640, 480
FOV = 46.8
WEBGPU = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"]
CAMERAS: dict[str, dict[str, tuple[Triple, Triple]]] = {
    "statues": {"far": ((-40, -40, 16), (0, 0, 0)), "middle": ((-26, -26, 12), (0, 0, 0))},
    "tokyo": {"bird": ((-700, 300, 600), (250, 1450, 0))},
}
VARIANTS = ("all", "listed", "at once")
WAYS = {
    "webgl2": "page.frame()",
    "frame, all": 'compute.frameIn("all")',
    "frame, listed": 'compute.frameIn("listed")',
    "frame, at once": 'compute.frameIn("at once")',
    "canvas, listed": 'compute.throughCanvas("listed")',
    "alone, listed": 'compute.alone("listed")',
}
FRAMES = 2
"""Of a way in a round."""
NONE = "the browser has no WebGPU"

BEGIN = """async (shaders) => {
  %s
  window.psnr = psnr;
  window.ways = await takeOver(shaders);
  const {compute} = ways;
  return compute && {adapter: compute.adapter, splats: compute.splats, tiles: compute.drawn.length};
}"""
COMPARE = """async (variant) => {
  const {page, compute} = ways, own = page.picture();
  await page.settle();
  return psnr(own, await compute.pictureIn(variant));
}"""
REPEAT = """async (frames) => {
  const {page, compute} = ways, times = [];
  for (let n = 0; n < frames; n++) {
    times.push(await %s);
    await page.settle();
  }
  return times;
}"""


def run(quick: bool = False, rounds: int = 3) -> dict[str, Any]:
    """Figures of all worlds that are there; why there are none, where the browser has no WebGPU."""
    with tempfile.TemporaryDirectory(prefix="farfield-webgpu-") as folder, opened_browser(WEBGPU) as browser:
        found: dict[str, Any] = {}
        for name, store, cameras in [_town(Path(folder))] if quick else _worlds():
            with serving(store, ServeOptions(port=0)) as url:
                for camera, (eye, target) in cameras.items():
                    for samples in (1,) if quick else (1, 2):
                        with _visit(browser, url, eye, target, samples, patches=False) as page:
                            figures = _measured(page, 1 if quick else rounds)
                        if figures is None:
                            return {"skipped": NONE}
                        with _visit(browser, url, eye, target, samples, patches=True) as page:
                            _add_patches(page, 1 if quick else rounds, figures)
                        case = f"{name}, {camera}, {samples} x {samples}"
                        found[case] = figures
                        print(case, figures, file=sys.stderr, flush=True)
        return found


def _town(folder: Path) -> tuple[str, Store, dict[str, tuple[Triple, Triple]]]:
    store = DirectoryStore(folder / "town")
    bake(town(), store, BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1))
    return "town", store, {"street": ((-60.0, -62.0, 22.0), (0.0, 0.0, 2.0))}


def _worlds() -> Iterator[tuple[str, Store, dict[str, tuple[Triple, Triple]]]]:
    for name, cameras in CAMERAS.items():
        if (WORLDS / name / "world.json").exists():
            yield name, open_store(str(WORLDS / name)), cameras


@contextmanager
def _visit(browser: Browser, url: str, eye: Triple, target: Triple, samples: int, patches: bool) -> Iterator[Visit]:
    """The page with a complete picture."""
    with visiting(browser, url, SIZE, FOLDER / "record.js") as page:
        page.options(supersampling=samples, nearRadius=0, frameMs=0, fade=0, patches=patches)
        page.look(eye, target, FOV)
        yield page


def _measured(page: Visit, rounds: int) -> dict[str, Any] | None:
    """Figures of one picture; None without WebGPU. Raises RuntimeError when anything was said on the console."""
    shaders = {name: (FOLDER / f"{name}.wgsl").read_text() for name in ("splats", "resolve")}
    facts: dict[str, Any] | None = page.do(BEGIN % (FOLDER / "splatting.js").read_text(), shaders)
    if facts is None:
        return None
    facts["psnr"] = {variant: round(page.do(COMPARE, variant), 1) for variant in VARIANTS}
    times: dict[str, list[float]] = {way: [] for way in WAYS}
    worked = dict.fromkeys(WAYS, 0.0)
    for _ in range(rounds):
        for way, script in WAYS.items():
            before = processor_ms()
            times[way] += page.do(REPEAT % script, FRAMES)
            worked[way] += processor_ms() - before
    # Waiting for a pixel is what is meant here, whatever the driver says of it.
    if said := [text for text in page.errors if "GPU stall" not in text]:
        raise RuntimeError(f"on the console: {said[:3]}")
    own = times["webgl2"]
    return facts | {
        "frame_ms": {way: round(median(times[way]), 1) for way in WAYS},
        "processor_ms": {way: round(worked[way] / (rounds * FRAMES), 1) for way in WAYS},
        "times_as_fast": {way: round(median(own) / median(times[way]), 2) for way in WAYS},
        "times_as_little_work": {way: round(worked["webgl2"] / max(worked[way], 1.0), 2) for way in WAYS},
    }


def _add_patches(page: Visit, rounds: int, figures: dict[str, Any]) -> None:
    """Adds what the page takes with patches."""
    page.do(BEGIN % (FOLDER / "splatting.js").read_text(), None)
    before = processor_ms()
    times = page.do(REPEAT % WAYS["webgl2"], rounds * FRAMES)
    worked = processor_ms() - before
    name, own = "webgl2, patches", figures["frame_ms"]["webgl2"]
    figures["frame_ms"][name] = round(median(times), 1)
    figures["processor_ms"][name] = round(worked / len(times), 1)
    figures["times_as_fast"][name] = round(own / median(times), 2)
    figures["times_as_little_work"][name] = round(figures["processor_ms"]["webgl2"] * len(times) / max(worked, 1.0), 2)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    print(json.dumps(run(rounds=parser.parse_args().rounds), indent=2))


if __name__ == "__main__":
    main()
