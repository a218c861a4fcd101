"""What a Dask worker does in a bake on a cluster; `bake.cluster` tells it to.

The scene and the job reach each worker once, as plugins: a worker that joins later gets them too.
"""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from distributed import Worker as DaskWorker
from distributed import WorkerPlugin, get_worker

from farfield import __version__
from farfield.bake.context import BakeJob
from farfield.bake.survey import Surveyed
from farfield.bake.worker import Branch, Outcome, Worker, unpack_job
from farfield.errors import ClusterError, MissingKeyError
from farfield.scene.model import Scene
from farfield.store.contract import Store

TOKEN_KEY = "record/cluster"
"""Where the client writes something for the workers to find."""

SEEN_WITHIN = 5.0
"""Seconds until a worker sees what the client has written: shared file systems may be late."""

_PACKAGES = ("numpy", "numba", "pillow", "DracoPy", "trimesh", "shapely", "mapbox-earcut")
"""Those whose version may decide what bytes are baked."""


def versions() -> dict[str, str]:
    """What has to be the same on every machine of a cluster."""
    own = {"farfield": __version__, "Python": f"{sys.version_info.major}.{sys.version_info.minor}"}
    return own | {name: _version(name) for name in _PACKAGES}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


def differences(theirs: dict[str, str], here: dict[str, str]) -> str:
    """How the `versions` of another machine differ from those here; empty: in nothing."""
    return ", ".join(f"{name} {theirs.get(name)} (here {own})" for name, own in here.items() if theirs.get(name) != own)


def other_versions(who: str, differences: str) -> ClusterError:
    """What is raised about them."""
    hint = "install the same versions everywhere, or the bytes could differ"
    return ClusterError(f"{who} has {differences}", "", hint)


@dataclass(frozen=True, slots=True)
class Expected:
    """What the client has and sees, and every worker must have and see too."""

    token: bytes
    """Value of TOKEN_KEY in the store."""
    files: tuple[tuple[Path, int], ...] = ()
    """Source files and their bytes."""
    versions: dict[str, str] = field(default_factory=versions)


class SceneOnWorker(WorkerPlugin):
    """The scene and the store on one Dask worker. Each thread has a `Worker` of its own, with its own caches."""

    def __init__(self, scene: Scene, store: Store, expected: Expected) -> None:
        self._scene = scene
        self._store = store
        self._expected = expected

    async def setup(self, worker: DaskWorker) -> None:
        """Looks whether versions, store and sources are as expected. Raises ClusterError; StoreError from the store."""
        # Here and not in __init__, which runs on the client: a lock cannot be sent.
        self._lock = threading.Lock()
        self._threads: dict[int, Worker] = {}
        self._job: BakeJob | None = None
        self._problem: Exception | None = None
        try:
            await asyncio.to_thread(self._look, str(worker.contact_address))
        except Exception as error:
            # Dask lets a worker that joins later in, whatever is wrong with it: its first task says so.
            self._problem = error
            raise

    def teardown(self, worker: DaskWorker) -> None:
        """The bake is over, done or not: branches in hand end soon."""
        with self._lock:
            for each in self._threads.values():
                each.stop()

    def here(self) -> Worker:
        """The `Worker` of this thread."""
        if self._problem is not None:
            raise self._problem
        thread = threading.get_ident()
        with self._lock:
            if thread not in self._threads:
                self._threads[thread] = Worker(self._scene, self._store)
            return self._threads[thread]

    def job(self, packed: bytes) -> BakeJob:
        """The job, which the threads share."""
        with self._lock:
            self._job = self._job or unpack_job(self._scene, packed)
            return self._job

    def _look(self, address: str) -> None:
        if other := differences(versions(), self._expected.versions):
            raise other_versions(f"the worker {address}", other)
        deadline = time.monotonic() + SEEN_WITHIN
        while not self._sees_token():
            if time.monotonic() > deadline:
                what = f"the worker {address} does not see this world"
                hint = "bake into a bucket, or a folder that all machines share under the same path"
                raise ClusterError(what, self._store.location, hint)
            time.sleep(0.2)
        for path, size in self._expected.files:
            if not _is_here(path, size):
                hint = "put the sources where all machines read the same files under the same path"
                raise ClusterError(f"the worker {address} does not see this source", str(path), hint)

    def _sees_token(self) -> bool:
        try:
            return self._store.get(TOKEN_KEY) == self._expected.token
        except MissingKeyError:
            return False


class JobOnWorker(WorkerPlugin):
    """The job on a Dask worker, as `pack_job` gave it."""

    def __init__(self, packed: bytes) -> None:
        self.packed = packed


def _is_here(path: Path, size: int) -> bool:
    try:
        with open(path, "rb") as file:
            return file.seek(0, 2) == size
    except OSError:
        return False


def survey_there(meshes: list[int], *, bake: str) -> list[Surveyed]:
    """`Worker.survey` of several meshes; bake: name of the plugins."""
    worker = _scene_of(bake).here()
    return [worker.survey(mesh) for mesh in meshes]


def bake_there(branch: Branch, *, bake: str) -> tuple[str, Outcome]:
    """`Worker.bake`, and the address of the Dask worker that did it."""
    dask, scene = get_worker(), _scene_of(bake)
    worker = scene.here()
    if not worker.begun:
        job = dask.plugins[job_name(bake)]
        assert isinstance(job, JobOnWorker)
        worker.begin(scene.job(job.packed))
    return str(dask.contact_address), worker.bake(branch)


def job_name(bake: str) -> str:
    """Name of the plugin that holds the job of a bake; that of the scene is the bake's own name."""
    return f"{bake}-job"


def _scene_of(bake: str) -> SceneOnWorker:
    scene = get_worker().plugins[bake]
    assert isinstance(scene, SceneOnWorker)
    return scene
