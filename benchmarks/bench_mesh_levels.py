"""Mesh levels of detail beside farfield: gltfpack in 3D Tiles, shown by 3d-tiles-renderer, in the same browser.

    cd benchmarks/mesh_levels && npm ci && cd ../..
    farfield bench mesh_levels [--quick] [--json]
    python benchmarks/bench_mesh_levels.py [--work DIR] [--cases tokyo,…] [--levels r,4r,16r] [--pictures DIR] [-o JSON]

The three scenes of benchmarks/scenes.py, and Tokyo with façades of which no two are alike; trees and statues as
instances and as copies. Both viewers have the same camera, 640 x 480, 2 x 2 samples, light and sky, and leave out
what is nearer than r, 4 r or 16 r. The link is cut after 0.5, 2, 8 and 32 MB of a world's or a tileset's bytes as they are sent
(viewers' code apart): what has arrived is drawn and compared with the true picture; then time of a frame, until its
pixels can be read. Worlds, tilesets and true pictures are kept in the work folder.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page

from bench_quality import DATA, LEAF_SIZE, WORK, Case, baked, small_case, truth
from farfield.bake.options import BakeOptions
from farfield.quality.metrics import compare
from farfield.scene.read import read_scene
from farfield.view.path import read_path
from mesh_levels.gate import Gate, served
from mesh_levels.packages import missing
from mesh_levels.site import counted, site
from mesh_levels.tileset import write_tileset
from mesh_levels.unique import make_unique
from scenes import make

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser

FOLDER = Path(__file__).parent
LIMITS = (500_000, 2_000_000, 8_000_000, 32_000_000)
"""Bytes after which the link is cut."""
LEVELS = {"r": (0, ""), "4r": (2, "_far"), "16r": (4, "_farther")}
"""Cameras -> levels up, and end of the name of their file."""
CAMERAS = (0, 4, 8)
"""Of the twelve."""
SAMPLES = 2
ERROR_TARGET = 0.5
"""Pixels. Of 0.5, 1, 2, 4 and 16 tried, see docs/performance.md."""
FRAMES = 5
LONG_MS = 1500.0
"""Frames are timed again until they have taken this long together."""
SETTLED = 8
"""Turns of the page without a change after which it has drawn all it has."""
PATIENCE = 240.0
"""Seconds."""
SKY = (158, 191, 235)


@dataclass(frozen=True, slots=True)
class Show:
    """One thing shown by one viewer."""

    scene: str
    """Of the world and the true pictures."""
    kind: str
    """world or tiles."""
    instanced: bool = False

    @property
    def name(self) -> str:
        """In the figures."""
        return "farfield" if self.kind == "world" else "tiles, instanced" if self.instanced else "tiles"


SHOWS = {
    "tokyo": (Show("tokyo", "world"), Show("tokyo", "tiles")),
    "tokyo-unique": (Show("tokyo-unique", "world"), Show("tokyo-unique", "tiles")),
    "forest": (Show("forest", "world"), Show("forest", "tiles"), Show("forest", "tiles", True)),
    "statues": (Show("statues", "world"), Show("statues", "tiles"), Show("statues", "tiles", True)),
}


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of all scenes; why there are none, where the packages are missing."""
    if reason := missing():
        return {"skipped": reason}
    if quick:
        return _small()
    return {name: figures(name, list(LEVELS), WORK, DATA, None) for name in SHOWS}


def figures(name: str, levels: Sequence[str], work: Path, data: Path, pictures: Path | None) -> dict[str, Any]:
    """level -> viewer -> limit -> means over the cameras."""
    found: dict[str, Any] = {}
    with opened_browser() as browser:
        for level in levels:
            case = case_of(name, level, work, data)
            found[level] = {}
            for show in SHOWS[name]:
                folder = None if pictures is None else pictures / f"{name}-{level}-{show.name}"
                shown = work / name if show.kind == "world" else tileset(case, show, work)
                found[level][show.name] = measure(browser, shown, case, show, LIMITS, folder)
                print(name, level, show.name, found[level][show.name], file=sys.stderr, flush=True)
    return found


def case_of(name: str, level: str, work: Path, data: Path) -> Case:
    """A scene's world, cameras and true pictures, made where they are missing."""
    base = name.partition("-")[0]
    scene = make(base, data, work / "scenes")
    if name != base:
        scene = make_unique(scene, work / "scenes" / name, LEAF_SIZE[base])
    world = baked(scene, work / name, BakeOptions(leaf_size=LEAF_SIZE[base], workers=1))
    up, end = LEVELS[level]
    path = read_path(FOLDER / "cameras" / f"{base}{end}.json")
    truths = work / f"{name}-truth-{ {'r': 'leaf', '4r': 'far', '16r': 'farther'}[level] }"
    return Case(scene, world, tuple(frame.camera for frame in path.frames), up, truths)


def tileset(case: Case, show: Show, work: Path) -> Path:
    """Folder of a tileset, made if it is missing."""
    folder = work / f"{show.scene}-{show.name.replace(', ', '-')}"
    if not (folder / "tileset.json").exists():
        write_tileset(folder, read_scene([case.scene]), case.world.grid, show.instanced)
    return folder


