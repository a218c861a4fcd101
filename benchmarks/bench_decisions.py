"""Deciding what to send next: processor time among 10,000 candidates, and how near the order is to the best (BEN 5).

    farfield bench decisions [--quick] [--json]

Candidates are pictures of cells, levels of meshes and impostors. A viewer flies over them; it is looked at five times a
second, and between two looks as much is chosen as a link of 250 kB/s takes. Then small cases of two or three objects of
two levels each: what the scheduler's order gives, of what the best of all orders does. Quick: 1,000 and 30 cases.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.octree.grid import CellKey, Grid
from farfield.stream.impostors import Impostors
from farfield.stream.levels import Levels, MeshLevels
from farfield.stream.link import Link
from farfield.stream.motion import Prediction, Viewing
from farfield.stream.offers import Kind, Offers
from farfield.stream.outlook import Outlook
from farfield.stream.pictures import Pictures
from farfield.stream.regions import Regions
from farfield.stream.scheduler import Scheduler

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from scripts.write_stream_vectors import tree_over

from stream.test_scheduler import share_of_the_best, small_case

CANDIDATES, CASES = 10_000, 3_000
LOOKS, LOOK_SECONDS = 50, 0.2
BANDWIDTH, SPEED = 250_000.0, 15.0
LEAF, HEIGHT = 32.0, 60.0
"""Metres: of the cells, and of the flight."""
Floats = NDArray[np.float64]


def run(quick: bool = False) -> dict[str, Any]:
    """Figures."""
    candidates, looks, cases = (1_000, 5, 30) if quick else (CANDIDATES, LOOKS, CASES)
    return times(candidates, looks) | {"small_cases": against_the_best(cases)}


def times(candidates: int, looks: int) -> dict[str, Any]:
    """Processor time of looks and decisions, milliseconds."""
    scene = Scene(candidates)
    link = Link(BANDWIDTH, 0.05)
    scheduler = Scheduler(scene, [scene.cells, scene.levels, scene.impostors], scene.across, link)
    looked: list[float] = []
    decided: list[float] = []
    counts = []
    for n in range(looks):
        now = n * LOOK_SECONDS
        eye = np.array([scene.across * 0.2 + SPEED * now, scene.across * 0.3, HEIGHT])
        seen = Viewing(now, eye, np.array([0.9, 0.3, -0.3]) / 0.995, 60.0, (1280, 720), np.array([SPEED, 0.0, 0.0]))
        _timed(looked, scheduler.follow, seen, now)
        counts.append(scene.offered)
        until, at = now + LOOK_SECONDS, now
        while at < until and (choice := _timed(decided, scheduler.next, at)):
            at += choice.seconds
    return {
        "candidates": round(fmean(counts)),
        "decisions": len(decided),
        "decision_ms": _spread(decided),
        "look_ms": _spread(looked),
    }


def against_the_best(cases: int) -> dict[str, Any]:
    """Shares of the best order's total."""
    shares = np.array([share_of_the_best(*small_case(np.random.default_rng(seed))) for seed in range(cases)])
    below = {f"below_{limit}": int((shares < limit).sum()) for limit in (0.9, 0.95)}
    return {"cases": cases, "mean": round(float(shares.mean()), 4), "worst": round(float(shares.min()), 4)} | below


class Scene:
    """A plain of cells, with objects on it that have levels and impostors."""

    def __init__(self, candidates: int) -> None:
        random = np.random.default_rng(7)
        # Measured: a cell in the cut is offered some nine times with those above it, an object some six times.
        side = int(np.sqrt(candidates / 8))
        levels = int(np.ceil(np.log2(side)))
        grid = Grid(LEAF, 128, (0.0, 0.0, 0.0), (levels, levels, 0))
        leaves = {CellKey(0, x, y, 0) for x in range(side) for y in range(side)}
        self.across = side * LEAF
        self._regions = Regions(tree_over(grid, leaves, random))
        count = candidates // 6
        low = np.column_stack([random.uniform(0, self.across, (count, 2)), np.zeros(count)])
        self._places = np.concatenate([low, low + random.uniform(2, 12, (count, 3))], axis=1)
        meshes = [_mesh(random) for _ in range(count)]
        # Cells come behind the objects: how many there are changes from look to look.
        self.levels = _Counted(Levels(meshes, np.arange(count, dtype=np.int32)), slice(None, count))
        self.impostors = _Counted(Impostors(self._places), slice(None, count))
        self.cells = _Counted(Pictures(self._regions), slice(count, None))

    @property
    def offered(self) -> int:
        """Candidates of the last look."""
        return sum(kind.offered for kind in (self.cells, self.levels, self.impostors))

    def boxes(self, prediction: Prediction, seconds: float) -> Floats:
        """See farfield.stream.offers.Objects."""
        return np.concatenate([self._places, self._regions.boxes(prediction, seconds)])

    def importance(self, outlook: Outlook) -> NDArray[np.float32]:
        """See farfield.stream.offers.Objects."""
        count = len(self._places)
        of_cells = self._regions.importance(replace(outlook, visible=outlook.visible[count:]))
        return np.concatenate([np.ones(count, np.float32), of_cells])


@dataclass(slots=True)
class _Counted:
    """A kind that shows some of all objects, as it would if they were the only ones."""

    kind: Kind
    own: slice
    offered: int = 0

    def offers(self, outlook: Outlook) -> Offers:
        found = self.kind.offers(self._part(outlook))
        self.offered = len(found.sizes)
        return replace(found, objects=(found.objects + (self.own.start or 0)).astype(np.int32))

    def shown(self, outlook: Outlook, best: NDArray[np.float32]) -> None:
        self.kind.shown(self._part(outlook), best[self.own])

    def take(self, item: int) -> object:
        return self.kind.take(item)

    def _part(self, outlook: Outlook) -> Outlook:
        own = {name: getattr(outlook, name)[self.own] for name in ("visible", "whole", "height")}
        return replace(outlook, **own)


def _mesh(random: np.random.Generator) -> MeshLevels:
    """Three levels, of some 25 bytes a face."""
    few = int(random.integers(30, 200))
    faces = (few, 6 * few, 40 * few)
    return MeshLevels(faces, tuple(25 * number for number in faces))


def _timed(times: list[float], call: Callable[..., Any], *args: Any) -> Any:
    begun = process_time()
    found = call(*args)
    times.append(process_time() - begun)
    return found


def _spread(seconds: list[float]) -> dict[str, float]:
    """Milliseconds."""
    high = float(np.quantile(seconds, 0.99))
    return {"mean": round(1e3 * fmean(seconds), 3), "p99": round(1e3 * high, 3)}


if __name__ == "__main__":
    print(json.dumps(run(), indent=1))
