"""Images of instances made on demand: how many a second, and what they are worth to who looks down (BEN 4.1).

    farfield bench impostors [--quick] [--json]
    python benchmarks/bench_impostors.py [--worlds DIR ...] [--walks DIR] [--bandwidth B ...]

Rate: for each world images of all its meshes with impostors, up to MESHES of them, in each of their sizes from 15 eyes
above, by processor time: decoding of a mesh apart, drawing and encoding alone. Worth: the garden of the walks, flown
round by half a turn at 25 m, looking down, 20 s in real time, in a session that may have them made and in one that may
not: the thesis' quality, PSNR and FLIP of frames. Quick: a tree on a plain.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from bench_quality import WORK as WORLDS
from bench_walks import SIZE, WORK, staged
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.progress import NoProgress
from farfield.represent.geometry.board import TURNS
from farfield.scene.procedural.trees import SHAPES, tree
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.stream.tree import CellTree
from farfield.view.impostors import ImpostorMaker
from farfield.view.path import CameraPath, PathFrame
from farfield.walk.link import SlowLink
from farfield.walk.session import Walker, stream_walk
from farfield.walk.walk import WalkOptions, drawn, judge
from farfield.world.keys import DynamicImpostor
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from bake.scenes import ground, scene_of

MESHES = 8
EYES = [(turn, tilt) for tilt in (5, 6, 7) for turn in range(0, TURNS, 3)][:15]
HEIGHT, RADIUS, SECONDS, FPS = 25.0, 30.0, 20.0, 10.0
"""Metres above the ground, and of the circle; of the flight; frames a second of its path."""
BANDWIDTHS = (2_000.0, 20_000.0)
"""Bytes a second."""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures."""
    if quick:
        with tempfile.TemporaryDirectory(prefix="farfield-impostors-") as folder:
            store = DirectoryStore(Path(folder) / "world")
            scene = scene_of((ground(0.0, 64.0), [(0.0, 0.0, 0.0)]), (tree(SHAPES[2], 6_000, 2), [(30.0, 30.0, 0.0)]))
            bake(scene, store, BakeOptions(leaf_size=32.0, resolution=64, directions="5", workers=1))
            path = circle((32.0, 32.0, 0.0), 4.0)
            return {"rate": {"tree": rate(store)}, "worth": {"tree": flown(store.location, path, 20_000.0, (160, 120))}}
    worlds = [path for path in (WORLDS / "statues", WORK / "terrain") if (path / "world.json").exists()]
    return figures(worlds, WORK / "garden", BANDWIDTHS)


def figures(worlds: Sequence[Path], garden: Path, bandwidths: Sequence[float]) -> dict[str, Any]:
    """What of it can be measured."""
    found: dict[str, Any] = {"rate": {path.name: rate(open_store(str(path))) for path in worlds}, "worth": {}}
    if (garden / "world.json").exists():
        bounds = np.array(World.open(open_store(str(garden))).manifest.bounds)
        path = circle((*bounds.mean(axis=0)[:2].tolist(), float(bounds[0, 2])), SECONDS)
        for bandwidth in bandwidths:
            found["worth"][f"{garden.name}, {bandwidth:.0f} B/s"] = flown(str(garden), path, bandwidth, SIZE)
    return found


def rate(store: Store) -> dict[str, Any]:
    """Images a second of a core, by rows; bytes of one; milliseconds that reading a mesh takes."""
    instances = CellTree.of(World.open(store)).instances
    maker = ImpostorMaker(store, instances)
    own = [mesh for mesh in range(len(instances.forms)) if instances.impostors[mesh]][:MESHES]
    seconds: dict[int, list[float]] = {}
    sizes: dict[int, list[int]] = {}
    both, read = [], []
    for mesh in own:
        name = instances.forms[mesh].values[0].cell
        for turn in (0, 8):
            begun = time.process_time()
            maker.image(DynamicImpostor(name, 1, turn, 6))
            both.append(time.process_time() - begun)
        # The first is read and drawn.
        read.append(both[-2] - both[-1])
        for impostor in instances.impostors[mesh]:
            for turn, tilt in EYES:
                begun = time.process_time()
                image = maker.image(DynamicImpostor(name, impostor.rows, turn, tilt))
                seconds.setdefault(impostor.rows, []).append(time.process_time() - begun)
                sizes.setdefault(impostor.rows, []).append(len(image))
    triangles = [int(instances.counts[mesh, 0]) for mesh in own]
    return {
        "meshes": len(own),
        "triangles": [min(triangles, default=0), max(triangles, default=0)],
        "reading_ms": round(1000 * fmean(read), 1) if read else None,
        "images_a_second": {rows: round(1 / fmean(own), 1) for rows, own in seconds.items()},
        "slowest_a_second": {rows: round(1 / max(own), 1) for rows, own in seconds.items()},
        "bytes": {rows: round(fmean(own)) for rows, own in sizes.items()},
    }


def circle(middle: tuple[float, float, float], seconds: float) -> CameraPath:
    """Half a turn round about, looking at the middle."""
    x, y, z = middle
    frames = []
    for n in range(round(seconds * FPS)):
        turn = math.pi * n / FPS / seconds
        eye = (x + RADIUS * math.cos(turn), y + RADIUS * math.sin(turn), z + HEIGHT)
        frames.append(PathFrame(n / FPS, eye, middle, 50.0))
    return CameraPath(FPS, tuple(frames))


def flown(place: str, path: CameraPath, bandwidth: float, size: tuple[int, int]) -> dict[str, Any]:
    """Figures with images made on demand, and without."""
    stage = staged(place, path, 0.0, size)
    found = {}
    for name, dynamic in (("dynamic", True), ("baked alone", False)):
        walker = Walker(stage.walker.poses, size, None, 0.0, dynamic)
        with serving(open_store(place), ServeOptions(port=0)) as url:
            received = stream_walk(url, walker, SlowLink(bandwidth))
        judged = judge(stage.walked, walker, WalkOptions(bandwidth, 0.0, size), received)
        judged.frames.extend(drawn(stage.drawer, walker, received, 4, NoProgress()))
        made = [key for _, key, _ in received.arrivals if DynamicImpostor.of(key)]
        found[name] = {
            "mean_quality": round(judged.mean_quality, 4),
            "quality": [round(value, 3) for value in judged.quality],
            "psnr": round(judged.mean_psnr, 2),
            "flip": round(judged.mean_flip, 4),
            "bytes": judged.bytes,
            "images": len(made),
        }
        print(name, bandwidth, json.dumps(found[name]), file=sys.stderr, flush=True)
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=Path, nargs="*", default=[WORLDS / "statues", WORK / "terrain"])
    parser.add_argument("--walks", type=Path, default=WORK)
    parser.add_argument("--bandwidth", type=float, nargs="+", default=BANDWIDTHS)
    given = parser.parse_args()
    print(json.dumps(figures(given.worlds, given.walks / "garden", given.bandwidth), indent=1))


if __name__ == "__main__":
    main()
