"""Real inputs from source to verified world to picture: statue, forest, city, plant, scan, landscape.

    farfield bench inputs [--json]; pictures and worlds are kept in worlds/inputs beside the clone.

Sources come from the large inputs (FARFIELD_SHARED_DATA); what is absent is left out and named.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.pipeline import bake_sources
from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape
from farfield.store.opening import open_store
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.shading import Light
from farfield.world.verification import verify_world
from farfield.world.world import World

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("FARFIELD_SHARED_DATA", ROOT.parent / "shared/data"))


@dataclass(frozen=True)
class Input:
    """One source and how it is baked."""

    source: Callable[[Path], Path]
    """Makes or finds the source; the folder is for what has to be made."""
    options: BakeOptions = BakeOptions()  # noqa: RUF009


def _file(name: str) -> Callable[[Path], Path]:
    return lambda folder: DATA / name


def _forest(folder: Path) -> Path:
    """2,000 oaks of 114,476 triangles on a square kilometre."""
    rng = np.random.default_rng(7)
    places = np.column_stack([rng.uniform(0, 1000, (2000, 2)), np.zeros(2000), rng.uniform(0, 360, 2000)])
    np.save(folder / "places.npy", np.column_stack([places, rng.uniform(0.8, 1.2, 2000)]))
    oak = DATA / "eztree_trees/oak_dense.glb"
    (folder / "scene.toml").write_text(
        f'[[source]]\npath = "{oak.as_posix()}"\ninstances = "places.npy"\n\n'
        '[[ground]]\nsize = [1040.0, 1040.0]\ntranslate = [500.0, 500.0, 0.0]\ntexture = "grass"\n'
    )
    return folder / "scene.toml"


def _tokyo(folder: Path) -> Path:
    """2 km x 2 km of central Tokyo's roofs."""
    archive = DATA / "tokyo_core_lod2/roofs.npz"
    script, bbox = ROOT / "scripts/convert_tokyo.py", "-3000,-2600,-1000,-600"
    target = folder / "tokyo.fgb"
    subprocess.run([sys.executable, str(script), str(archive), str(target), f"--bbox={bbox}"], check=True)
    return target


def _landscape(folder: Path) -> Path:
    return make_landscape(folder / "landscape", LandscapeOptions()).path


COARSE = BakeOptions(leaf_size=64.0, resolution=256, directions="9")
INPUTS = {
    "statue": Input(_file("threedscans_statues/pan.glb")),
    "plant": Input(_file("gltf_samples/DiffuseTransmissionPlant.glb")),
    "scan": Input(_file("odedstein_meshes/koala.ply")),
    "city": Input(_tokyo),
    "landscape": Input(_landscape, BakeOptions(resolution=256, directions="9")),
    "forest": Input(_forest, COARSE),
}


def run(quick: bool = False, names: tuple[str, ...] = tuple(INPUTS)) -> dict[str, Any]:
    """Facts of each input: triangles, seconds, bytes, bad values, share of the picture that is covered."""
    if quick:
        small = Input(lambda folder: ROOT / "src/farfield/demo/eagle.glb", BakeOptions(resolution=32, directions="5"))
        with tempfile.TemporaryDirectory(prefix="farfield-inputs-") as folder:
            return {"eagle": _measure(small, Path(folder))}
    place = ROOT / "worlds/inputs"
    return {name: _measure(INPUTS[name], place / name) for name in names}


def _measure(chosen: Input, folder: Path) -> dict[str, Any]:
    folder.mkdir(parents=True, exist_ok=True)
    try:
        source = chosen.source(folder)
        if not source.exists():
            return {"left_out": f"{source} is absent"}
        facts = bake_sources([source], folder / "world", chosen.options)
    except subprocess.CalledProcessError as error:
        return {"left_out": str(error)}
    world = World.open(open_store(folder / "world"))
    begun = time.monotonic()
    verified = verify_world(world)
    seconds = time.monotonic() - begun
    kept = (
        "triangles",
        "seconds",
        "triangles_per_second",
        "cells",
        "leaf_size",
        "bytes",
        "source_bytes",
        "peak_rss_bytes",
    )
    covered = _picture(world, folder / "picture.png")
    return {name: facts[name] for name in kept} | {
        "bad": len(verified.faults),
        "verify_seconds": round(seconds, 1),
        "covered": covered,
    }


def _picture(world: World, path: Path) -> float:
    """From the south-west, a third as high as far, the whole world in view."""
    lower, upper = np.array(world.manifest.bounds)
    middle, reach = (lower + upper) / 2, float(np.linalg.norm(upper - lower))
    eye = middle + np.array([-0.55, -0.7, 0.35]) * reach * 0.8
    camera = Camera(tuple(map(float, eye)), tuple(map(float, middle)), 45.0)
    picture = render_world(world, camera, (640, 480), RenderOptions())
    picture.save(path, Light().sky_linear)
    return round(float(picture.alpha.mean()), 3)
