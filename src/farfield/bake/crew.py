"""Who does the work of a bake: this process alone, worker processes, or a cluster (bake.cluster)."""

from __future__ import annotations

import multiprocessing
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from farfield.bake.context import BakeJob
from farfield.bake.survey import Surveyed
from farfield.bake.worker import Branch, Outcome, Worker, bake_here, begin_worker, pack_job, survey_here
from farfield.errors import MissingExtraError, WorldError
from farfield.octree.grid import CellKey
from farfield.scene.model import Scene
from farfield.store.contract import Store

_LOST = (
    'give it more memory or fewer --workers, and in a script bake below `if __name__ == "__main__"`; '
    "baking again goes on where it was"
)


_FEW_LEAVES, _FEW_TRIANGLES, _FEW_MESHES = 8, 4_000_000, 8
"""For each worker: what is done here sooner than processes are begun, which takes some three seconds with kernels."""


class Crew(Protocol):
    """Does pieces of work, in any order and place; the bytes that come of it are the same."""

    size: int
    """How many pieces are done at a time."""

    def survey(self, meshes: Sequence[int]) -> Iterator[Surveyed]:
        """Surveys the meshes of these numbers, in that order."""
        ...

    def begin(self, job: BakeJob) -> None:
        """Hands out what every branch needs."""
        ...

    def give(self, branch: Branch) -> None:
        """Adds a branch to the work; subtrees given earlier are begun earlier."""
        ...

    def done(self) -> Iterator[Outcome]:
        """The branches as they are finished, until none is left; more may be given meanwhile.

        Raises WorldError when the work cannot go on because workers die, and what the work itself raises.
        """
        ...


@contextmanager
def crew_of(scene: Scene, store: Store, workers: int, scheduler: str = "") -> Iterator[Crew]:
    """The crew for a number of workers; 1: this process. When the block fails, what they have in hand is dropped.

    scheduler: address of a Dask scheduler, whose workers do the work instead. Raises MissingExtraError, and what
    `bake.cluster.cluster_at` raises.
    """
    if scheduler:
        with _cluster(scene, store, scheduler) as cluster:
            yield cluster
    elif workers <= 1:
        yield Alone(scene, store)
    else:
        with _processes(scene, store, workers) as processes:
            yield processes


def _cluster(scene: Scene, store: Store, scheduler: str) -> AbstractContextManager[Crew]:
    try:
        from farfield.bake.cluster import cluster_at
    except ModuleNotFoundError as error:
        raise MissingExtraError("a cluster needs Dask.distributed", "cluster", scheduler) from error
    return cluster_at(scene, store, scheduler)


@contextmanager
def _processes(scene: Scene, store: Store, workers: int) -> Iterator[Crew]:
    with tempfile.TemporaryDirectory(prefix="farfield-") as folder:
        crew = Processes(scene, store, workers, Path(folder) / "job")
        try:
            yield crew
        except BrokenProcessPool:
            raise WorldError("a worker process was killed", "", _LOST) from None
        except BaseException:
            crew.drop()
            raise
        finally:
            crew.dismiss()


@contextmanager
def _starting() -> Iterator[None]:
    """While processes are started. They never hear Ctrl-C, which a terminal tells to all: this one answers for them.

    Here Ctrl-C and SIGTERM wait for the end, for a process that is only half started complains of it. Blocking them
    is not enough: a thread of some library takes the signal, and Python still interrupts the main one.
    """
    heard: list[int] = []
    handlers = _interrupting_handlers()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    for number in handlers:
        signal.signal(number, lambda number, _: heard.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    for late in heard:
        signal.raise_signal(late)


def _interrupting_handlers() -> dict[int, Callable[[int, FrameType | None], Any]]:
    """What Ctrl-C and SIGTERM call; only the main thread is interrupted."""
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[int(number)] = handler
    return handlers


def meshes_at_once(count: int, size: int) -> int:
    """How many of `count` meshes a crew surveys in one piece of work: few, so that all of it end together."""
    return max(1, min(16, count // (4 * size)))


class Alone:
    """This process."""

    size = 1

    def __init__(self, scene: Scene, store: Store, threads: int = 1) -> None:
        self._worker = Worker(scene, store, threads)
        self._given: list[Branch] = []

    def survey(self, meshes: Sequence[int]) -> Iterator[Surveyed]:
        """See `Crew.survey`."""
        return map(self._worker.survey, meshes)

    def begin(self, job: BakeJob) -> None:
        """See `Crew.begin`."""
        self._worker.begin(job)

    def unfinished(self, most: int, triangles: int) -> list[CellKey] | None:
        """See `Worker.unfinished`."""
        return self._worker.unfinished(most, triangles)

    def give(self, branch: Branch) -> None:
        """See `Crew.give`."""
        self._given.append(branch)

    def done(self) -> Iterator[Outcome]:
        """See `Crew.done`."""
        while self._given:
            yield self._worker.bake(self._given.pop(0))


class Processes:
    """Worker processes, started when there is something to share: each takes a second or two to begin."""

    def __init__(self, scene: Scene, store: Store, size: int, job: Path) -> None:
        self.size = size
        self._scene = scene
        self._store = store
        self._job = job
        self._spawn = multiprocessing.get_context("spawn")
        self._lifeline, self._held_end = self._spawn.Pipe(duplex=False)
        # Two threads for each processor: one waits for the disk or the interpreter while the other draws.
        self._alone: Alone | None = Alone(scene, store, threads=2 * size)
        self._pool: ProcessPoolExecutor | None = None
        self._pending: set[Future[Outcome]] = set()

    def survey(self, meshes: Sequence[int]) -> Iterator[Surveyed]:
        """See `Crew.survey`."""
        if len(meshes) <= _FEW_MESHES * self.size and self._alone is not None:
            return self._alone.survey(meshes)
        pool = self._started()
        with _starting():
            return pool.map(survey_here, meshes, chunksize=meshes_at_once(len(meshes), self.size))

    def begin(self, job: BakeJob) -> None:
        """See `Crew.begin`. A few leaves are baked here, in threads, before processes would have begun."""
        if self._alone is not None:
            self._alone.begin(job)
            if self._alone.unfinished(_FEW_LEAVES * self.size, _FEW_TRIANGLES * self.size) is not None:
                return
        self._started()
        self._job.write_bytes(pack_job(job))

    def give(self, branch: Branch) -> None:
        """See `Crew.give`."""
        if self._alone is not None:
            self._alone.give(branch)
        else:
            with _starting():
                self._pending.add(self._started().submit(bake_here, self._job, branch))

    def done(self) -> Iterator[Outcome]:
        """See `Crew.done`."""
        if self._alone is not None:
            yield from self._alone.done()
        while self._pending:
            finished, self._pending = wait(self._pending, return_when=FIRST_COMPLETED)
            outcomes: Sequence[Outcome] = [future.result() for future in finished]
            yield from outcomes

    def drop(self) -> None:
        """The processes end at once, as if they were killed: a branch may take minutes, and nobody wants it now."""
        self._held_end.close()

    def dismiss(self) -> None:
        """Ends the processes and waits for that."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._held_end.close()
        self._lifeline.close()

    def _started(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._alone = None
            self._pool = ProcessPoolExecutor(
                self.size,
                self._spawn,
                initializer=begin_worker,
                initargs=(self._scene, self._store, self._lifeline),
            )
        return self._pool
