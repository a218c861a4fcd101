"""Baking a scene into a world."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from farfield import __version__
from farfield.bake.cell import BakedCell, Tally
from farfield.bake.context import BakeJob
from farfield.bake.crew import crew_of
from farfield.bake.engine import Tree, bake_tree
from farfield.bake.index import INDEX_DEPTH
from farfield.bake.numbering import object_ids
from farfield.bake.options import BAKE_VERSION, BakeOptions
from farfield.bake.partition import partition
from farfield.bake.plan import Plan, make_plan
from farfield.bake.survey import survey
from farfield.errors import CorruptTileError, FarfieldError, InputError
from farfield.progress import NoProgress, Progress
from farfield.scene.model import Scene
from farfield.scene.stored.scene import MeshSummary, read_scene_of, write_scene
from farfield.scene.stored.sources import print_of
from farfield.store.contract import Store
from farfield.world.attributes import AttributeIndex, encode_attribute_index
from farfield.world.keys import attributes_key, content_hash
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

NEAR_OF_MAPS = 0.25
"""Of r, within which leaves are geometry where there are BlockMaps alone: a texel of 2 m is a pixel from 2 km on, and
geometry of all that is nearer 900 leaves. Beyond, it comes as far as it shows more for its bytes."""


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

    Raises InputError when nothing in the scene can be baked, StoreError when the store fails or another bake is
    writing to it, WorldError when workers die (ClusterError for anything that is wrong with a cluster).
    """
    with store.writing():
        return bake_held(scene, store, options or BakeOptions(), progress or NoProgress())


def bake_held(scene: Scene, store: Store, options: BakeOptions, progress: Progress) -> BakeResult:
    """`bake` for whoever holds `store.writing()`, and has more to write."""
    begun = time.monotonic()
    for warning in scene.warnings:
        progress.note(warning)
    scene = partition(scene, store, progress)
    prints = [print_of(source) for source in scene.meshes]
    known = _known(store, scene)
    with crew_of(scene, store, _workers(options), options.scheduler) as crew:
        summaries = survey(known, crew.survey, progress)
        write_scene(store, scene, summaries, prints, BAKE_VERSION)
        plan = make_plan(scene, summaries, options)
        progress.note(_choices(plan))
        scene = _numbered(scene, summaries, plan)
        job = BakeJob(scene, summaries, plan, options, options.signature(plan.grid))
        tree = bake_tree(job, crew, progress)
    if not tree.roots:
        raise InputError("nothing to bake: no triangle lies in any cell")
    manifest = _write_manifest(store, _manifest(job, store, tree))
    return BakeResult(manifest, time.monotonic() - begun, tree.rebuilt)


def _known(store: Store, scene: Scene) -> list[MeshSummary | None]:
    """What the bake before knew of the meshes of this one."""
    try:
        stored = read_scene_of(store, BAKE_VERSION)
    except CorruptTileError:
        stored = None
    return [None] * len(scene.meshes) if stored is None else stored.known(scene.meshes)


def _numbered(scene: Scene, summaries: list[MeshSummary], plan: Plan) -> Scene:
    """With the ids of its objects, which hold in this grid."""
    contents = [summary.content for summary in summaries]
    first = object_ids(scene.instances, contents, plan.grid)
    return replace(scene, instances=replace(scene.instances, first_object=first))


def _choices(plan: Plan) -> str:
    grid = plan.grid
    return (
        f"leaf size {grid.leaf_size:g} m, resolution {grid.resolution} px, "
        f"up to {len(plan.leaves):,} leaves, {grid.top_level + 1} levels"
    )


def _workers(options: BakeOptions) -> int:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return options.workers or processors


def _manifest(job: BakeJob, store: Store, tree: Tree) -> Manifest:
    scene, grid = job.scene, job.plan.grid
    return Manifest(
        generation=1,
        generator=f"farfield {__version__}",
        name=scene.name,
        crs=scene.crs,
        origin=scene.origin,
        bounds=_bounds(tree.roots),
        grid=GridRecord(grid.leaf_size, grid.resolution, grid.corner, grid.axis_levels),
        directions=tuple(DirectionRecord(d.number, d.vector) for d in job.options.direction_list()),
        depth_layers=job.options.depth_layers,
        near=msgspec.UNSET if job.options.orthoviews else NEAR_OF_MAPS,
        index_depth=INDEX_DEPTH,
        roots=tuple(RootRecord(str(root.key), root.index) for root in tree.roots),
        credits=scene.credits,
        statistics=_statistics(scene, job.summaries, Tally.sum(root.tally for root in tree.roots)),
        attributes=_write_attributes(scene, store),
    )


def _write_manifest(store: Store, manifest: Manifest) -> Manifest:
    """Makes it the world's; a generation is counted only when it differs from the one before."""
    try:
        before = decode_manifest(store.get(KEY), store.location)
    except FarfieldError:
        before = None
    if before is not None:
        same = msgspec.structs.replace(manifest, generation=before.generation)
        if same == before:
            return before
        manifest = msgspec.structs.replace(manifest, generation=before.generation + 1)
    store.put(KEY, encode_manifest(manifest))
    return manifest


def _bounds(roots: Sequence[BakedCell]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    boxes = [root.record.entry.bounds for root in roots]
    x0, y0, z0 = (min(b[0][a] for b in boxes) for a in range(3))
    x1, y1, z1 = (max(b[1][a] for b in boxes) for a in range(3))
    return (x0, y0, z0), (x1, y1, z1)


def _statistics(scene: Scene, summaries: list[MeshSummary], tally: Tally) -> Statistics:
    counts = np.array([summary.triangles for summary in summaries], dtype=np.int64)
    return Statistics(
        triangles=int((counts * np.bincount(scene.instances.mesh, minlength=len(counts))).sum()),
        objects=scene.object_count,
        cells=tally.cells,
        orthoviews=tally.orthoviews,
        tiles=tally.tiles,
        bytes=tally.bytes + sum(size for _, size in tally.meshes),
        source_bytes=scene.source_bytes,
    )


def _write_attributes(scene: Scene, store: Store) -> str | None:
    """The index of the tables that the partition stored."""
    own = scene.instances
    rows = zip(own.first_object.tolist(), own.objects.tolist(), scene.attribute_parts, strict=True)
    parts = tuple(sorted(row for row in rows if row[2]))
    if not parts:
        return None
    data = encode_attribute_index(AttributeIndex(scene.object_count, parts))
    name = content_hash(data)
    store.put(attributes_key(name), data)
    return name
