"""The thesis' walks over slow links: quality by second, against other orders of sending on the same link (BEN-8).

    farfield bench walks [--quick] [--json]
    python benchmarks/bench_walks.py [garden|terrain ...] [--bandwidth B ...] [--order NAME ...] [--frames S]
                                     [--seconds S] [--pictures DIR] [--data DIR] [--work DIR]

The garden of 257 statues (40 s) and the terrain with 472 objects (its first 30 s), made of real statues, at 2,000,
20,000 and 100,000 B/s, in real time. Orders: `session`, the server's own; `nearest` and `largest`, full meshes object
by object, the nearest or the largest on the screen first; `nearest-levels`, coarse forms of all in view before finer
ones; `objects`, what adds most to the measure for its bytes, by who knows the objects: how good the same values would
be in another order; `impostors`, images made on demand, simulated (walk_bound.py). Told are the thesis' quality
(docs/walks.md), PSNR and FLIP of frames to the true ones, what the bytes were good for, and bytes of coarser
forms that finer ones took the place of (`superseded`: what progressive meshes could save at most). Quick: the town of
the tests. Full: 30 minutes, and 30 more to make and bake the scenes the first time.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from bench_quality import DATA
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.progress import NoProgress
from farfield.serve.run import ServeOptions, serving
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.view.path import CameraPath, PathFrame, read_path
from farfield.walk.frames import Frame, FrameDrawer
from farfield.walk.link import SlowLink
from farfield.walk.observer import Poses
from farfield.walk.plot import plot_quality
from farfield.walk.session import Walker, stream_walk
from farfield.walk.walk import WalkedWorld, WalkOptions, WalkResult, drawn, judge
from walk_bound import impostor_bound
from walk_orders import BenefitOfObjects, ObjectByObject, Order, fetched_walk
from walk_scenes import SCENES, made_world
from walk_uses import of_use, superseded

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.world import town

WORK = Path(__file__).parents[1] / "worlds/walks"
BANDWIDTHS = (2_000.0, 20_000.0, 100_000.0)
"""Bytes a second."""
ORDERS = ("session", "nearest", "nearest-levels", "largest", "objects")
GOALS = {
    "garden": {2_000.0: 0.55, 20_000.0: 0.93, 100_000.0: 0.993},
    "terrain": {2_000.0: 0.35, 20_000.0: 0.82, 100_000.0: 0.98},
}
SIZE = (640, 480)
FRAME_SECONDS = 10
SHOWN_AT = (10.0, 20.0, 30.0)
"""Seconds that the contact sheet shows."""
SHEET_WIDTH = 240
"""Pixels of a frame on it."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A world, and a path through it."""

    place: str
    walked: WalkedWorld
    walker: Walker
    drawer: FrameDrawer
    """As viewers with the walker's near radius see it."""
    meshes: FrameDrawer
    """As viewers that get full meshes see it."""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures by scene, bandwidth and order."""
    if not quick:
        if not (DATA / "threedscans_statues").exists():
            return {"skipped": f"needs threedscans_statues of the large inputs below {DATA}"}
        return {name: scene(name, DATA, WORK) for name in SCENES}
    with tempfile.TemporaryDirectory(prefix="farfield-walks-") as folder:
        store = DirectoryStore(Path(folder) / "world")
        bake(town(), store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
        frames = [PathFrame(n / 10, (-26 + n / 10, -28, 2), (0, 0, 2), 50.0) for n in range(40)]
        stage = staged(store.location, CameraPath(10.0, tuple(frames)), 0.0, (160, 120))
        orders = ("session", "nearest-levels", "objects")
        return {"town": {order: walked(stage, 40_000.0, order, 3)[0] for order in orders}}


def scene(
    name: str,
    data: Path,
    work: Path,
    bandwidths: Sequence[float] = BANDWIDTHS,
    orders: Sequence[str] = ORDERS,
    frame_seconds: int = FRAME_SECONDS,
    pictures: Path | None = None,
    seconds: float | None = None,
) -> dict[str, Any]:
    """Bandwidth and order → figures. pictures: folder for curves and frames. seconds: of the path, 0: all."""
    world = made_world(name, data, work)
    path = read_path(work / f"{name}-scene/path.json")
    stage = staged(str(world), path, SCENES[name].seconds if seconds is None else seconds, SIZE)
    found: dict[str, Any] = {}
    for bandwidth in bandwidths:
        rows, curves, frames = {}, {}, {}
        for order in orders:
            rows[order], result = walked(stage, bandwidth, order, frame_seconds)
            curves[order], frames[order] = result.quality, result.frames
            print(name, bandwidth, order, json.dumps(rows[order]), file=sys.stderr, flush=True)
        bound = impostor_bound(stage.walked, stage.walker, bandwidth)
        curves["images on demand (simulated)"] = bound["quality"]
        found[f"{bandwidth:.0f}"] = {"goal": GOALS[name].get(bandwidth)} | rows | {"impostors": bound}
        if pictures:
            pictures.mkdir(parents=True, exist_ok=True)
            plot_quality(pictures / f"walks-{name}-{bandwidth:.0f}.webp", curves, f"{name}, {bandwidth:,.0f} B/s")
            sheet(frames).save(pictures / f"walks-{name}-{bandwidth:.0f}-frames.webp", quality=70, method=6)
    return found


def staged(place: str, path: CameraPath, seconds: float, size: tuple[int, int]) -> Stage:
    """Reads a world. seconds: of the path; 0: all."""
    known = WalkedWorld.of(open_store(place))
    walker = Walker(Poses(path), size, None, seconds)
    meshes = FrameDrawer(known.world, size, math.inf)
    return Stage(place, known, walker, FrameDrawer(known.world, size, None, meshes), meshes)


def walked(stage: Stage, bandwidth: float, order: str, frame_seconds: int) -> tuple[dict[str, Any], WalkResult]:
    """Goes the walk once; frame_seconds: from one frame to the next, 0: none."""
    whole = order in ("nearest", "nearest-levels", "largest")
    near_radius = math.inf if whole else stage.walker.near_radius
    walker = Walker(stage.walker.poses, stage.walker.size, near_radius, stage.walker.seconds)
    options = WalkOptions(bandwidth, 0.0, walker.size, near_radius, walker.seconds)
    with serving(open_store(stage.place), ServeOptions(port=0)) as url:
        if order == "session":
            received = stream_walk(url, walker, SlowLink(bandwidth))
        else:
            received = fetched_walk(url, walker, SlowLink(bandwidth), _order(order, stage.walked, options))
    found = judge(stage.walked, walker, options, received)
    facts: dict[str, Any] = {
        "mean_quality": round(found.mean_quality, 4),
        "quality": [round(value, 3) for value in found.quality],
        "missing_after": found.missing_after,
        "bytes": found.bytes,
        "of_use": of_use(stage.walked, walker, options, received),
        "superseded": superseded(stage.walked, received),
    }
    if frame_seconds:
        drawer = stage.meshes if whole else stage.drawer
        found.frames.extend(drawn(drawer, walker, received, frame_seconds, NoProgress()))
        facts |= {"psnr": round(found.mean_psnr, 2), "flip": round(found.mean_flip, 4)}
    return facts, found


def _order(name: str, known: WalkedWorld, options: WalkOptions) -> Order:
    if name == "objects":
        return BenefitOfObjects(known, options.size, options.near_radius)
    return ObjectByObject(known, known.measure(options), name == "largest", name == "nearest-levels")


def sheet(frames: dict[str, list[Frame]]) -> Image.Image:
    """A row for each of some seconds: the true frame, then that of each order."""
    rows = []
    for second in SHOWN_AT:
        shown = [frame for own in frames.values() for frame in own if frame.second == second]
        if shown:
            rows.append([shown[0].true, *(frame.shown for frame in shown)])
    if not rows:
        return Image.new("RGB", (SHEET_WIDTH, 1))
    height = SHEET_WIDTH * rows[0][0].shape[0] // rows[0][0].shape[1]
    found = Image.new("RGB", (SHEET_WIDTH * max(map(len, rows)), height * len(rows)))
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            small = Image.fromarray(picture).resize((SHEET_WIDTH, height), Image.Resampling.BOX)
            found.paste(small, (x * SHEET_WIDTH, y * height))
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--bandwidth", type=float, nargs="+", default=BANDWIDTHS)
    parser.add_argument("--order", nargs="+", default=ORDERS)
    parser.add_argument("--frames", type=int, default=FRAME_SECONDS)
    parser.add_argument("--seconds", type=float, help="of the paths; 0: all of them")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--pictures", type=Path)
    given = parser.parse_args()
    found = {
        name: scene(
            name, given.data, given.work, given.bandwidth, given.order, given.frames, given.pictures, given.seconds
        )
        for name in given.scenes
    }
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
