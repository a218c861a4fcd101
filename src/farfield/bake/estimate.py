"""How much a bake will make and how long it will take, told from a few leaves before the rest is begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from farfield.bake.cell import Tally
from farfield.bake.plan import Plan
from farfield.bake.worker import Outcome

FEWEST_LEAVES = 16
"""Below this the whole is done about as soon as the sample."""
SHARE, FEWEST, MOST = 0.02, 4, 24
"""Share of the leaves that are looked at, and their least and greatest number."""
PARENT_SECONDS = 0.04
"""For a tile of 512 x 512 pixels, of a cell above the leaves: decoding, compositing, encoding."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is to be expected of a bake."""

    cells: int
    tiles: int
    bytes: int
    seconds: float


def sample_of(plan: Plan) -> list[int]:
    """Positions in `plan.leaves` to begin with: evenly spread over the leaves sorted by how much touches them."""
    count = len(plan.leaves)
    if count < FEWEST_LEAVES:
        return []
    chosen = min(MOST, max(FEWEST, round(count * SHARE)))
    by_weight = np.argsort(np.diff(plan.start), kind="stable")
    middles = (np.arange(chosen) + 0.5) / chosen * count
    return sorted(int(row) for row in by_weight[middles.astype(np.int64)])


def estimate(plan: Plan, parents: int, sampled: Sequence[Outcome], workers: int) -> Estimate | None:
    """From the leaves of `sample_of`, baked. None when they tell nothing: none was baked, or an earlier bake had them.

    parents: cells above the leaves. A parent's tiles are about as large as a leaf's: they have as many pixels.
    """
    tally = Tally.sum(outcome.cell.tally for outcome in sampled if outcome.cell is not None)
    if not sampled or tally.rebuilt < max(1, tally.cells):
        return None
    # The slowest of each worker also read the compiled kernels: they are left out when there is enough else.
    seconds = sorted(outcome.seconds for outcome in sampled)
    kept = len(seconds) - workers if len(seconds) > 2 * workers else len(seconds)
    leaf = float(np.mean(seconds[:kept]))
    share = tally.cells / len(sampled)
    leaves = len(plan.leaves) * share
    tiles = tally.tiles / tally.cells
    pixels = (plan.grid.resolution / 512) ** 2
    return Estimate(
        cells=round(leaves + parents),
        tiles=round((leaves + parents) * tiles),
        bytes=round((leaves + parents) * tally.bytes / tally.cells),
        seconds=(len(plan.leaves) * leaf + parents * tiles * pixels * PARENT_SECONDS) / workers,
    )
