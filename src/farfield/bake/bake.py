"""Baking a scene into a world."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import msgspec

from farfield import __version__
from farfield.bake.cell import BakedCell, Tally
from farfield.bake.context import BakeJob
from farfield.bake.crew import crew_of
from farfield.bake.engine import bake_tree
from farfield.bake.index import INDEX_DEPTH
from farfield.bake.options import BakeOptions
from farfield.bake.plan import Plan, make_plan
from farfield.bake.survey import MeshSummary, survey
from farfield.errors import FarfieldError, InputError, MissingKeyError
from farfield.progress import NoProgress, Progress
from farfield.scene.model import Scene
from farfield.store.contract import Store
from farfield.world.keys import content_hash
from farfield.world.manifest import (
    KEY,
    DirectionRecord,
    GridRecord,
    Manifest,
    RootRecord,
    Statistics,
    decode_manifest,
    encode_manifest,
)


@dataclass(frozen=True, slots=True)
class BakeResult:
    """What a bake did."""

    manifest: Manifest
    seconds: float
    cells_rebuilt: int


def bake(
    scene: Scene,
    store: Store,
    options: BakeOptions | None = None,
    progress: Progress | None = None,
) -> BakeResult:
    """Bakes `scene` into the world in `store`; what an interrupted bake of the same input had finished is kept.

    Raises InputError when nothing in the scene can be baked, StoreError when the store fails.
    """
    options, progress = options or BakeOptions(), progress or NoProgress()
    begun = time.monotonic()
    for warning in scene.warnings:
        progress.note(warning)
    with crew_of(scene, store, _workers(options)) as crew:
        summaries = survey(crew.survey(len(scene.meshes)), len(scene.meshes), progress)
        plan = make_plan(scene, summaries, options)
        grid = plan.grid
        progress.note(
            f"leaf size {grid.leaf_size:g} m, resolution {grid.resolution} px, "
            f"up to {len(plan.leaves):,} leaves, {grid.top_level + 1} levels"
        )
        tree = bake_tree(BakeJob(scene, summaries, plan, options, options.signature(grid)), crew, progress)
    if not tree.roots:
        raise InputError("nothing to bake: no triangle lies in any cell")
    manifest = _manifest(scene, summaries, plan, options, store, list(tree.roots))
    store.put(KEY, encode_manifest(manifest))
    return BakeResult(manifest, time.monotonic() - begun, tree.rebuilt)


def _workers(options: BakeOptions) -> int:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return options.workers or processors


def _manifest(
    scene: Scene,
    summaries: list[MeshSummary],
    plan: Plan,
    options: BakeOptions,
    store: Store,
    roots: list[BakedCell],
) -> Manifest:
    grid = plan.grid
    return Manifest(
        generation=_generation(store) + 1,
        generator=f"farfield {__version__}",
        name=scene.name,
        crs=scene.crs,
        origin=scene.origin,
        bounds=_bounds(roots),
        grid=GridRecord(grid.leaf_size, grid.resolution, grid.corner, grid.axis_levels),
        directions=tuple(DirectionRecord(d.number, d.vector) for d in options.direction_list()),
        depth_layers=options.depth_layers,
        index_depth=INDEX_DEPTH,
        roots=tuple(RootRecord(str(r.key), r.index) for r in roots),
        credits=scene.credits,
        statistics=_statistics(scene, summaries, Tally.sum(root.tally for root in roots)),
        attributes=_write_attributes(scene, store),
    )


def _generation(store: Store) -> int:
    try:
        return decode_manifest(store.get(KEY), store.location).generation
    except (MissingKeyError, FarfieldError):
        return 0


def _bounds(roots: list[BakedCell]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    boxes = [root.record.entry.bounds for root in roots]
    x0, y0, z0 = (min(b[0][a] for b in boxes) for a in range(3))
    x1, y1, z1 = (max(b[1][a] for b in boxes) for a in range(3))
    return (x0, y0, z0), (x1, y1, z1)


def _statistics(scene: Scene, summaries: list[MeshSummary], tally: Tally) -> Statistics:
    return Statistics(
        triangles=sum(summaries[int(mesh)].triangles for mesh in scene.instances.mesh),
        objects=scene.object_count,
        cells=tally.cells,
        orthoviews=tally.orthoviews,
        tiles=tally.tiles,
        bytes=tally.bytes + sum(size for _, size in tally.meshes),
        source_bytes=scene.source_bytes,
    )


def _write_attributes(scene: Scene, store: Store) -> str | None:
    if not scene.attributes:
        return None
    columns = {column: list(values) for column, values in scene.attributes.items()}
    data = msgspec.json.encode({"objects": scene.object_count, "columns": columns}, enc_hook=_plain)
    name = content_hash(data)
    store.put(f"attributes/{name}", data)
    return name


def _plain(value: object) -> object:
    return value.item() if hasattr(value, "item") else str(value)
