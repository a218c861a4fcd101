"""The same view as full geometry and as farfield draws it, for growing worlds: frame time, picture, and what grows.

    farfield bench growth [--quick] [--json]                  1 M and 10 M triangles in view
    python benchmarks/bench_growth.py --full [--work DIR] [-o JSON] [--plot FILE]    to 1 G: hours of one core

Worlds of statues of 97,000 triangles floating in a cube (benchmarks/objects.py), all of it in view, 9 directions, one
layer, pixels of 10 cm. Reference renderer: the geometry, frustum-culled by blocks of 512 triangles, and the world from
decoded tiles, both with 4 x 4 samples a pixel; PSNR of the one against the other. Browser: every object a mesh of
three.js that is culled by itself, objects of a kind sharing their buffers, beside the world, both with 2 x 2 samples,
as far as a frame of the geometry takes less than a minute.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Error as BrowserError

from bench_mesh_levels import draw_ms, settle, shown_by, visit
from bench_quality import SIZE, baked
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera, vertical_fov
from farfield.quality.metrics import compare
from farfield.scene.gltf.write import write_glb
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.scene.read import read_scene
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.tiles import TileCache
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.world import World
from mesh_levels.packages import missing
from objects import objects_options

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser

WORK = Path(__file__).parents[1] / "worlds" / "growth"
OBJECTS = {"1M": 10, "10M": 103, "100M": 1031, "1G": 10310}
LEAF_SIZE, RESOLUTION = 64.0, 640
SAMPLES, BROWSER_SAMPLES = 4, 2
REPEATS = 5
LONGEST_MS = 60_000.0
"""A frame of geometry in the browser; the next size takes ten times as long and is left out."""


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of the two smallest worlds."""
    if not quick:
        return figures(WORK, ("1M", "10M"))
    with tempfile.TemporaryDirectory(prefix="farfield-growth-") as name:
        options = ObjectsOptions(count=4, triangles=500)
        return {"small": reference(_made(Path(name), options, BakeOptions(64.0, 32, "5", workers=1)), (80, 60))}


def figures(work: Path, names: Sequence[str], output: Path | None = None) -> dict[str, Any]:
    """Size -> figures; output: JSON file that each is added to, and that is not measured again."""
    found = json.loads(output.read_text()) if output and output.exists() else {}
    fits = missing() is None
    for name in names:
        options = replace(objects_options(work / "statues"), count=OBJECTS[name])
        bake = BakeOptions(LEAF_SIZE, RESOLUTION, "9", depth_layers=1)
        folder = _made(work / name, options, bake)
        facts = found.setdefault(name, {})
        if "reference" not in facts:
            facts["reference"] = reference(folder, SIZE)
        if fits and "browser" not in facts:
            facts["browser"] = in_browser(folder)
        fits = fits and facts["browser"].get("geometry_ms", LONGEST_MS) < LONGEST_MS
        print(name, facts, file=sys.stderr, flush=True)
        if output:
            output.write_text(json.dumps(found, indent=2) + "\n")
    return found


def _made(folder: Path, options: ObjectsOptions, bake: BakeOptions) -> Path:
    """The scene and its world, made where they are missing."""
    if not (folder / "scene/scene.toml").exists():
        make_objects(folder / "scene", options)
    baked(folder / "scene/scene.toml", folder / "world", bake)
    return folder


def reference(folder: Path, size: tuple[int, int]) -> dict[str, float]:
    """Seconds of both, and what they drew, by the reference renderer."""
    from farfield.store.opening import open_store

    world = World.open(open_store(folder / "world"))
    camera = outside(world)
    options = RenderOptions(supersampling=SAMPLES, near_radius=0.0, far_only=True)
    cache = TileCache(world, 2 << 30)
    pictures = [render_world(world, camera, size, options, cache) for _ in range(REPEATS + 1)][1:]
    ours = median(picture.statistics.seconds for picture in pictures)
    scene = read_scene([folder / "scene/scene.toml"])
    geometry = draw_truth(scene, camera, size, TruthOptions(SAMPLES))
    found = compare(geometry.pixels(None), pictures[0].pixels(None))
    drawn = pictures[0].statistics
    return {
        "triangles_in_view": geometry.statistics.triangles,
        "geometry_seconds": round(geometry.statistics.seconds, 3),
        "farfield_seconds": round(ours, 4),
        "times": round(geometry.statistics.seconds / ours, 1),
        "psnr_covered": round(found["psnr_covered"], 2),
        "flip_covered": round(found["flip_covered"], 4),
        "cells": drawn.cells,
        "splats": drawn.splats,
        "tile_bytes": drawn.tile_bytes,
    }


