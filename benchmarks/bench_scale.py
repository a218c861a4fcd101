"""Time and memory of the bake as worlds grow (OV 4.1, the paper's log-memory claim): 1, 8 and 64 times a world.

    farfield bench scale [--quick] [--json]

Objects float in cubes of 4, 8 and 16 of them a side; leaves are two of them wide, with room for what sticks out of the
cube, so that a world of 64 times the triangles has just 64 times the leaves, as full, and two levels more. Each bake
is a process of its own with one worker, as users call it; its peak memory is what the system says, and the start of
the program and all kernels, the time of the smallest world with objects of 12 triangles, is taken off its time.
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

TIMES = (1, 8, 64)
OPTIONS = ("--leaf-size", "48", "--directions", "9", "--workers", "1", "--json")


def run(quick: bool = False) -> dict[str, Any]:
    """Per size: triangles, cells, processor time a triangle, peak bytes; and how both grow."""
    side, triangles, resolution, times = (1, 500, 32, TIMES[:2]) if quick else (4, 20_000, 128, TIMES)
    sizes: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(prefix="farfield-scale-") as name:
        simplest = make_objects(Path(name) / "simplest", ObjectsOptions(count=side**3, triangles=12))
        start = _bake(simplest.path, Path(name) / "start", resolution)["processor_seconds"]
        for factor in times:
            folder = Path(name) / str(factor)
            scene = make_objects(folder / "scene", ObjectsOptions(count=side**3 * factor, triangles=triangles))
            figures = _bake(scene.path, folder / "world", resolution)
            figures["microseconds"] = round(1e6 * (figures["processor_seconds"] - start) / figures["triangles"], 3)
            sizes[str(factor)] = figures
    spent, peaks = ([size[fact] for size in sizes.values()] for fact in ("microseconds", "peak_bytes"))
    return {
        "start_seconds": start,
        "sizes": sizes,
        "time_spread": round(max(spent) / max(min(spent), 1e-9), 3),
        "memory_growth": round(peaks[-1] / peaks[0], 3),
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
        "bytes": facts["bytes"],
        "peak_bytes": facts["peak_rss_bytes"],
    }


def _processor_seconds() -> float:
    """Of all children that have ended: other work on the machine counts less than by the clock."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
