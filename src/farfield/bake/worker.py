"""What one process of a bake does: survey meshes, bake subtrees, composite cells above them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from farfield.bake.cell import BakedCell
from farfield.bake.context import BakeContext, BakeJob
from farfield.bake.survey import MeshCache, Surveyed, survey_mesh
from farfield.bake.walk import Children, bake_parent, bake_subtree
from farfield.octree.grid import CellKey
from farfield.scene.model import Scene
from farfield.store.contract import Store


@dataclass(frozen=True, slots=True)
class Branch:
    """A piece of the tree for one process: a subtree from its leaves up, or one cell whose children are finished."""

    key: CellKey
    children: Children
    """Of every cell at and below `key` that is not a leaf."""
    finished: tuple[BakedCell, ...] | None = None
    """The children, ascending, where they are finished; None: bake everything below as well."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a branch."""

    key: CellKey
    cell: BakedCell | None
    """None: nothing is there."""
    leaves: int
    """Leaves of the plan that were visited."""
    seconds: float


class Worker:
    """One process's hold on a bake. Meshes that it surveyed are still at hand when it bakes."""

    def __init__(self, scene: Scene, store: Store) -> None:
        self.scene = scene
        self.store = store
        self.meshes = MeshCache(scene)
        self._context: BakeContext | None = None

    def survey(self, mesh: int) -> Surveyed:
        """What there is to know of one mesh."""
        return survey_mesh(self.meshes, mesh, self.scene.meshes[mesh])

    def begin(self, job: BakeJob) -> None:
        """Takes the job whose branches `bake` is called for."""
        self._context = BakeContext(job, self.store, self.meshes)

    def bake(self, branch: Branch) -> Outcome:
        """Bakes a branch. Its tiles are in the store, and not in what is returned."""
        context = self._context
        assert context is not None, "begin comes first"
        begun, leaves = time.perf_counter(), 0

        def count() -> None:
            nonlocal leaves
            leaves += 1

        if branch.finished is None:
            cell = bake_subtree(context, branch.key, branch.children, count)
        else:
            cell = bake_parent(context, branch.key, branch.finished)
        if cell is not None:
            cell.release()
        return Outcome(branch.key, cell, leaves, time.perf_counter() - begun)


def write_job(path: Path, job: BakeJob) -> None:
    """Writes a job for workers that hold the scene already."""
    rest = (job.summaries, job.plan, job.options, job.signature)
    path.write_bytes(pickle.dumps(rest, protocol=pickle.HIGHEST_PROTOCOL))


_worker: Worker | None = None
_begun: Path | None = None


def begin_worker(scene: Scene, store: Store) -> None:
    """First thing in a worker process."""
    global _worker
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _worker = Worker(scene, store)


def _end_with_parent() -> None:
    """Ends this process when the one that began it is gone: killed, it would leave workers waiting for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def survey_here(mesh: int) -> Surveyed:
    """`Worker.survey` in a worker process."""
    assert _worker is not None
    return _worker.survey(mesh)


def bake_here(job: Path, branch: Branch) -> Outcome:
    """`Worker.bake` in a worker process; job: as `write_job` wrote it, read once."""
    global _begun
    assert _worker is not None
    if job != _begun:
        _worker.begin(BakeJob(_worker.scene, *pickle.loads(job.read_bytes())))
        _begun = job
    return _worker.bake(branch)
