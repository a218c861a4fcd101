"""What one process of a bake does: survey meshes, bake subtrees, composite cells above them."""

from __future__ import annotations

import os
import pickle
import threading
import time
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path

from farfield.bake.cell import BakedCell
from farfield.bake.context import BakeContext, BakeJob
from farfield.bake.kept import KeptTiles
from farfield.bake.leaf import is_finished
from farfield.bake.survey import MeshCache, Surveyed, survey_mesh
from farfield.bake.walk import Children, bake_parent, bake_subtree
from farfield.octree.grid import CellKey
from farfield.represent.blocks import BLOCK
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


class StoppedError(Exception):
    """The bake that a worker was working for is over."""


class Worker:
    """One process's hold on a bake; for one thread at a time.

    Meshes that it surveyed are still at hand when it bakes, and so are tiles of the branches that it finished.
    """

    def __init__(self, scene: Scene, store: Store, threads: int = 1) -> None:
        self.scene = scene
        self._threads = threads
        self.store = store
        self.meshes = MeshCache(scene)
        self._kept = KeptTiles()
        self._context: BakeContext | None = None
        self._stopped = False

    @property
    def begun(self) -> bool:
        """Whether it has a job."""
        return self._context is not None

    def survey(self, mesh: int) -> Surveyed:
        """What there is to know of one mesh."""
        return survey_mesh(self.meshes, mesh, self.scene.meshes[mesh])

    def begin(self, job: BakeJob) -> None:
        """Takes the job whose branches `bake` is called for."""
        self._context = BakeContext(job, self.store, self.meshes, self._threads)

    def stop(self) -> None:
        """From another thread: the branch in hand ends with StoppedError after its present leaf."""
        self._stopped = True

    def unfinished(self, most: int, triangles: int) -> list[CellKey] | None:
        """The leaves that no earlier bake has finished; None: they are more than `most`, or hold more `triangles`."""
        context, found, blocks = self._context, [], 0
        assert context is not None, "begin comes first"
        for key, position in context.leaf_of.items():
            if is_finished(context, key):
                continue
            found.append(key)
            blocks += len(context.job.plan.rows(position)[1])
            if len(found) > most or blocks * BLOCK > triangles:
                return None
        return found

    def bake(self, branch: Branch) -> Outcome:
        """Bakes a branch. Its tiles are in the store, perhaps still in this process, and not in what is returned."""
        context = self._context
        assert context is not None, "begin comes first"
        begun, leaves = time.perf_counter(), 0

        def count() -> None:
            nonlocal leaves
            leaves += 1
            if self._stopped:
                raise StoppedError

        if branch.finished is None:
            cell = bake_subtree(context, branch.key, branch.children, count)
        else:
            for below in branch.finished:
                self._kept.give_back(below)
            cell = bake_parent(context, branch.key, branch.finished)
        if cell is not None:
            self._kept.take_from(cell)
        return Outcome(branch.key, cell, leaves, time.perf_counter() - begun)


def pack_job(job: BakeJob) -> bytes:
    """A job for workers that hold the scene already."""
    rest = (job.scene.instances, job.summaries, job.plan, job.options, job.signature)
    return pickle.dumps(rest, protocol=pickle.HIGHEST_PROTOCOL)


def unpack_job(scene: Scene, packed: bytes) -> BakeJob:
    """The job again; packed: by `pack_job`, of this scene."""
    instances, *rest = pickle.loads(packed)
    return BakeJob(replace(scene, instances=instances), *rest)


_worker: Worker | None = None
_begun: Path | None = None


def begin_worker(scene: Scene, store: Store, lifeline: Connection) -> None:
    """First thing in a worker process, which ends when the other end of `lifeline` is closed."""
    global _worker
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _worker = Worker(scene, store)


def _end_with(lifeline: Connection) -> None:
    """The system closes the other end when its process is killed, which would leave workers waiting for ever."""
    lifeline.poll(None)
    os._exit(1)


def survey_here(mesh: int) -> Surveyed:
    """`Worker.survey` in a worker process."""
    assert _worker is not None
    return _worker.survey(mesh)


def bake_here(job: Path, branch: Branch) -> Outcome:
    """`Worker.bake` in a worker process; job: a file of what `pack_job` gave, read once."""
    global _begun
    assert _worker is not None
    if job != _begun:
        _worker.begin(unpack_job(_worker.scene, job.read_bytes()))
        _begun = job
    return _worker.bake(branch)
