"""The stages put together: what the commands and a script call."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from farfield.bake.bake import bake_held
from farfield.bake.options import BAKE_VERSION, BakeOptions
from farfield.bake.partition import split_large
from farfield.bake.region import with_region
from farfield.bake.repair import forget
from farfield.errors import CorruptTileError, MissingKeyError, OptionError, WorldError
from farfield.progress import NoProgress, Progress
from farfield.scene.georeference import moved_to
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions, Region
from farfield.scene.read import read_scene
from farfield.scene.stored.scene import KEY as SCENE_KEY
from farfield.scene.stored.scene import StoredScene, read_scene_of
from farfield.serve.viewer_files import install_viewer
from farfield.store import Store
from farfield.store.archive.writer import writing_archive
from farfield.store.opening import Place, is_archive, is_url, open_store
from farfield.world.chunks import SCENE, named_chunks
from farfield.world.copying import Copied, copy_world
from farfield.world.manifest import Manifest, read_manifest
from farfield.world.split import open_world, refuse_split
from farfield.world.splitting import Part, parts_of, split_world
from farfield.world.targets import ArchiveTarget, StoreTarget
from farfield.world.verification import Fault, Verification, verify_world
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
    refuse_split(store)
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
    place: Place,
    sources: Sequence[Path],
    workers: int = 0,
    progress: Progress | None = None,
    region: Region | None = None,
) -> dict[str, Any]:
    """Makes a world hold what `sources` hold now (OV 4.1); the facts of `update --json`.

    region: x0, y0, x1, y1 in the world's CRS; only what lies in it is replaced (`bake.region.with_region`) and, where
    the file's format allows, read; without sources it is cleared. The grid and the options stay those of the
    world, so that the result has the same bytes as a whole bake into that grid. Cells that hold nothing any more go.
    Old tiles stay for those who read the generation before. Raises WorldError: the world does not tell its options or
    its scene, or has another CRS; OptionError: nothing to do; and as `bake_sources`.
    """
    progress = progress or NoProgress()
    store = open_store(place)
    refuse_split(store)
    manifest = read_manifest(store)
    order, begun = _order_of(store), time.monotonic()
    options = replace(
        order.options,
        leaf_size=manifest.grid.leaf_size,
        resolution=manifest.grid.resolution,
        corner=manifest.grid.corner,
        workers=workers,
    )
    with store.writing():
        if region is None:
            scene = _read_again(sources, store)
            _remember(store, sources, options)
        else:
            same = _paths(sources) == order.sources
            scene = _changed(store, manifest, sources, region, same, progress)
            changed = order.changed or not same
            _put_order(store, _Order(order.sources, replace(options, workers=0), changed))
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


def _changed(
    store: Store, manifest: Manifest, sources: Sequence[Path], region: Region, same: bool, progress: Progress
) -> Scene:
    """The world's scene with a region replaced; same: by what it was baked from, as that is now."""
    stored = _kept_scene(store)
    fresh = None
    if sources:
        scene = read_scene(sources, ReadOptions(crs=manifest.crs, region=region, origin=_origin(manifest)))
        fresh = split_large(_in_frame(scene, manifest, store.location), store, progress)
    scene = with_region(stored, fresh, region, store, progress)
    if fresh is None or not same:
        return scene
    return replace(scene, name=fresh.name, credits=fresh.credits, source_bytes=fresh.source_bytes)


def _kept_scene(store: Store) -> StoredScene:
    """The scene that the world keeps. Raises WorldError when it does not, and CorruptTileError."""
    stored = read_scene_of(store, BAKE_VERSION)
    if stored is None:
        raise WorldError("the world does not tell its scene: another version or a script baked it", store.location,
                         "update it once from everything, without --region")  # fmt: skip
    return stored


def _read_again(sources: Sequence[Path], store: Store) -> Scene:
    """Everything that the sources of a world hold now, in its frame."""
    manifest = read_manifest(store)
    return _in_frame(read_scene(sources, ReadOptions(origin=_origin(manifest))), manifest, store.location)


def _origin(manifest: Manifest) -> tuple[float, float, float] | None:
    """The world's local zero: what has no coordinates of its own stays where it is, whatever else is read beside it."""
    return manifest.origin if manifest.crs is not None else None


def _in_frame(scene: Scene, manifest: Manifest, where: str) -> Scene:
    """The scene with the world's local zero."""
    if scene.crs != manifest.crs:
        raise WorldError(f"the source has CRS {scene.crs}, the world {manifest.crs}", where, "bake it anew")
    return scene if scene.origin == manifest.origin else moved_to(scene, manifest.origin)


