"""Every building of Tokyo's 23 wards, from footprints to a world, and pictures of it.

    farfield bench tokyo [--quick] [--json]; the world, its log and the pictures stay in worlds/tokyo23.

9 directions; at 576 pixels over a leaf of 1,024 m near geometry ends at 985 m for a picture 640 pixels wide. The bake
is a process of its own, as users call it; one and two layers are baked into worlds of their own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from farfield.geometry.cameras import Camera
from farfield.store.opening import open_store
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.shading import Light
from farfield.world.verification import verify_world
from farfield.world.world import World

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("FARFIELD_SHARED_DATA", ROOT.parent / "shared/data"))
ARCHIVE = DATA / "tokyo23_lod1/buildings.npz"
OPTIONS = ("--leaf-size", "1024", "--resolution", "576")
SMALL = ("--leaf-size", "64", "--resolution", "32")
VIEWS = {"whole": ((0.0, -0.95, 0.5), (0.0, -0.06, 0.0)), "centre": ((0.03, -0.1, 0.04), (0.03, 0.1, 0.0))}
"""Eye and target, from the middle of the world's bounds in parts of its width."""


def run(quick: bool = False) -> dict[str, Any]:
    """Per number of layers: seconds, peak bytes of a process, bytes of orthoviews, bad tiles; names of the pictures."""
    if not ARCHIVE.exists():
        return {"left_out": f"{ARCHIVE.name} is absent"}
    if quick:
        with tempfile.TemporaryDirectory(prefix="farfield-tokyo-") as folder:
            return _measure(Path(folder), ("--bbox=-150,-150,150,150",), (1,), SMALL)
    return _measure(ROOT / "worlds/tokyo23", (), (1, 2), OPTIONS)


def _measure(folder: Path, box: tuple[str, ...], layers: tuple[int, ...], options: tuple[str, ...]) -> dict[str, Any]:
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / "buildings.fgb"
    if not source.exists():
        script = ROOT / "scripts/convert_tokyo.py"
        subprocess.run([sys.executable, str(script), str(ARCHIVE), str(source), *box], check=True, capture_output=True)
    return {f"layers_{count}": _bake(source, folder / f"world-{count}", count, options) for count in layers}


def _bake(source: Path, place: Path, layers: int, options: tuple[str, ...]) -> dict[str, Any]:
    command = [sys.executable, "-m", "farfield", "bake", str(source), "-o", str(place), *options, "--directions", "9"]
    command += ["--depth-layers", str(layers), "--json"]
    with (place.parent / f"{place.name}.log").open("w") as log:
        ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=log, check=True)
    facts = json.loads(ended.stdout)
    world = World.open(open_store(place))
    orthoviews = sum(size for entry in world.cells() for _, _, size in entry.tiles)
    return {
        **{name: facts[name] for name in ("triangles", "seconds", "cells", "tiles", "bytes", "peak_rss_bytes")},
        "orthoview_bytes": orthoviews,
        "bad": len(verify_world(world).faults),
        "pictures": [_picture(world, place, name) for name in VIEWS],
    }


def _picture(world: World, place: Path, name: str) -> str:
    lower, upper = np.array(world.manifest.bounds)
    middle, width = (lower + upper) / 2, float(upper[0] - lower[0])
    eye, target = ((middle + width * np.array(part)).tolist() for part in VIEWS[name])
    path = place.parent / f"{place.name}-{name}.png"
    picture = render_world(world, Camera(tuple(eye), tuple(target), 45.0), (960, 600), RenderOptions())
    picture.save(path, Light().sky_linear)
    return path.name
