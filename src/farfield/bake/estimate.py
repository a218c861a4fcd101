"""How much a bake will make and how long it will take, told from a few families of cells before the rest is begun.

A family is a cell of level 1 with its leaves. Parents are looked at as well as leaves because they are another thing:
they have no near geometry, are seen from every direction, and take other work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.bake.cell import Tally
from farfield.bake.context import BakeJob
from farfield.bake.plan import Plan
from farfield.bake.walk import Children
from farfield.bake.worker import Outcome
from farfield.octree.grid import CellKey
from farfield.world.index import CellEntry
from farfield.world.reach import geometry_keys

FEWEST_LEAVES = 32
"""Below this the whole is done about as soon as the sample."""
FAMILIES = 16
"""Those that are looked at, or a third where there are few: of a town in sparse country, 8 missed a factor of two in
one choice of eight, 16 in none."""
FEWEST = 4
"""Looked at however few there are."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is to be expected of a bake."""

    cells: int
    tiles: int
    """Of orthoviews."""
    bytes: int
    """As the manifest counts them: of orthoviews, near geometry and shared meshes."""
    seconds: float


def sample_of(plan: Plan, children: Children, workers: int) -> list[CellKey]:
    """Families to begin with: evenly spread over all of them, sorted by how much touches them.

    Each worker gets two, for its first leaf and its first parent take longer: they read the compiled kernels.
    """
    families = [key for key in children if key.level == 1]
    if len(plan.leaves) < FEWEST_LEAVES:
        return []
    weight = dict(zip(plan.keys(), np.diff(plan.start).tolist(), strict=True))
    families.sort(key=lambda family: (sum(weight[leaf] for leaf in children[family]), family))
    chosen = min(len(families), max(FEWEST, min(FAMILIES, len(families) // 3), 2 * workers))
    middles = (np.arange(chosen) + 0.5) / chosen * len(families)
    return sorted(families[int(middle)] for middle in middles)


def estimate(job: BakeJob, children: Children, sampled: Sequence[Outcome], workers: int) -> Estimate | None:
    """From the families of `sample_of`, baked, in the order in which they were done.

    None when they tell nothing: nothing is in them, or an earlier bake had them.
    """
    leaves, parents = _Sample.of(sampled, 0), _Sample.of(sampled, 1)
    tally = Tally.sum(outcome.cell.tally for outcome in sampled if outcome.key.level == 1 and outcome.cell is not None)
    if tally.rebuilt < max(1, tally.cells):
        return None
    planned = len(job.plan.leaves)
    lowest = sum(key.level == 1 for key in children)
    # A cell further up is empty only if all of many leaves are.
    above = lowest * parents.share + len(children) - lowest
    below = planned * leaves.share
    near = _near_bytes(job, leaves) + _mesh_bytes(job, leaves, tally)
    return Estimate(
        cells=round(below + above),
        tiles=round(below * leaves.tiles + above * parents.tiles),
        bytes=round(below * leaves.tile_bytes + above * parents.tile_bytes + near),
        seconds=(planned * leaves.seconds(workers) + len(children) * parents.seconds(workers)) / workers,
    )


@dataclass(frozen=True, slots=True)
class _Sample:
    """What was baked of one level."""

    outcomes: tuple[Outcome, ...]
    """Those of empty cells included."""
    entries: tuple[CellEntry, ...]

    @classmethod
    def of(cls, sampled: Sequence[Outcome], level: int) -> _Sample:
        outcomes = tuple(outcome for outcome in sampled if outcome.key.level == level)
        return cls(outcomes, tuple(outcome.cell.record.entry for outcome in outcomes if outcome.cell is not None))

    @property
    def share(self) -> float:
        """Of planned cells that hold something."""
        return len(self.entries) / len(self.outcomes)

    @property
    def tiles(self) -> float:
        """Of a cell."""
        return sum(len(entry.tiles) for entry in self.entries) / len(self.entries)

    @property
    def tile_bytes(self) -> float:
        """Of a cell."""
        return sum(size for entry in self.entries for _, _, size in entry.tiles) / len(self.entries)

    def seconds(self, workers: int) -> float:
        """Of a planned cell, without the first of each worker where there are others."""
        seconds = [outcome.seconds for outcome in self.outcomes]
        return float(np.mean(seconds[workers:] or seconds))


def _near_bytes(job: BakeJob, leaves: _Sample) -> float:
    """Of the near geometry of all leaves, which grows with what touches them, and so is mostly in the heaviest."""
    weight = np.diff(job.plan.start)[_positions(job.plan, leaves)].sum()
    found = sum(size for entry in leaves.entries for _, size in geometry_keys(entry))
    return found / float(weight) * float(job.plan.start[-1])


def _mesh_bytes(job: BakeJob, leaves: _Sample, tally: Tally) -> float:
    """Of all shared meshes: by triangles, from those that the leaves of the sample refer to."""
    placed = job.scene.instances.mesh
    triangles = np.array([summary.triangles for summary in job.summaries], dtype=np.int64)
    triangles[np.bincount(placed, minlength=len(triangles)) < 2] = 0
    met = np.unique(np.concatenate([placed[job.plan.rows(n)[0]] for n in _positions(job.plan, leaves)]))
    found = sum(size for _, size in tally.meshes)
    return found * float(triangles.sum()) / max(1.0, float(triangles[met].sum()))


def _positions(plan: Plan, leaves: _Sample) -> NDArray[np.int64]:
    """In `plan.leaves`."""
    chosen = {outcome.key for outcome in leaves.outcomes}
    return np.array([n for n, key in enumerate(plan.keys()) if key in chosen], dtype=np.int64)
