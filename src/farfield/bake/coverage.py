"""How much of a scene each preset of directions misses (OV 4.1), so that one can be chosen before a long bake.

A sample of the leaves is looked at from many directions; every pixel seen there is a piece of visible surface. A
direction sees it when nothing of the leaf lies in front and it looks at the surface at most `theta` from the
perpendicular. What no direction of a preset sees is a hole in the far field, or is filled by second depth layers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.bake.context import BakeContext, BakeJob, LeafMaterials
from farfield.bake.options import BakeOptions
from farfield.bake.plan import make_plan
from farfield.bake.survey import MeshCache, survey, survey_mesh
from farfield.errors import InputError
from farfield.geometry.directions import PRESETS, Direction, parse, principal
from farfield.kernels.coverage import mark_seen, sample_layer
from farfield.octree.grid import CellKey, Grid
from farfield.progress import NoProgress, Progress
from farfield.represent.chunk import Chunk, merge
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.leaf import draw_leaf
from farfield.scene.model import Scene
from farfield.store.memory import MemoryStore

TOLERANCE = 2.0
"""Pixels between a point and the surface that a view shows there, within which they are the same."""


@dataclass(frozen=True, slots=True)
class CoverageOptions:
    """How presets are judged."""

    theta: float = 55.0
    """Largest angle between a surface's normal and the direction that sees it, degrees."""
    leaf_size: float | None = None
    """Metres; None: as the bake would choose."""
    resolution: int = 128
    """Pixels across a leaf; a quarter of a bake's is enough for shares."""
    leaves: int = 64
    """Most leaves looked at, chosen evenly."""
    eyes: int = 32
    """Directions they are looked at from, spread over the upper half of the sphere."""
    directions: str | None = None
    """A set of directions to judge beside the presets, as `parse` reads it."""


def judge_presets(
    scene: Scene, options: CoverageOptions | None = None, progress: Progress | None = None
) -> dict[str, float]:
    """Name of each preset -> share (0..1) of the visible surface that none of its directions sees.

    Raises InputError when nothing is visible, OptionError for directions that are none.
    """
    options, progress = options or CoverageOptions(), progress or NoProgress()
    named = _named_sets(options)
    candidates = {d.number: d for chosen in named.values() for d in chosen}
    context = _context(scene, options, progress)
    leaves = _evenly(context.job.plan.keys(), options.leaves)
    progress.start(len(leaves), "leaves looked at")
    unseen, total = dict.fromkeys(named, 0), 0
    for key in leaves:
        seen = _seen_in(context, key, candidates, options)
        total += len(seen)
        for name, chosen in named.items():
            unseen[name] += int(np.count_nonzero(seen & _bits(candidates, chosen) == 0))
        progress.advance()
    if total == 0:
        raise InputError("nothing visible in the leaves looked at")
    return {name: count / total for name, count in unseen.items()}


def _named_sets(options: CoverageOptions) -> dict[str, tuple[Direction, ...]]:
    named = {name: tuple(principal(n) for n in numbers) for name, numbers in PRESETS.items()}
    if options.directions is not None:
        named[options.directions] = parse(options.directions)
    return named


def _context(scene: Scene, options: CoverageOptions, progress: Progress) -> BakeContext:
    meshes = MeshCache(scene)
    sources = scene.meshes
    summaries = survey(
        [None] * len(sources), lambda wanted: (survey_mesh(meshes, mesh, sources[mesh]) for mesh in wanted), progress
    )
    bake = BakeOptions(leaf_size=options.leaf_size, resolution=options.resolution, geometry=False)
    plan = make_plan(scene, summaries, bake)
    return BakeContext(BakeJob(scene, summaries, plan, bake, bake.signature(plan.grid)), MemoryStore(), meshes)


def _evenly(keys: Sequence[CellKey], most: int) -> list[CellKey]:
    chosen = np.unique(np.linspace(0, len(keys) - 1, min(most, len(keys))).round().astype(int))
    return [keys[int(k)] for k in chosen]


