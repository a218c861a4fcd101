"""A bake whose work is done by the workers of a Dask.distributed cluster (OV 4.1).

The workers share the store. The one that makes a view writes it there and keeps it in memory (`bake.kept`); the cell
above goes to the worker that made most of what is below it, unless that one is behind and another has nothing to do.
So a view crosses the network once on its way into the store, and at most once more, when the cell above it is
composited elsewhere. Views are not results that Dask moves: those it sends as soon as it has chosen a worker, again
when an idle one takes the task over, and computes afresh when they are lost with their worker. Here a lost worker
costs the branches in its hands, of which the cells that are finished are found in the store.
"""

from __future__ import annotations

import logging
import os
import socket
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias, TypeVar
from uuid import uuid4

from distributed import CancelledError, Client, Future, KilledWorker, WorkerPlugin
from distributed.comm.core import CommClosedError

from farfield.bake.cell import BakedCell
from farfield.bake.cluster_worker import (
    TOKEN_KEY,
    Expected,
    JobOnWorker,
    SceneOnWorker,
    bake_there,
    differences,
    job_name,
    other_versions,
    survey_there,
    versions,
)
from farfield.bake.context import BakeJob
from farfield.bake.crew import meshes_at_once
from farfield.bake.survey import Surveyed
from farfield.bake.worker import Branch, Outcome, pack_job
from farfield.errors import ClusterError
from farfield.octree.grid import CellKey
from farfield.scene.model import Scene
from farfield.store.contract import Store
from farfield.world.keys import content_hash

T = TypeVar("T")

Arrivals: TypeAlias = "SimpleQueue[Future[Any]]"
"""Tasks as they are done."""

CONNECT_WITHIN = 10.0
"""Seconds for the scheduler to answer."""
JOIN_WITHIN = 15.0
"""Seconds for a first worker to be there at the beginning."""
ALONE_FOR = 300.0
"""Seconds that a bake waits for new workers once it has lost all: a batch system may need minutes to start one."""
LOOK_EVERY = 5.0
"""Seconds without a finished branch after which it is looked whether there are workers at all."""
MOST_FILES = 1000
"""Source files that each worker looks for; of more, an even choice."""

_GUIDE = "docs/cluster.md tells how to start a cluster"


@contextmanager
def cluster_at(scene: Scene, store: Store, address: str) -> Iterator[Cluster]:
    """The workers of the scheduler at `address`. At the end, whatever ends it, they forget the bake.

    Raises ClusterError: nothing answers there, there are no workers or no longer any, they have other versions of what
    decides the bytes, they do not see the store or the sources, or a branch has killed one worker after another.
    """
    with _quiet(), _connected(address) as client:
        _check_versions(client, address)
        cluster = Cluster(client, scene, store, address)
        try:
            cluster.hand_out_scene()
            yield cluster
        except KilledWorker as error:
            what = f"{error.allowed_failures + 1} workers died at the same work, {error.last_worker.address} last"
            hint = "give each worker more memory, or take a smaller --leaf-size; baking again goes on where it was"
            raise ClusterError(what, address, hint) from None
        except (CancelledError, CommClosedError):
            what = "the connection to the scheduler was lost"
            raise ClusterError(what, address, "baking again goes on where it was") from None
        finally:
            cluster.dismiss()


