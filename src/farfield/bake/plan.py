"""Which blocks of which instances lie in which leaf, and the grid that suits the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.bake.options import BakeOptions
from farfield.errors import InputError
from farfield.octree.grid import CellKey, Grid, axis_levels_of
from farfield.scene.model import Instances, Scene
from farfield.scene.stored.scene import MeshSummary

MOST_LEAVES = 2000
"""Occupied leaves that the default leaf size allows."""
FEWEST_LEAVES = 8
"""And allows however few triangles there are."""
TRIANGLES_PER_LEAF = 10_000
"""What the default leaf size aims at, at least: fewer are cheaper drawn than the 100,000 pixels of a leaf's pictures.
At 2,000 leaves a statue
of a million triangles would be 68,000 tiles of a few hundred triangles each."""
TRIANGLES_PER_BLOCKMAP = 300
"""The same where there are no orthoviews but BlockMaps: some twenty buildings, whose walls these have room for."""
MOST_BLOCKMAPS = 1 << 18
LARGEST_WORLD = 1 << 20
"""Leaves along an axis beyond which the leaf size is refused as absurd."""
_PAD = 64
"""The corner lies at least 1/64 of a leaf below the scene, so that ground does not lie on a cell plane."""
_SLACK = 2.0**-15
"""Boxes are grown by this share of a leaf, more than clipping rounds (2^-17)."""
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Plan:
    """Rows (leaf, instance, block), sorted by leaf; a leaf's rows are start[i]:start[i + 1]."""

    grid: Grid
    leaves: NDArray[np.int64]
    """(n, 3) int64 leaf indices, ascending; a leaf may turn out to hold nothing after clipping."""
    start: NDArray[np.int64]
    """(n + 1,) int64 into instance and block."""
    instance: NDArray[np.int32]
    block: NDArray[np.int32]
    bounds: NDArray[np.float64]
    """(2, 3) float64 bounds of the block boxes, local metres."""

    def keys(self) -> list[CellKey]:
        """Keys of the leaves, ascending."""
        return [CellKey(0, int(x), int(y), int(z)) for x, y, z in self.leaves]

    def rows(self, leaf: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Instances and blocks of the leaf at that position in `leaves`."""
        rows = slice(int(self.start[leaf]), int(self.start[leaf + 1]))
        return self.instance[rows], self.block[rows]


def make_plan(scene: Scene, summaries: list[MeshSummary], options: BakeOptions) -> Plan:
    """Sorts the scene into leaves of the chosen grid.

    Raises InputError when its extent and the leaf size do not fit together.
    """
    bounds = scene_bounds(scene, summaries)
    size = options.leaf_size or default_leaf_size(scene, summaries, bounds, options.orthoviews)
    reach = float((bounds[1] - bounds[0]).max()) / size
    if not np.isfinite(reach) or reach > LARGEST_WORLD:
        raise InputError(
            f"the scene is {reach:.3g} leaves wide", "", "check its coordinates, or give a larger --leaf-size"
        )
    corner = _corner_below(bounds, size) if options.corner is None else np.array(options.corner)
    leaf, instance, block = _rows(scene, summaries, corner, size)
    order = np.lexsort((block, instance, leaf[:, 2], leaf[:, 1], leaf[:, 0]))
    leaf = leaf[order]
    first = np.ones(len(leaf), bool)
    first[1:] = (leaf[1:] != leaf[:-1]).any(1)
    start = np.append(np.flatnonzero(first), len(leaf))
    levels = axis_levels_of(leaf.min(0), leaf.max(0))
    x, y, z = (float(c) for c in corner)
    grid = Grid(float(size), options.resolution, (x, y, z), levels)
    return Plan(grid, leaf[first], start, instance[order], block[order], bounds)


def scene_bounds(scene: Scene, summaries: list[MeshSummary]) -> NDArray[np.float64]:
    """(2, 3) float64 bounds of all placed blocks. Raises InputError when there are none or they are not finite."""
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for _, _, boxes in _placed_boxes(scene.instances, summaries):
        lower = np.minimum(lower, boxes[:, 0].min(0))
        upper = np.maximum(upper, boxes[:, 1].max(0))
    bounds = np.stack([lower, upper])
    if not np.isfinite(bounds).all():
        raise InputError("the scene has no finite extent", "", "check the transforms of its instances")
    return bounds


def default_leaf_size(
    scene: Scene, summaries: list[MeshSummary], bounds: NDArray[np.float64], orthoviews: bool = True
) -> float:
    """Smallest power of two, in metres, that keeps to MOST_LEAVES occupied leaves and TRIANGLES_PER_LEAF.

    orthoviews: whether there are any; if not, to MOST_BLOCKMAPS and TRIANGLES_PER_BLOCKMAP.
    """
    counts = np.array([summary.triangles for summary in summaries], dtype=np.int64)
    triangles = int((counts * np.bincount(scene.instances.mesh, minlength=len(counts))).sum())
    each = TRIANGLES_PER_LEAF if orthoviews else TRIANGLES_PER_BLOCKMAP
    most = min(MOST_LEAVES if orthoviews else MOST_BLOCKMAPS, max(FEWEST_LEAVES, triangles // each))
    extent = float((bounds[1] - bounds[0]).max())
    exponent = int(np.ceil(np.log2(max(extent, 1e-6))))
    while exponent > -30 and _occupied(scene, summaries, bounds, 2.0 ** (exponent - 1), most) <= most:
        exponent -= 1
        if 2.0**exponent < extent / 4096:
            break
    return 2.0**exponent


def _corner_below(bounds: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    return np.asarray(np.floor(bounds[0] / size * _PAD - 1) * size / _PAD)


def _occupied(scene: Scene, summaries: list[MeshSummary], bounds: NDArray[np.float64], size: float, most: int) -> int:
    corner = _corner_below(bounds, size)
    found: set[int] = set()
    for _, _, boxes in _placed_boxes(scene.instances, summaries):
        lower, upper = _leaf_range(boxes, corner, size)
        counts = np.prod(upper - lower + 1, axis=1)
        if counts.max() > most:
            return most + 1
        cells, _ = _expand(lower, upper)
        code = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        found.update(np.unique(code).tolist())
        if len(found) > most:
            break
    return len(found)


def _placed_boxes(
    instances: Instances, summaries: list[MeshSummary]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
    """Every block of every instance, a portion at a time: (n,) instance, (n,) block, (n, 2, 3) box in local metres."""
    counts = np.array([len(summary.boxes) for summary in summaries], np.int64)
    first = np.cumsum(counts) - counts
    boxes = np.concatenate([summary.boxes for summary in summaries])
    middle, half = boxes.mean(1), (boxes[:, 1] - boxes[:, 0]) / 2
    ends = np.cumsum(counts[instances.mesh])
    begin = 0
    while begin < len(ends):
        done = ends[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(ends, done + _CHUNK, "right")))
        rows = np.arange(begin, stop)
        each = counts[instances.mesh[rows]]
        instance = np.repeat(rows, each)
        block = np.arange(len(instance)) - np.repeat(np.cumsum(each) - each, each)
        box = first[instances.mesh[instance]] + block
        turn = instances.transform[instance]
        centre = np.einsum("nij,nj->ni", turn[:, :, :3], middle[box]) + turn[:, :, 3]
        reach = np.einsum("nij,nj->ni", np.abs(turn[:, :, :3]), half[box])
        if len(instance):
            yield instance, block, np.stack([centre - reach, centre + reach], 1)
        begin = stop


def _leaf_range(
    boxes: NDArray[np.float64], corner: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    lower = np.floor((boxes[:, 0] - corner) / size - _SLACK).astype(np.int64)
    upper = np.floor((boxes[:, 1] - corner) / size + _SLACK).astype(np.int64)
    return lower, upper


def _expand(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All cells of each range, (n, 3), and the row each came from, (n,)."""
    extent = upper - lower + 1
    counts = np.prod(extent, axis=1)
    row = np.repeat(np.arange(len(counts)), counts)
    local = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    e = extent[row]
    z = local % e[:, 2]
    y = local // e[:, 2] % e[:, 1]
    x = local // (e[:, 2] * e[:, 1])
    return lower[row] + np.stack([x, y, z], 1), row


def _rows(
    scene: Scene, summaries: list[MeshSummary], corner: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    leaves, instances, blocks = [], [], []
    for instance, block, boxes in _placed_boxes(scene.instances, summaries):
        cells, row = _expand(*_leaf_range(boxes, corner, size))
        leaves.append(cells)
        instances.append(instance[row].astype(np.int32))
        blocks.append(block[row].astype(np.int32))
    return np.concatenate(leaves), np.concatenate(instances), np.concatenate(blocks)