def _bits(candidates: Mapping[int, Direction], chosen: Sequence[Direction]) -> np.uint64:
    place = {number: k for k, number in enumerate(candidates)}
    return np.uint64(sum(1 << place[d.number] for d in chosen))


def eye_directions(count: int) -> list[Direction]:
    """Directions spread evenly over the upper half of the sphere (a Fibonacci spiral)."""
    found = []
    for k in range(count):
        z = (k + 0.5) / count
        across, angle = math.sqrt(1 - z * z), k * math.pi * (3 - math.sqrt(5))
        found.append(Direction(1000 + k, (across * math.cos(angle), across * math.sin(angle), z)))
    return found


def _seen_in(
    context: BakeContext, key: CellKey, candidates: Mapping[int, Direction], options: CoverageOptions
) -> NDArray[np.uint64]:
    """(n,) uint64: for each visible piece of surface in the leaf the candidates that see it, one bit each."""
    found = _leaf_chunk(context, key)
    if found is None:
        return np.zeros(0, np.uint64)
    chunk, materials = found
    grid, middle = context.grid, context.grid.bounds(key).mean(0)
    pitch = np.float32(grid.pitch(0))
    samples = _visible(chunk, materials, grid, key, middle, options.eyes)
    seen = np.zeros(len(samples), np.uint64)
    for place, direction in enumerate(candidates.values()):
        for layer in draw_leaf(chunk, materials.table, grid, key, direction, 1, 1):
            mark_seen(
                samples, layer.depth, _frame(layer, direction, grid, middle), pitch, TOLERANCE * pitch,
                np.float32(math.cos(math.radians(options.theta))), np.uint64(1 << place), seen,
            )  # fmt: skip
    return seen


def _visible(
    chunk: Chunk, materials: LeafMaterials, grid: Grid, key: CellKey, middle: NDArray[np.float64], eyes: int
) -> NDArray[np.float32]:
    """(n, 8) float32, see sample_layer: what is seen of the leaf, every third pixel in both axes."""
    parts = [np.empty((0, 8), np.float32)]
    for direction in eye_directions(eyes):
        for layer in draw_leaf(chunk, materials.table, grid, key, direction, 1, 1):
            samples = np.empty((int(np.count_nonzero(layer.valid)), 8), np.float32)
            count = sample_layer(
                layer.depth, layer.normal, layer.coverage, layer.connected, _frame(layer, direction, grid, middle),
                np.float32(grid.pitch(0)), 3, 0, 0, samples,
            )  # fmt: skip
            parts.append(samples[:count])
    return np.concatenate(parts)


def _frame(layer: OrthoLayer, direction: Direction, grid: Grid, middle: NDArray[np.float64]) -> NDArray[np.float32]:
    """(4, 3) float32 as sample_layer takes it."""
    axes = direction.axes
    steps = np.array([layer.x, layer.y, layer.depth_base / 8]) * grid.pitch(0)
    origin = axes @ (np.array(grid.corner) - middle) + steps
    return np.concatenate([origin[None], axes]).astype(np.float32)


def _leaf_chunk(context: BakeContext, key: CellKey) -> tuple[Chunk, LeafMaterials] | None:
    instances, blocks = context.job.plan.rows(context.leaf_of[key])
    table = context.job.scene.instances
    materials = context.materials(tuple(np.unique(table.mesh[instances]).tolist()))
    pieces = []
    for instance in np.unique(instances).tolist():
        mesh = int(table.mesh[instance])
        piece = context.meshes.get(mesh).blocks.cell_chunk(
            table.transform[instance], context.grid, (key.x, key.y, key.z), materials.base[mesh], 0,
            blocks[instances == instance],
        )  # fmt: skip
        if piece is not None:
            pieces.append(piece)
    return (merge(pieces), materials) if pieces else None
