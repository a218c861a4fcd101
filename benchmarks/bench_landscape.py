"""The bake of a landscape: land, towns and forests, every tree drawn as its own geometry.

    farfield bench landscape [--quick] [--json]

From scene on disk to a verified world with two workers: 9 directions, every level, codec included, leaf pixels of
25 cm. One depth layer is the papers' setting, two are the default. The paper counts 38 bytes a triangle (OV 6).
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from bench_bake import timed_bake
from farfield.bake.options import BakeOptions
from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape

BYTES_A_TRIANGLE = 38


def run(quick: bool = False) -> dict[str, Any]:
    """Source triangles a second, bytes and memory by depth layers."""
    with tempfile.TemporaryDirectory(prefix="farfield-landscape-") as name:
        folder = Path(name)
        chosen = LandscapeOptions(side=120.0, step=8.0, tree_triangles=200, towns=0) if quick else LandscapeOptions()
        scene = make_landscape(folder / "scene", chosen)
        facts: dict[str, Any] = {"triangles": scene.triangles}
        for layers in (1,) if quick else (1, 2):
            options = BakeOptions(
                leaf_size=128.0, resolution=32 if quick else 512, directions="9", depth_layers=layers,
                workers=1 if quick else 2,
            )  # fmt: skip
            place = folder / f"layers-{layers}"
            facts[f"layers_{layers}"] = timed_bake(scene.path, place, options, BYTES_A_TRIANGLE)
        return facts