def measure(
    browser: Browser, shown: Path, case: Case, show: Show, limits: Sequence[int], pictures: Path | None = None
) -> dict[str, Any]:
    """limit in bytes -> figures, means over the cameras; milliseconds are medians."""
    rows: dict[int, list[dict[str, float]]] = {limit: [] for limit in limits}
    for number in CAMERAS if len(case.cameras) > max(CAMERAS) else range(len(case.cameras)):
        reference = truth(case, number)
        camera = case.cameras[number]
        view = {"kind": show.kind, "eye": camera.eye, "target": camera.target, "fov": camera.fov, "samples": SAMPLES}
        view |= {"near": case.near_radius(camera), "leaf": case.world.grid.leaf_size, "corner": case.world.grid.corner}
        view |= {"depth": 0.05 * case.world.grid.leaf_size, "errorTarget": ERROR_TARGET}
        with visit(browser, shown, view, case.size) as (page, gate):
            for limit in limits:
                gate.limit = limit
                settle(page, gate)
                milliseconds = draw_ms(page)
                pixels = _picture(page)
                found = compare(reference, pixels)
                state = page.evaluate("show.state()")
                rows[limit].append(
                    {"psnr_covered": found["psnr_covered"], "flip_covered": found["flip_covered"], "bytes": gate.sent}
                    | {"frame_ms": milliseconds, "primitives": state.get("splats", state.get("triangles", 0))}
                    | {"complete": float(gate.waiting == 0)}
                )
                if pictures is not None:
                    pictures.mkdir(parents=True, exist_ok=True)
                    Image.fromarray(pixels).save(pictures / f"{number:02d}-{limit}.png")
    return {str(limit): _means(found) for limit, found in rows.items()}


def _means(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: round(fmean(row[name] for row in rows), 4) for name in rows[0]}


@contextmanager
def visit(browser: Browser, shown: Path, view: dict[str, Any], size: tuple[int, int]) -> Iterator[tuple[Page, Gate]]:
    """The page of mesh_levels with an empty cache, before a camera; nothing has been let through yet.

    view: as in mesh_levels/show.js. Raises RuntimeError when anything was said on its console.
    """
    gate = Gate(site(shown), counted)
    with served(gate) as url:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]})
        page = context.new_page()
        said: list[str] = []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
        page.set_default_timeout(PATIENCE * 1000)
        page.goto(f"{url}page/show.html?{size[0]}x{size[1]}")
        page.wait_for_function("window.show !== undefined")
        page.evaluate("view => show.open(view)", view)
        yield page, gate
        # What is said while the page is closed is of answers that are held back.
        heard = list(said)
        context.close()
    if heard:
        raise RuntimeError(f"on the page: {heard[:3]}")


def shown_by(kind: str) -> str:
    """What figures call a kind of show.js."""
    return "farfield" if kind == "world" else kind


def settle(page: Page, gate: Gate) -> None:
    """Waits until everything is there, or what is let through has been drawn and the rest is held back."""
    begun, seen, since = time.monotonic(), None, 0
    while time.monotonic() < begun + PATIENCE:
        state: dict[str, Any] = page.evaluate("show.state()")
        now = state["seen"], gate.sent
        if now != seen:
            seen, since = now, state["turns"]
        held = gate.waiting > 0 and gate.sent >= gate.limit
        if (held or state["pending"] == 0) and state["turns"] >= since + SETTLED:
            break
        time.sleep(0.1)
    else:
        raise RuntimeError(f"still not settled after {PATIENCE} s: {state}")


def draw_ms(page: Page) -> float:
    """Of a frame; the median of some when they are short. The first frame uploads what is new and does not count."""
    page.evaluate("show.draw()")
    found = [page.evaluate("show.draw()")]
    while len(found) < FRAMES and sum(found) < LONG_MS:
        found.append(page.evaluate("show.draw()"))
    return median(found)


def _picture(page: Page) -> NDArray[np.uint8]:
    """(h, w, 4) uint8: what is shown; transparent where it is the sky exactly."""
    address: str = page.evaluate("show.picture()")
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        pixels = np.array(image.convert("RGBA"))
    pixels[..., 3] = 255 * (np.abs(pixels[..., :3].astype(int) - SKY).max(-1) > 1)
    return pixels


def _small() -> dict[str, Any]:
    """Statues and a tree of the demo, copied and as instances."""
    work = Path(tempfile.mkdtemp(prefix="farfield-mesh-levels-"))
    case = small_case(work)
    shows = Show("small", "world"), Show("small", "tiles")
    found = {}
    with opened_browser() as browser:
        for show in shows:
            shown = work / "world" if show.kind == "world" else tileset(case, show, work)
            found[show.name] = measure(browser, shown, case, show, (100_000, 8_000_000))
    return {"small": found}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--cases", default=",".join(SHOWS))
    parser.add_argument("--levels", default=",".join(LEVELS))
    parser.add_argument("--pictures", type=Path, help="where to leave what was drawn")
    parser.add_argument("-o", "--output", type=Path, help="JSON file to which each case is added when it is done")
    given = parser.parse_args()
    if reason := missing():
        raise SystemExit(reason)
    found = json.loads(given.output.read_text()) if given.output and given.output.exists() else {}
    for name in given.cases.split(","):
        for level in given.levels.split(","):
            found.setdefault(name, {}).update(figures(name, [level], given.work, given.data, given.pictures))
            if given.output:
                given.output.write_text(json.dumps(found, indent=2) + "\n")
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
