"""The stages put together: what the commands and a script call."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.errors import OptionError
from farfield.progress import NoProgress, Progress
from farfield.scene.read import read_scene
from farfield.serve.viewer_files import install_viewer
from farfield.store import Store
from farfield.store.archive.writer import writing_archive
from farfield.store.opening import Place, is_archive, is_url, open_store
from farfield.world.copying import Copied, copy_world
from farfield.world.targets import ArchiveTarget, StoreTarget


def bake_sources(
    sources: Sequence[Path], output: Place, options: BakeOptions | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Reads `sources`, bakes them into the folder or bucket `output`, the viewer beside; the facts of `bake --json`.

    Raises InputError, OptionError, NotAWorldError (the folder holds something else) or StoreError.
    """
    progress = progress or NoProgress()
    store = open_store(output, create=True)
    scene = read_scene(sources)
    result = bake(scene, store, options, progress)
    install_viewer(store)
    statistics = result.manifest.statistics
    return {
        "world": str(output),
        "triangles": statistics.triangles,
        "seconds": round(result.seconds, 3),
        "triangles_per_second": round(statistics.triangles / max(result.seconds, 1e-9)),
        "cells": statistics.cells,
        "cells_rebuilt": result.cells_rebuilt,
        "levels": result.manifest.octree.top_level + 1,
        "leaf_size": result.manifest.grid.leaf_size,
        "resolution": result.manifest.grid.resolution,
        "orthoviews": statistics.orthoviews,
        "tiles": statistics.tiles,
        "bytes": statistics.bytes,
        "source_bytes": statistics.source_bytes,
        "peak_rss_bytes": peak_rss_bytes(),
    }


def copy_place(source: Place, target: Place, progress: Progress | None = None) -> dict[str, Any]:
    """Copies a world between any two of folder, archive and bucket; the facts of `copy --json`.

    The viewer goes along, but into an archive. Raises OptionError: both are the same place; and as `open_store` and
    `copy_world` do.
    """
    if _same_place(source, target):
        raise OptionError("source and target are the same place", str(target), "name another target")
    begun = time.perf_counter()
    copied = _copy_to(open_store(source), target, progress or NoProgress())
    return {
        "world": str(target),
        "bytes": copied.bytes,
        "keys": copied.keys,
        "skipped": copied.skipped,
        "seconds": round(time.perf_counter() - begun, 3),
        "peak_rss_bytes": peak_rss_bytes(),
    }


def _copy_to(world: Store, target: Place, progress: Progress) -> Copied:
    if is_archive(target):
        with writing_archive(target) as writer:
            return copy_world(world, ArchiveTarget(writer), progress)
    store = open_store(target, create=True)
    with store.writing():
        copied = copy_world(world, StoreTarget(store), progress)
        install_viewer(store)
    return copied


def _same_place(a: Place, b: Place) -> bool:
    if is_url(a) or is_url(b):
        return str(a).rstrip("/") == str(b).rstrip("/")
    return Path(a).resolve() == Path(b).resolve()


def peak_rss_bytes() -> int:
    """Largest resident memory of this process or any finished child, bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * max(
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    )
