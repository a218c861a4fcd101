"""Time and memory of the bake as worlds grow (OV 4.1, the paper's log-memory claim): 1, 4, 16 and 64 times a world.

    farfield bench scale [--quick] [--json]

Objects floating at one density, so that a world of 64 times the triangles has 64 times the leaves and two levels more.
Each bake is a process of its own with one worker, as users call it; its peak memory is what the system says.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from farfield.scene.procedural.objects import ObjectsOptions, make_objects

TIMES = (1, 4, 16, 64)
OPTIONS = ("--leaf-size", "32", "--directions", "9", "--workers", "1", "--json")


def run(quick: bool = False) -> dict[str, Any]:
    """Per size: triangles, cells, processor time a triangle, peak bytes; and how both grow."""
    count, triangles, resolution, times = (4, 500, 32, TIMES[:2]) if quick else (32, 20_000, 128, TIMES)
    sizes: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(prefix="farfield-scale-") as name:
        for factor in times:
            folder = Path(name) / str(factor)
            scene = make_objects(folder / "scene", ObjectsOptions(count=count * factor, triangles=triangles))
            sizes[str(factor)] = _bake(scene.path, folder / "world", resolution)
    # The smallest is mostly start: reading kernels and meshes. Growth is counted from the second.
    later = [sizes[str(factor)] for factor in times[1:]]
    return {
        "sizes": sizes,
        "time_spread": round(max(s["microseconds"] for s in later) / min(s["microseconds"] for s in later), 3),
        "memory_growth": round(later[-1]["peak_bytes"] / later[0]["peak_bytes"], 3),
    }


def _bake(scene: Path, world: Path, resolution: int) -> dict[str, float]:
    command = [sys.executable, "-m", "farfield", "bake", str(scene), "-o", str(world), *OPTIONS]
    before = _processor_seconds()
    ended = subprocess.run([*command, "--resolution", str(resolution)], capture_output=True, text=True, check=True)
    seconds = _processor_seconds() - before
    facts = json.loads(ended.stdout)
    return {
        "triangles": facts["triangles"],
        "cells": facts["cells"],
        "levels": facts["levels"],
        "seconds": facts["seconds"],
        "processor_seconds": round(seconds, 2),
        "microseconds": round(1e6 * seconds / facts["triangles"], 3),
        "bytes": facts["bytes"],
        "peak_bytes": facts["peak_rss_bytes"],
    }


def _processor_seconds() -> float:
    """Of all children that have ended: other work on the machine counts less than by the clock."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
