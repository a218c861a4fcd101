"""Throughput of the bake on the objects world, from scene on disk to a verified world, and where its time goes.

    farfield bench bake [--quick] [--json]

9 directions, two depth layers (the default) and one (the papers' setting), every level, codec included; a leaf pixel is
1/100 of an object's diameter. The statues of the large inputs are the objects where they are at hand, else made ones.
One worker against two; the profile is of one process, by processor time.
"""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.pipeline import peak_rss_bytes
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.scene.read import read_scene
from farfield.store.directory import DirectoryStore
from farfield.world.verification import verify_world
from farfield.world.world import World
from objects import statues
from storage import BYTES_A_TRIANGLE, orthoview_storage

STAGES = {
    "read and survey": ("scene/", "bake/survey", "blocks.py"),
    "clip": ("clip.py", "clipping.py", "chunk.py"),
    "rasterise": ("rasterise", "project.py", "edges.py", "orthoview/leaf.py"),
    "resolve": ("resolve.py", "quantise.py", "texture.py", "materials.py"),
    "connect": ("connect.py", "connectivity.py"),
    "decode and composite": (
        "composite.py",
        "gather.py",
        "parent.py",
        "contexts.py read_",
        "fill_slots",
        "restore_",
        "valid.py place",
        "WebPAnimDecoder",
    ),
    "encode": (
        "contexts.py",
        "rans.py",
        "coding.py",
        "planes.py",
        "valid.py",
        "predict.py",
        "fill.py",
        "webp.py",
        "tile.py",
        "container.py",
        "object_tile.py",
        "compress",
        "WebPEncode",
    ),
    "choose views": ("coverage.py", "view_table.py"),
    "near geometry": ("represent/geometry",),
    "store": ("store/", "fsync", "posix", "open"),
}
"""Stage -> parts of the names of files and built-in functions whose own time it counts; the first that fits."""


def run(quick: bool = False) -> dict[str, Any]:
    """Source triangles a second, bytes, memory, and shares of time by stage."""
    with tempfile.TemporaryDirectory(prefix="farfield-bake-") as name:
        folder = Path(name)
        scene = make_objects(folder / "scene", _objects(quick))
        options = BakeOptions(leaf_size=64.0, resolution=64 if quick else 640, directions="9")
        facts: dict[str, Any] = {"triangles": scene.triangles, "source_bytes": scene.bytes}
        for layers, workers in ((2, 1),) if quick else ((2, 1), (2, 2), (1, 2)):
            chosen = replace(options, depth_layers=layers, workers=workers)
            name = f"layers_{layers}_workers_{workers}"
            facts[name] = timed_bake(scene.path, folder / name, chosen)
        facts["profile"] = _profile(scene.path, folder / "profiled", replace(options, workers=1))
        return facts


def _objects(quick: bool) -> ObjectsOptions:
    if quick:
        return ObjectsOptions(count=4, triangles=2000)
    return ObjectsOptions(count=125, meshes=statues())


def timed_bake(
    scene: Path, world: Path, options: BakeOptions, bytes_a_triangle: int = BYTES_A_TRIANGLE
) -> dict[str, Any]:
    """Bakes and verifies the scene; speed, bytes, memory."""
    store = DirectoryStore(world)
    begun = time.monotonic()
    result = bake(read_scene([scene]), store, options)
    baked = time.monotonic()
    world = World.open(store)
    bad = verify_world(world).faults
    seconds = time.monotonic() - begun
    statistics = result.manifest.statistics
    return {
        "triangles_per_second": round(statistics.triangles / seconds),
        "seconds": round(seconds, 2),
        "verify_seconds": round(time.monotonic() - baked, 2),
        "bad": len(bad),
        "cells": statistics.cells,
        "orthoviews": statistics.orthoviews,
        "bytes": statistics.bytes,
        **orthoview_storage(world, bytes_a_triangle),
        "peak_rss_bytes": peak_rss_bytes(),
    }


def _profile(scene: Path, world: Path, options: BakeOptions) -> dict[str, float]:
    """Share of processor time by stage."""
    profiler = cProfile.Profile(time.process_time)
    profiler.enable()
    bake(read_scene([scene]), DirectoryStore(world), options)
    profiler.disable()
    shares = dict.fromkeys([*STAGES, "other"], 0.0)
    total = 0.0
    for (file, _, function), (_, _, own, _, _) in pstats.Stats(profiler).stats.items():  # type: ignore[attr-defined]
        place = f"{file} {function}"
        stage = next((s for s, parts in STAGES.items() if any(part in place for part in parts)), "other")
        shares[stage] += own
        total += own
    return {stage: round(seconds / total, 3) for stage, seconds in shares.items()}
