"""Mesh levels of detail beside farfield: gltfpack in 3D Tiles, shown by 3d-tiles-renderer, in the same browser.

    cd benchmarks/mesh_levels && npm ci && cd ../..
    farfield bench mesh_levels [--quick] [--json]
    python benchmarks/bench_mesh_levels.py [--work DIR] [--cases tokyo,…] [--levels r,4r,16r] [--rows FILE]

The three scenes of benchmarks/scenes.py, and Tokyo with façades of which no two are alike; trees and statues as
instances and as copies. Farfield by free choice of pictures and geometry, and by pictures alone; Tokyo also from a
world of BlockMaps in place of orthoviews, and from one of both.
Both viewers have the same camera, 640 x 480, 2 x 2 samples, light and sky, and leave out what is nearer than r, 4 r or
16 r. The link, 20 Mbit/s with a round trip of 40 ms, is cut after 0.5, 2, 8 and 32 MB of a world's or a tileset's bytes
as they are sent (viewers' code apart): what has arrived is drawn and compared with the true picture; then time of a
frame, until its pixels can be read. Worlds, tilesets and true pictures are kept in the work folder.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
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
from farfield.serve.throttle import Link, Throttle
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
LINK = Link(20e6 / 8, 0.04)
"""Order matters where bytes take time: over a link without limits both viewers ask for everything at once."""
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
PATIENCE = 600.0
"""Seconds."""
SKY = (158, 191, 235)
REPRESENT: dict[str, dict[str, Any]] = {
    "": {},
    "BlockMaps": {"orthoviews": False, "blockmap": "64:256", "resolution": 64},
    "all kinds": {"blockmap": "64:256"},
}
"""What worlds are called -> options of their bakes."""
KEYS = ("scene", "level", "viewer", "camera", "limit")


@dataclass(frozen=True, slots=True)
class Show:
    """One thing shown by one viewer."""

    scene: str
    """Of the world and the true pictures."""
    kind: str
    """world or tiles."""
    instanced: bool = False
    pictures: bool = False
    """A world by pictures alone; else by whichever kind shows more for its bytes."""
    represent: str = ""
    """Of REPRESENT."""

    @property
    def name(self) -> str:
        """In the figures."""
        if self.kind == "world":
            parts = "farfield", self.represent, "pictures" if self.pictures else ""
            return ", ".join(part for part in parts if part)
        return "tiles, instanced" if self.instanced else "tiles"


SHOWS = {
    name: (Show(name, "world"), Show(name, "world", pictures=True), Show(name, "tiles"))
    + ((Show(name, "tiles", True),) if name in ("forest", "statues") else ())
    for name in ("tokyo", "tokyo-unique", "forest", "statues")
}
SHOWS["tokyo"] += (
    Show("tokyo", "world", represent="BlockMaps"),
    Show("tokyo", "world", pictures=True, represent="BlockMaps"),
    Show("tokyo", "world", represent="all kinds"),
)


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of all scenes; why there are none, where the packages are missing."""
    if reason := missing():
        return {"skipped": reason}
    if quick:
        return _small()
    return figures(WORK, DATA)


def figures(
    work: Path,
    data: Path,
    rows: Path | None = None,
    pictures: Path | None = None,
    names: Sequence[str] = tuple(SHOWS),
    levels: Sequence[str] = tuple(LEVELS),
    cameras: Sequence[int] = CAMERAS,
    viewers: Sequence[str] = (),
) -> dict[str, Any]:
    """scene -> level -> viewer -> limit -> means over the cameras.

    rows: a file of JSON lines, one for each camera and limit; those that it has are not measured again.
    """
    found = [json.loads(line) for line in rows.read_text().splitlines()] if rows and rows.exists() else []
    done = {_key(row) for row in found}
    for number, name, level in product(cameras, names, levels):
        case = case_of(name, level, work, data)
        for show in SHOWS[name]:
            key = {"scene": name, "level": level, "viewer": show.name, "camera": number}
            if _key(key) in done or (viewers and show.name not in viewers):
                continue
            shown = world_of(case, show, work) if show.kind == "world" else tileset(case, show, work)
            folder = None if pictures is None else pictures / f"{name}-{level}-{show.name}"
            with opened_browser() as browser:
                measured = one_camera(browser, shown, case, show, number, LIMITS, folder)
            lines = [key | {"limit": limit} | row for limit, row in measured.items()]
            found += lines
            for line in lines:
                print(line, file=sys.stderr, flush=True)
                if rows:
                    with rows.open("a") as file:
                        file.write(json.dumps(line) + "\n")
    return summary(found)


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """scene -> level -> viewer -> limit -> means."""
    together: dict[tuple[str, ...], list[dict[str, float]]] = {}
    for row in rows:
        key = row["scene"], row["level"], row["viewer"], str(row["limit"])
        together.setdefault(key, []).append({name: row[name] for name in row if name not in KEYS})
    found: dict[str, Any] = {}
    for (scene, level, viewer, limit), own in together.items():
        found.setdefault(scene, {}).setdefault(level, {}).setdefault(viewer, {})[limit] = means(own)
    return found


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["scene"], row["level"], row["viewer"], row["camera"]