def outside(world: World) -> Camera:
    """Sees all of the world from a corner, a little from above."""
    low, high = np.array(world.manifest.bounds)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low) / 2)
    fov = vertical_fov(60.0, SIZE)
    away = radius / math.sin(math.radians(fov / 2))
    towards = np.array([-0.75, -0.55, 0.35])
    eye = middle + away * towards / np.linalg.norm(towards)
    return Camera((float(eye[0]), float(eye[1]), float(eye[2])), tuple(float(v) for v in middle), fov)


def in_browser(folder: Path) -> dict[str, float]:
    """Milliseconds of a frame of both in the page of mesh_levels."""
    from farfield.store.opening import open_store

    world = World.open(open_store(folder / "world"))
    camera, found = outside(world), {}
    view = {"eye": camera.eye, "target": camera.target, "fov": camera.fov, "samples": BROWSER_SAMPLES, "near": 0.0}
    view |= {"leaf": LEAF_SIZE, "corner": world.grid.corner, "depth": 1e-4 * world.grid.leaf_size}
    exported(folder)
    for kind, shown in (("world", folder / "world"), ("geometry", folder / "geometry")):
        try:
            with opened_browser() as browser, visit(browser, shown, view | {"kind": kind}, SIZE) as (page, gate):
                gate.limit = 1 << 40
                settle(page, gate)
                took = draw_ms(page)
                state = page.evaluate("show.state()")
                if not (state.get("splats") or state.get("triangles")):
                    raise RuntimeError(f"the browser drew nothing of the {kind}")
                found |= {f"{shown_by(kind)}_{name.removeprefix('frame_')}": v for name, v in took.items()}
                found |= {name: state[name] for name in ("splats", "triangles") if name in state}
        except (BrowserError, RuntimeError) as error:
            found["failed"] = str(error).splitlines()[0][:200]
    if "geometry_ms" in found:
        found["times"] = round(found["geometry_ms"] / found["farfield_ms"], 1)
    return found


def exported(folder: Path) -> None:
    """Writes geometry/: a GLB of each mesh and objects.json, their placements."""
    target = folder / "geometry"
    if (target / "objects.json").exists():
        return
    target.mkdir()
    scene = read_scene([folder / "scene/scene.toml"])
    for kind, source in enumerate(scene.meshes):
        write_glb(target / f"{kind}.glb", source.load())
    rows = [
        [int(kind), *np.round(transform.ravel(), 5).tolist()]
        for kind, transform in zip(scene.instances.mesh, scene.instances.transform, strict=True)
    ]
    (target / "objects.json").write_text(json.dumps({"kinds": len(scene.meshes), "objects": rows}))


def plot(found: dict[str, Any], file: Path) -> None:
    """Seconds a frame over triangles in view, both axes logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.2), dpi=110)
    rows = [facts for facts in found.values() if "reference" in facts]
    triangles = [facts["reference"]["triangles_in_view"] for facts in rows]
    axes.plot(triangles, [f["reference"]["geometry_seconds"] for f in rows], "o-", label="geometry, reference renderer")
    axes.plot(triangles, [f["reference"]["farfield_seconds"] for f in rows], "s-", label="farfield, reference renderer")
    for key, mark, label in (("geometry_ms", "o--", "geometry, browser"), ("farfield_ms", "s--", "farfield, browser")):
        points = [
            (n, f["browser"][key] / 1000) for n, f in zip(triangles, rows, strict=True) if key in f.get("browser", {})
        ]
        if points:
            axes.plot(*zip(*points, strict=True), mark, label=label)
    axes.set(xscale="log", yscale="log", xlabel="triangles in view", ylabel="seconds a frame")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.tight_layout()
    figure.savefig(file)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="to 1 G triangles in view")
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    found = figures(given.work, tuple(OBJECTS) if given.full else ("1M", "10M"), given.output)
    print(json.dumps(found, indent=2))
    if given.plot:
        plot(found, given.plot)


if __name__ == "__main__":
    main()
