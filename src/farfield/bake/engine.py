"""Running a bake: subtrees go to worker processes, the levels above them are assembled here (OV 4.1).

The bytes do not depend on the number of workers: every cell is made from its own input alone.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from farfield.bake.cell import BakedCell
from farfield.bake.context import BakeContext, BakeJob
from farfield.bake.walk import Children, bake_parent, bake_subtree
from farfield.errors import FarfieldError, WorldError
from farfield.octree.grid import CellKey, Grid
from farfield.progress import Progress
from farfield.store.contract import Store

TASKS_PER_WORKER = 16
"""Subtrees are made small enough that each worker gets about this many, so that the last ones end together."""


_Task = Future[tuple[BakedCell | None, int]]


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


def bake_tree(job: BakeJob, store: Store, workers: int, progress: Progress) -> list[BakedCell]:
    """Bakes every cell; returns the roots that hold something, with the entries of all cells below them."""
    leaves = job.plan.keys()
    roots, children = tree_of(job.plan.grid, leaves)
    progress.start(len(leaves), "leaf cells baked")
    if workers <= 1:
        context = BakeContext(job, store)
        cells = [bake_subtree(context, root, children, progress.advance) for root in roots]
    else:
        cells = _bake_parallel(job, store, workers, roots, children, progress)
    progress.finish()
    return [cell for cell in cells if cell is not None]


def _bake_parallel(
    job: BakeJob, store: Store, workers: int, roots: list[CellKey], children: Children, progress: Progress
) -> list[BakedCell | None]:
    tasks = _tasks(roots, children, workers)
    context = BakeContext(job, store)
    finished: dict[CellKey, BakedCell | None] = {}
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, spawn, initializer=_begin_worker, initargs=(job, store))
    try:
        futures = {pool.submit(_work, task, _below(task, children)): task for task in tasks}
        for future in _as_completed(futures):
            task = futures[future]
            finished[task], leaves = future.result()
            progress.advance(leaves)
            _assemble(context, task, children, finished)
    except BrokenProcessPool:
        hint = "give it more memory or fewer --workers; baking again goes on where it was"
        raise WorldError("a worker process was killed", "", hint) from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return [finished[root] for root in roots]


def _as_completed(futures: dict[_Task, CellKey]) -> Iterator[_Task]:
    pending = set(futures)
    while pending:
        done, pending = wait(pending, return_when=FIRST_COMPLETED)
        yield from sorted(done, key=lambda f: futures[f])


def _tasks(roots: list[CellKey], children: Children, workers: int) -> list[CellKey]:
    """Subtree roots of one level: the highest that gives every worker enough of them."""
    tasks = roots
    while len(tasks) < workers * TASKS_PER_WORKER and any(children.get(t) for t in tasks):
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


def _assemble(
    context: BakeContext, key: CellKey, children: Children, finished: dict[CellKey, BakedCell | None]
) -> None:
    """Composites the ancestors of `key` whose children are all there."""
    grid = context.grid
    while key.level < grid.top_level:
        key = grid.parent(key)
        below = children[key]
        if any(child not in finished for child in below):
            return
        cells = [cell for child in below if (cell := finished.pop(child)) is not None]
        finished[key] = bake_parent(context, key, cells)


_context: BakeContext | None = None


def _begin_worker(job: BakeJob, store: Store) -> None:
    global _context
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _context = BakeContext(job, store)


def _work(task: CellKey, children: Children) -> tuple[BakedCell | None, int]:
    """Bakes one subtree in a worker; the number of leaves it had comes with it."""
    assert _context is not None
    leaves = 0

    def count() -> None:
        nonlocal leaves
        leaves += 1

    try:
        return bake_subtree(_context, task, children, count), leaves
    except FarfieldError as error:
        raise type(error)(error.what, error.where, error.hint) from None


__all__ = ["bake_tree", "tree_of"]
