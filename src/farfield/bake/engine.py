"""Running a bake: subtrees go to the crew, then the cells above them as their children are finished (OV 4.1).

The bytes do not depend on who does what: every cell is made from its own input alone. Tiles stay with the store;
what comes back here of a subtree is its entry and its counts.
"""

from __future__ import annotations

from dataclasses import dataclass

from farfield.bake.cell import BakedCell
from farfield.bake.context import BakeJob
from farfield.bake.crew import Crew
from farfield.bake.estimate import Estimate, estimate, sample_of
from farfield.bake.walk import Children
from farfield.bake.worker import Branch, Outcome
from farfield.octree.grid import CellKey, Grid
from farfield.progress import Progress

BRANCHES = 48
"""Subtrees for each of the crew, about: so many that the last ones end together and progress is told often."""


@dataclass(frozen=True, slots=True)
class Tree:
    """What a bake of the whole tree came to."""

    roots: tuple[BakedCell, ...]
    """Those that hold something, ascending."""
    rebuilt: int
    """Cells baked afresh."""


def bake_tree(job: BakeJob, crew: Crew, progress: Progress) -> Tree:
    """Bakes every cell of a job."""
    grid, leaves = job.plan.grid, job.plan.keys()
    roots, children = tree_of(grid, leaves)
    crew.begin(job)
    sampled = _begin_with_sample(job, crew, children, progress)
    progress.start(len(leaves), "leaf cells baked")
    for task in _subtrees(roots, children, BRANCHES * crew.size):
        crew.give(Branch(task, _below(task, children)))
    finished: dict[CellKey, BakedCell | None] = {}
    for outcome in crew.done():
        finished[outcome.key] = outcome.cell
        progress.advance(outcome.leaves)
        if outcome.key.level < grid.top_level:
            _give_parent(crew, grid.parent(outcome.key), children, finished)
    progress.finish()
    baked = tuple(cell for root in roots if (cell := finished[root]) is not None)
    return Tree(baked, sampled + sum(cell.tally.rebuilt for cell in baked))


def tree_of(grid: Grid, leaves: list[CellKey]) -> tuple[list[CellKey], Children]:
    """Roots, ascending, and the children of every cell above the given leaves."""
    children: dict[CellKey, list[CellKey]] = {}
    level = sorted(leaves)
    for _ in range(grid.top_level):
        above: dict[CellKey, list[CellKey]] = {}
        for key in level:
            above.setdefault(grid.parent(key), []).append(key)
        children |= above
        level = sorted(above)
    return level, {key: tuple(sorted(below)) for key, below in children.items()}


def _begin_with_sample(job: BakeJob, crew: Crew, children: Children, progress: Progress) -> int:
    """Bakes a few families and says what they let expect; how many cells were baked afresh. All find them finished."""
    leaves = [leaf for family in sample_of(job.plan, children, crew.size) for leaf in children[family]]
    progress.start(len(leaves) or None, "leaf cells baked to estimate the rest")
    for leaf in leaves:
        crew.give(Branch(leaf, {}))
    outcomes: list[Outcome] = []
    finished: dict[CellKey, BakedCell | None] = {}
    for outcome in crew.done():
        outcomes.append(outcome)
        finished[outcome.key] = outcome.cell
        progress.advance(outcome.leaves)
        if outcome.key.level == 0:
            _give_parent(crew, job.plan.grid.parent(outcome.key), children, finished)
    progress.finish()
    expected = estimate(job, children, outcomes, crew.size) if outcomes else None
    if expected is not None:
        progress.note(_in_words(expected))
    return sum(o.cell.tally.rebuilt for o in outcomes if o.key.level == 1 and o.cell is not None)


def _in_words(expected: Estimate) -> str:
    minutes = expected.seconds / 60
    time = f"{minutes:,.0f} minutes" if minutes >= 2 else f"{expected.seconds:.0f} s"
    return (
        f"to expect: about {expected.cells:,} cells, {expected.tiles:,} tiles, {expected.bytes / 1e6:,.0f} MB, {time}"
    )


def _subtrees(roots: list[CellKey], children: Children, wanted: int) -> list[CellKey]:
    """Subtree roots of one level: the highest that gives `wanted` of them."""
    tasks = roots
    while len(tasks) < wanted and any(children.get(task) for task in tasks):
        tasks = [child for task in tasks for child in children.get(task, (task,))]
    return tasks


def _below(task: CellKey, children: Children) -> Children:
    """The part of `children` at and below a cell."""
    part: Children = {}
    pending = [task]
    while pending:
        key = pending.pop()
        if key in children:
            part[key] = children[key]
            pending += children[key]
    return part


def _give_parent(crew: Crew, key: CellKey, children: Children, finished: dict[CellKey, BakedCell | None]) -> None:
    """Gives the crew a cell once its children are all finished."""
    if any(child not in finished for child in children[key]):
        return
    below = tuple(cell for child in children[key] if (cell := finished.pop(child)) is not None)
    crew.give(Branch(key, {}, below))


__all__ = ["Tree", "bake_tree", "tree_of"]
