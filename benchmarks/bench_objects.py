"""The bake of the paper's objects world, 29,264 objects of 97,000 triangles: every object drawn as its own geometry.

    farfield bench objects [--quick] [--json]       a sixteenth of it, 177 M triangles
    python benchmarks/bench_objects.py --full       all of it, 2.84 G triangles, one layer

From scene on disk to a verified world with two workers: 9 directions, every level, codec included; a leaf pixel is
1/100 of an object's height. One depth layer is the paper's setting, two are the default.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench_bake import timed_bake
from farfield.bake.options import BakeOptions
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from objects import objects_options

LEAF_SIZE, RESOLUTION = 64.0, 640
"""10 m objects, pixels of 10 cm."""


def run(quick: bool = False, sixteenths: int = 1, layers: tuple[int, ...] = (1, 2)) -> dict[str, Any]:
    """Source triangles a second, bytes and memory by depth layers."""
    with tempfile.TemporaryDirectory(prefix="farfield-objects-") as name:
        folder = Path(name)
        chosen = ObjectsOptions(count=8, triangles=500) if quick else objects_options(folder / "statues", sixteenths)
        scene = make_objects(folder / "scene", chosen)
        facts: dict[str, Any] = {"objects": chosen.count, "triangles": scene.triangles}
        for count in layers[:1] if quick else layers:
            options = BakeOptions(
                leaf_size=LEAF_SIZE, resolution=32 if quick else RESOLUTION, directions="9", depth_layers=count,
                workers=1 if quick else 2,
            )  # fmt: skip
            facts[f"layers_{count}"] = timed_bake(scene.path, folder / f"layers-{count}", options)
        return facts


if __name__ == "__main__":
    whole = "--full" in sys.argv
    print(json.dumps(run(sixteenths=16, layers=(1,)) if whole else run(), indent=2))
