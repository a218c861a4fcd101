"""The stages put together: what the commands and a script call."""

from __future__ import annotations

import resource
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.progress import NoProgress, Progress
from farfield.scene.read import read_scene
from farfield.serve.viewer_files import install_viewer
from farfield.store.opening import open_store


def bake_sources(
    sources: Sequence[Path], output: Path, options: BakeOptions | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Reads `sources`, bakes them into the folder `output` with the viewer beside; the facts of `bake --json`.

    Raises InputError, OptionError, WorldError (NotAWorldError: the folder holds something else; ClusterError: the
    scheduler or its workers fail) or StoreError.
    """
    progress = progress or NoProgress()
    if options is not None and options.scheduler:
        # The workers have current folders of their own.
        sources = [source.absolute() for source in sources]
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


def peak_rss_bytes() -> int:
    """Largest resident memory of this process or any finished child, bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * max(
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    )
