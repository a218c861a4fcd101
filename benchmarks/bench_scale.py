"""Time and memory of the bake as worlds grow (OV 4.1, the paper's log-memory claim): 1, 8 and 64 times a world.

    farfield bench scale [--quick] [--json]

Objects float in cubes of 4, 8 and 16 of them a side; leaves are two of them wide, with room for what sticks out of the
cube, so that a world of 64 times the triangles has just 64 times the leaves, as full, and two levels more. Each bake
is a process of its own with one worker, as users call it; its peak memory is what the system says. Time a triangle is
told of what a world has more than the next smaller one: the start of the program and its kernels cancels out.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

from farfield.scene.procedural.objects import ObjectsOptions, make_objects

TIMES = (1, 8, 64)
OPTIONS = ("--leaf-size", "48", "--directions", "9", "--workers", "1", "--json")


def run(quick: bool = False) -> dict[str, Any]:
    """Per size: triangles, cells, processor seconds, peak bytes, and from the second on the processor time of each
    triangle more than before; and how both grow."""
    side, triangles, resolution = (1, 500, 32) if quick else (4, 20_000, 128)
    sizes: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(prefix="farfield-scale-") as name:
        for factor in TIMES:
            folder = Path(name) / str(factor)
            scene = make_objects(folder / "scene", ObjectsOptions(count=side**3 * factor, triangles=triangles))
            sizes[str(factor)] = _bake(scene.path, folder / "world", resolution)
    for smaller, larger in pairwise(sizes.values()):
        seconds, triangles = (larger[fact] - smaller[fact] for fact in ("processor_seconds", "triangles"))
        larger["microseconds_a_triangle_more"] = round(1e6 * seconds / triangles, 3)
    spent = [size["microseconds_a_triangle_more"] for size in list(sizes.values())[1:]]
    peaks = [size["peak_bytes"] for size in sizes.values()]
    return {
        "sizes": sizes,
        "time_spread": round(max(spent) / min(spent), 3) if min(spent) > 0 else None,
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