class Cluster:
    """See `Crew`."""

    def __init__(self, client: Client, scene: Scene, store: Store, address: str) -> None:
        self.size = max(1, sum(client.nthreads().values()))
        self._client = client
        self._scene = scene
        self._store = store
        self._address = address
        # The same for a bake into the same world, so that it takes the place of one that was killed here.
        self._name = f"farfield-{content_hash(repr((socket.gethostname(), os.getcwd(), store.location)).encode())}"
        self._work = uuid4().hex
        self._given: Counter[str] = Counter()
        self._pending: set[Future[Any]] = set()
        self._arrived: Arrivals = SimpleQueue()
        self._made_by: dict[CellKey, str] = {}
        self._alone_since: float | None = None

    def hand_out_scene(self) -> None:
        """Gives every worker the scene and the store, once it is seen that they reach what it names."""
        expected = Expected(uuid4().bytes, _files(self._scene))
        self._store.put(TOKEN_KEY, expected.token)
        scene = replace(self._scene, attribute_parts=(), warnings=())
        self._hand_out(SceneOnWorker(scene, self._store, expected), self._name)

    def survey(self, meshes: Sequence[int]) -> Iterator[Surveyed]:
        """See `Crew.survey`."""
        step = meshes_at_once(len(meshes), self.size)
        parts = [list(meshes[first : first + step]) for first in range(0, len(meshes), step)]
        futures = self._client.map(survey_there, parts, bake=self._name, pure=False)
        arrived: Arrivals = SimpleQueue()
        for future in futures:
            self._expect(future, arrived)
        for future in futures:
            while not future.done():
                self._next(arrived)
            yield from self._taken(future)

    def begin(self, job: BakeJob) -> None:
        """See `Crew.begin`."""
        self._hand_out(JobOnWorker(pack_job(job)), job_name(self._name))

    def give(self, branch: Branch) -> None:
        """See `Crew.give`. Cells above finished ones go first: what is kept for them is soon free again."""
        makers = self._makers(branch.finished or ())
        group = "above" if branch.finished else "subtree"
        self._given[group] += 1
        future = self._client.submit(
            bake_there,
            branch,
            bake=self._name,
            # Of one group, so that Dask does not deal out more subtrees than there are threads to take them.
            key=(f"farfield-{group}-{self._work}", self._given[group]),
            priority=branch.key.level if branch.finished else 0,
            workers=makers or None,
            allow_other_workers=bool(makers),
        )
        self._expect(future, self._arrived)

    def done(self) -> Iterator[Outcome]:
        """See `Crew.done`."""
        while self._pending:
            maker, outcome = self._taken(self._next(self._arrived))
            if outcome.cell is not None:
                self._made_by[outcome.key] = maker
            yield outcome

    def dismiss(self) -> None:
        """Takes back what is not done, and the scene and the job."""
        with suppress(Exception):  # What went wrong before is what matters, and the cluster may be gone.
            self._store.delete(TOKEN_KEY)
        if self._client.status == "running":
            with suppress(Exception):
                self._client.cancel(list(self._pending), force=True)
            for name in (self._name, job_name(self._name)):
                with suppress(Exception):
                    self._client.unregister_worker_plugin(name)

    def _makers(self, finished: tuple[BakedCell, ...]) -> list[str]:
        """Address of the worker that made most bytes of the finished cells, if it is known."""
        made: Counter[str] = Counter()
        for cell in finished:
            maker = self._made_by.pop(cell.key, None)
            if maker is not None:
                made[maker] += sum(size for _, _, size in cell.record.entry.tiles) + cell.record.object_bytes
        return [maker for maker, _ in made.most_common(1)]

    def _hand_out(self, plugin: WorkerPlugin, name: str) -> None:
        try:
            self._client.register_plugin(plugin, name=name)
        except OSError as error:
            what = f"a worker was lost while it was told what to bake: {error}"
            raise ClusterError(what, self._address, "bake again") from None

    def _expect(self, future: Future[Any], arrived: Arrivals) -> None:
        self._pending.add(future)
        future.add_done_callback(arrived.put)

    def _next(self, arrived: Arrivals) -> Future[Any]:
        """Waits for the next task that is done, in whatever way. Raises ClusterError: nobody is there to do it."""
        while True:
            try:
                future = arrived.get(timeout=LOOK_EVERY)
            except Empty:
                self._look_for_workers()
            else:
                self._alone_since = None
                return future

    def _taken(self, future: Future[T]) -> T:
        """The result of a task that is done, which the cluster may forget then. Raises what the task raised."""
        result = future.result()
        self._pending.discard(future)
        future.release()
        return result

    def _look_for_workers(self) -> None:
        if self._client.status != "running":
            raise CancelledError
        try:
            workers = self._client.nthreads()
        except OSError:
            raise CancelledError from None
        if workers:
            self._alone_since = None
            return
        self._alone_since = self._alone_since or time.monotonic()
        if time.monotonic() - self._alone_since >= ALONE_FOR:
            hint = f"start some: {_worker_command(self._address)}; baking again goes on where it was"
            raise ClusterError("no worker is left", self._address, hint)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask logs on stderr what goes wrong in the background too; here it is one error, told once."""
    loggers = [logging.getLogger(f"distributed.{name}") for name in ("client", "core", "comm", "batched")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """A client of a scheduler that has workers."""
    try:
        with warnings.catch_warnings():
            # Versions are compared below, those that matter.
            warnings.simplefilter("ignore")
            client = Client(address, timeout=CONNECT_WITHIN, set_as_default=False, name="farfield")
    except (OSError, ValueError, TypeError, ImportError) as error:
        what = "no scheduler answers there" if isinstance(error, OSError) else f"not a scheduler's address: {error}"
        raise ClusterError(what, address, f"start one: dask scheduler; {_GUIDE}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=JOIN_WITHIN)
        except TimeoutError:
            hint = f"start some: {_worker_command(address)}"
            raise ClusterError("the scheduler has no workers", address, hint) from None
        yield client


def _worker_command(address: str) -> str:
    return f"dask worker {address} --nthreads 1 --nworkers -1"


def _check_versions(client: Client, address: str) -> None:
    """Raises ClusterError when the scheduler or a worker has other versions, or no farfield at all."""
    found: dict[str, Any] = {}
    try:
        found["the scheduler"] = client.run_on_scheduler(versions)
    except Exception as error:
        found["the scheduler"] = error
    found |= {f"the worker {worker}": each for worker, each in client.run(versions, on_error="return").items()}
    here = versions()
    for who, theirs in found.items():
        if isinstance(theirs, Exception):
            hint = f"install it there as here: pip install 'farfield[cluster]=={here['farfield']}'"
            raise ClusterError(f"{who} cannot load farfield: {theirs}", address, hint)
        if other := differences(theirs, here):
            raise other_versions(who, other)


def _files(scene: Scene) -> tuple[tuple[Path, int], ...]:
    """Files that the scene's meshes are read from, and their bytes; sources that name none are in the scene itself."""
    found = {path for source in scene.meshes if isinstance(path := getattr(source, "path", None), Path)}
    paths = sorted(path for path in found if path.is_file())
    chosen = paths[:: max(1, -(-len(paths) // MOST_FILES))]
    return tuple((path, path.stat().st_size) for path in chosen)