class _Order(msgspec.Struct, frozen=True):
    """What a world was last baked from, so that it can be repaired; it stays beside the notes about its cells."""

    sources: tuple[str, ...]
    options: BakeOptions
    changed: bool = False
    """By region since, from other sources: the scene that the store keeps is the truth."""


_ORDER_KEY = "record/order.json"


def _remember(store: Store, sources: Sequence[Path], options: BakeOptions) -> None:
    # Who does the work is of no matter for the world, and a cluster may be gone when it is repaired.
    anywhere = replace(options, workers=0, scheduler="")
    _put_order(store, _Order(_paths(sources), anywhere))


def _put_order(store: Store, order: _Order) -> None:
    store.put(_ORDER_KEY, msgspec.json.encode(order))


def _paths(sources: Sequence[Path]) -> tuple[str, ...]:
    return tuple(str(Path(source).resolve()) for source in sources)


def verify_place(place: Place, repair: bool = False, progress: Progress | None = None) -> Verification:
    """Checks a world; with `repair`, what is bad is baked again from the source that the world was baked from.

    Raises WorldError: something is bad and the source is not known or not there any more, or the scene that the world
    keeps instead of it is damaged itself; and as `open_store`, `World.open` and `bake_sources` do.
    """
    progress = progress or NoProgress()
    store = open_store(place)
    found = _verified(store, progress)
    # What a damaged index tile hid is found when it is whole again.
    for _ in range(_REPAIRS if repair else 0):
        if not found.faults:
            break
        order = _order_of(store)
        stored = _kept_scene(store) if order.changed else None
        sources = [] if stored else _sources_of(order)
        origin = "the scene that it keeps" if stored else ", ".join(order.sources)
        progress.note(f"{len(found.faults):,} bad; baking them again from {origin}")
        refuse_split(store)
        with store.writing():
            bad = {fault.key for fault in found.faults}
            lost = bad & named_chunks(store) if stored and SCENE not in bad else None
            forget(World.open(store), bad)
            if lost:
                raise WorldError("a part of the scene that the world keeps is damaged", min(lost),
                                 "update it once from everything, without --region")  # fmt: skip
            scene = stored.scene if stored else _read_again(sources, store)
            bake_held(scene, store, order.options, progress)
            install_viewer(store)
        found = _verified(store, progress)
    return found


def _verified(store: Store, progress: Progress) -> Verification:
    """`verify_world`, and whether the scene that the world keeps can be read."""
    found = verify_world(World.open(store), progress)
    try:
        read_scene_of(store, BAKE_VERSION)
    except CorruptTileError as error:
        found = replace(found, faults=(*found.faults, Fault(SCENE_KEY, error.what)))
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


def copy_place(
    source: Place, target: Place, progress: Progress | None = None, servers: Sequence[str] = ()
) -> dict[str, Any]:
    """Copies a world between any two of folder, archive and bucket; the facts of `copy --json`.

    The viewer goes along, but into an archive. A world that is split over servers is put together.
    servers: addresses over which the copy is to be split (`world.splitting.parts_of`); a folder for each in `target`.
    Raises OptionError: both are the same place, or an address cannot be used; and as `open_world`, `open_store` and
    `copy_world` do.
    """
    parts = parts_of(target, servers) if servers else ()
    for place in (target, *(part.place for part in parts)):
        if _same_place(source, place):
            raise OptionError("source and target are the same place", str(place), "name another target")
    progress = progress or NoProgress()
    begun = time.perf_counter()
    world = open_world(source)
    shares: dict[str, Any] = {}
    if parts:
        copied, shares["servers"] = _split_to(world, parts, progress)
    else:
        copied = _copy_to(world, target, progress)
    return {
        "world": str(target),
        "bytes": copied.bytes,
        "keys": copied.keys,
        "skipped": copied.skipped,
        **shares,
        "seconds": round(time.perf_counter() - begun, 3),
        "peak_rss_bytes": peak_rss_bytes(),
    }


def _split_to(world: Store, parts: Sequence[Part], progress: Progress) -> tuple[Copied, list[dict[str, Any]]]:
    """The copy as a whole, and what each server is to have."""
    stores = [open_store(part.place, create=True) for part in parts]
    with ExitStack() as writing:
        for store in stores:
            writing.enter_context(store.writing())
        copied, shares = split_world(world, stores, [part.address for part in parts], progress)
        for store in stores:
            install_viewer(store)
    return copied, [
        {"address": part.address, "place": part.place, "keys": share.keys, "bytes": share.bytes}
        for part, share in zip(parts, shares, strict=True)
    ]


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
