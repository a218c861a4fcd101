"""The stages put together: what the commands and a script call."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from farfield.bake.bake import bake_held
from farfield.bake.options import BakeOptions
from farfield.bake.repair import forget
from farfield.errors import MissingKeyError, OptionError, WorldError
from farfield.progress import NoProgress, Progress
from farfield.scene.model import Scene
from farfield.scene.read import read_scene
from farfield.serve.viewer_files import install_viewer
from farfield.store import Store
from farfield.store.archive.writer import writing_archive
from farfield.store.opening import Place, is_archive, is_url, open_store
from farfield.world.copying import Copied, copy_world
from farfield.world.manifest import Manifest, read_manifest
from farfield.world.targets import ArchiveTarget, StoreTarget
from farfield.world.verification import Verification, verify_world
from farfield.world.world import World


def bake_sources(
    sources: Sequence[Path], output: Place, options: BakeOptions | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Reads `sources`, bakes them into the folder or bucket `output`, the viewer beside; the facts of `bake --json`.

    Raises InputError, OptionError, WorldError (NotAWorldError: the folder holds something else; ClusterError: the
    scheduler or its workers fail) or StoreError.
    """
    progress = progress or NoProgress()
    if options is not None and options.scheduler:
        # The workers have current folders of their own.
        sources = [source.absolute() for source in sources]
    store = open_store(output, create=True)
    scene = read_scene(sources)
    options = options or BakeOptions()
    with store.writing():
        _remember(store, sources, options)
        result = bake_held(scene, store, options, progress)
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


def update_place(
    place: Place, sources: Sequence[Path], workers: int = 0, progress: Progress | None = None
) -> dict[str, Any]:
    """Makes a world hold what `sources` hold now (OV 4.1); the facts of `update --json`.

    The grid and the options stay those of the world, so that the result has the same bytes as a whole bake into that
    grid. Cells that hold nothing any more go. Old tiles stay for those who read the generation before. Raises
    WorldError: the world does not tell its options, or has another CRS; and as `bake_sources`.
    """
    progress = progress or NoProgress()
    store = open_store(place)
    manifest = read_manifest(store)
    grid, begun = manifest.grid, time.monotonic()
    options = replace(
        _order_of(store).options,
        leaf_size=grid.leaf_size,
        resolution=grid.resolution,
        corner=grid.corner,
        workers=workers,
    )
    scene = _in_frame(read_scene(sources), manifest, store.location)
    with store.writing():
        _remember(store, sources, options)
        result = bake_held(scene, store, options, progress)
    return {
        "world": str(place),
        "cells_rebuilt": result.cells_rebuilt,
        "cells": result.manifest.statistics.cells,
        "generation": result.manifest.generation,
        "seconds": round(time.monotonic() - begun, 3),
        "bytes": result.manifest.statistics.bytes,
        "peak_rss_bytes": peak_rss_bytes(),
    }


def _in_frame(scene: Scene, manifest: Manifest, where: str) -> Scene:
    """The scene with the world's local zero, which follows from its extent where it has a CRS."""
    if scene.crs != manifest.crs:
        raise WorldError(f"the source has CRS {scene.crs}, the world {manifest.crs}", where, "bake it anew")
    shift = np.subtract(scene.origin, manifest.origin)
    moved = scene.instances.transform.copy()
    moved[:, :, 3] += shift
    return replace(scene, origin=manifest.origin, instances=replace(scene.instances, transform=moved))


class _Order(msgspec.Struct, frozen=True):
    """What a world was last baked from, so that it can be repaired; it stays beside the notes about its cells."""

    sources: tuple[str, ...]
    options: BakeOptions


_ORDER_KEY = "record/order.json"


def _remember(store: Store, sources: Sequence[Path], options: BakeOptions) -> None:
    # Who does the work is of no matter for the world, and a cluster may be gone when it is repaired.
    anywhere = replace(options, workers=0, scheduler="")
    order = _Order(tuple(str(Path(source).resolve()) for source in sources), anywhere)
    store.put(_ORDER_KEY, msgspec.json.encode(order))


def verify_place(place: Place, repair: bool = False, progress: Progress | None = None) -> Verification:
    """Checks a world; with `repair`, what is bad is baked again from the source that the world was baked from.

    Raises WorldError: something is bad and the source is not known or not there any more; and as `open_store`,
    `World.open` and `bake_sources` do.
    """
    progress = progress or NoProgress()
    store = open_store(place)
    found = verify_world(World.open(store), progress)
    # What a damaged index tile hid is found when it is whole again.
    for _ in range(_REPAIRS if repair else 0):
        if not found.faults:
            break
        order = _order_of(store)
        sources = _sources_of(order)
        progress.note(f"{len(found.faults):,} bad; baking them again from {', '.join(order.sources)}")
        with store.writing():
            forget(World.open(store), [fault.key for fault in found.faults])
        bake_sources(sources, place, order.options, progress)
        found = verify_world(World.open(store), progress)
    return found


_REPAIRS = 3


def _sources_of(order: _Order) -> list[Path]:
    """Raises WorldError when one is gone."""
    for source in order.sources:
        if not Path(source).exists():
            raise WorldError("the source is not there any more", source, "put it back, or bake another copy of it")
    return [Path(source) for source in order.sources]


def _order_of(store: Store) -> _Order:
    try:
        return msgspec.json.decode(store.get(_ORDER_KEY), type=_Order)
    except (MissingKeyError, msgspec.DecodeError):
        raise WorldError(
            "the world does not tell what it was baked from", store.location, "bake its source into it again"
        ) from None


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