def case_of(name: str, level: str, work: Path, data: Path) -> Case:
    """A scene's world, cameras and true pictures, made where they are missing."""
    base = name.partition("-")[0]
    scene = make(base, data, work / "scenes")
    if name != base:
        scene = make_unique(scene, work / "scenes" / name, LEAF_SIZE[base])
    world = baked(scene, work / name, _options(name))
    up, end = LEVELS[level]
    path = read_path(FOLDER / "cameras" / f"{base}{end}.json")
    truths = work / f"{name}-truth-{ {'r': 'leaf', '4r': 'far', '16r': 'farther'}[level] }"
    return Case(scene, world, tuple(frame.camera for frame in path.frames), up, truths)


def world_of(case: Case, show: Show, work: Path) -> Path:
    """Folder of a world, baked if it is missing."""
    folder = work / "-".join(part for part in (show.scene, show.represent.replace(" ", "-")) if part)
    baked(case.scene, folder, replace(_options(show.scene), **REPRESENT[show.represent]))
    return folder


def _options(scene: str) -> BakeOptions:
    return BakeOptions(leaf_size=LEAF_SIZE[scene.partition("-")[0]], workers=1)


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
        for limit, row in one_camera(browser, shown, case, show, number, limits, pictures).items():
            rows[limit].append(row)
    return {str(limit): means(found) for limit, found in rows.items()}


def one_camera(
    browser: Browser,
    shown: Path,
    case: Case,
    show: Show,
    number: int,
    limits: Sequence[int],
    pictures: Path | None = None,
) -> dict[int, dict[str, float]]:
    """limit in bytes -> figures of a camera."""
    rows = {}
    reference, camera = truth(case, number), case.cameras[number]
    view = {"kind": show.kind, "eye": camera.eye, "target": camera.target, "fov": camera.fov, "samples": SAMPLES}
    view |= {"near": case.near_radius(camera), "leaf": case.world.grid.leaf_size, "corner": case.world.grid.corner}
    view |= {"depth": 0.05 * case.world.grid.leaf_size, "errorTarget": ERROR_TARGET, "farGeometry": not show.pictures}
    with visit(browser, shown, view, case.size) as (page, gate):
        for limit in limits:
            gate.limit = limit
            settle(page, gate)
            drawn = draw_ms(page)
            pixels = _picture(page)
            found, state = compare(reference, pixels), page.evaluate("show.state()")
            rows[limit] = {name: found[name] for name in ("psnr_covered", "flip_covered")} | drawn
            rows[limit] |= {"bytes": gate.sent, "complete": float(gate.waiting == 0)}
            rows[limit] |= {"primitives": state.get("splats", 0) + state.get("triangles", 0)}
            if pictures is not None:
                pictures.mkdir(parents=True, exist_ok=True)
                Image.fromarray(pixels).save(pictures / f"{number:02d}-{limit}.png")
    return rows


def means(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: round(fmean(row[name] for row in rows), 4) for name in rows[0]}


@contextmanager
def visit(browser: Browser, shown: Path, view: dict[str, Any], size: tuple[int, int]) -> Iterator[tuple[Page, Gate]]:
    """The page of mesh_levels with an empty cache, before a camera; nothing has been let through yet.

    view: as in mesh_levels/show.js. Raises RuntimeError when anything was said on its console.
    """
    gate = Gate(Throttle(site(shown), LINK), counted)
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


def draw_ms(page: Page) -> dict[str, float]:
    """frame_ms, until the pixels of a frame can be read, and processor_ms, what the process that draws works for it.

    The second says what a frame costs beside other busy processes too. The median of some frames when they are short;
    the first uploads what is new and does not count.
    """
    page.evaluate("show.draw()")
    found: list[tuple[float, float]] = []
    while len(found) < FRAMES and sum(wall for wall, _ in found) < LONG_MS:
        before = processor_ms()
        wall = page.evaluate("show.draw()")
        found.append((wall, processor_ms() - before))
    wall, worked = (round(median(values), 1) for values in zip(*found, strict=True))
    return {"frame_ms": wall, "processor_ms": worked}


def processor_ms() -> float:
    """Milliseconds that the drawing processes of this process's browsers have worked so far; 0 where nothing tells."""
    parents: dict[int, int] = {}
    worked: dict[int, float] = {}
    tick = 1000 / os.sysconf("SC_CLK_TCK")
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(fields[1])
            if b"--type=gpu-process" in (folder / "cmdline").read_bytes():
                worked[int(folder.name)] = tick * (int(fields[11]) + int(fields[12]))
        except OSError:
            continue

    def ours(process: int) -> bool:
        while process > 1 and process != os.getpid():
            process = parents.get(process, 0)
        return process == os.getpid()

    return sum(milliseconds for process, milliseconds in worked.items() if ours(process))


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
    shows = Show("small", "world"), Show("small", "world", pictures=True), Show("small", "tiles")
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
    parser.add_argument("--cameras", default=",".join(map(str, CAMERAS)), help="numbers of the twelve")
    parser.add_argument("--viewers", default="", help="names of those to measure, with / between them; all")
    parser.add_argument("--rows", type=Path, help="file of JSON lines to go on with")
    given = parser.parse_args()
    if reason := missing():
        raise SystemExit(reason)
    lists = given.cases.split(","), given.levels.split(","), [int(number) for number in given.cameras.split(",")]
    viewers = given.viewers.split("/") if given.viewers else ()
    print(json.dumps(figures(given.work, given.data, given.rows, given.pictures, *lists, viewers), indent=2))


if __name__ == "__main__":
    main()
