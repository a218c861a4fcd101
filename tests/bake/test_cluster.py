"""A bake on a Dask cluster of real processes: the bytes of the local bake, whoever dies, and errors of one line."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from bake.clusters import LocalCluster
from bake.scenes import Held, ground, scene_of, village
from bake.test_bake import SMALL, contents
from bake.test_interruptions import records
from farfield.bake import cluster
from farfield.bake import partition as partitioning
from farfield.bake.bake import bake
from farfield.bake.cluster_worker import TOKEN_KEY, Expected, SceneOnWorker, versions
from farfield.bake.options import BakeOptions
from farfield.bake.partition import split_large
from farfield.cli import main
from farfield.errors import ClusterError, MissingExtraError, OptionError, StoreError
from farfield.progress import NoProgress
from farfield.scene.model import Mesh, Scene
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.scene.read import read_scene
from farfield.store.directory import DirectoryStore
from farfield.store.memory import MemoryStore
from scene.stored.large import write_stone

distributed = pytest.importorskip("distributed")


def on(address: str) -> BakeOptions:
    """The small bake, on a cluster."""
    return replace(SMALL, workers=0, scheduler=address)


class Reader(DirectoryStore):
    """Notes beside the store which tiles each process reads."""

    def get(self, key: str) -> bytes:
        """The value."""
        value = super().get(key)
        if key.startswith(("orthoview/", "objects/")):
            with open(f"{self.location}-read-{os.getpid()}", "a", encoding="ascii") as file:
                file.write(f"{key} {len(value)}\n")
        return value


class Watching(NoProgress):
    """Calls something once, after a number of finished leaves."""

    def __init__(self, leaves: int, act: Callable[[], None]) -> None:
        self._left = -1
        self._leaves = leaves
        self._act = act

    def start(self, total: int | None, what: str) -> None:
        """Counting begins."""
        if what == "leaf cells baked":
            self._left = self._leaves

    def advance(self, count: int = 1) -> None:
        """More leaves are done."""
        before, self._left = self._left, self._left - count
        if before > 0 >= self._left:
            self._act()


@pytest.fixture(scope="module")
def local() -> dict[str, bytes]:
    """The village, baked here."""
    store = MemoryStore()
    bake(village(), store, SMALL)
    return contents(store)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    """A scheduler and two workers."""
    made = LocalCluster(tmp_path_factory.mktemp("two"))
    try:
        made.add_worker()
        made.add_worker()
        with distributed.Client(made.address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield made
    finally:
        made.stop()


@pytest.fixture
def spare(tmp_path: Path) -> Iterator[LocalCluster]:
    """A scheduler without workers, which gives a task up when its second worker dies."""
    (tmp_path / "cluster").mkdir()
    made = LocalCluster(tmp_path / "cluster", DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1")
    try:
        yield made
    finally:
        made.stop()


def test_the_bytes_are_those_of_a_local_bake_and_each_view_is_fetched_at_most_once(
    two: LocalCluster, local: dict[str, bytes], tmp_path: Path
) -> None:
    result = bake(village(), Reader(tmp_path / "world"), on(two.address))
    assert contents(DirectoryStore(tmp_path / "world")) == local
    assert result.cells_rebuilt == result.manifest.statistics.cells
    fetched = Counter[str]()
    sizes = dict[str, int]()
    for path in tmp_path.glob("world-read-*"):
        for line in path.read_text().splitlines():
            key, size = line.split()
            fetched[key] += 1
            sizes[key] = int(size)
    whole = sum(len(value) for key, value in local.items() if key.startswith(("orthoview/", "objects/")))
    print(f"views: {whole:,} bytes; fetched by a worker that had not made them: {sum(sizes.values()):,}")
    assert max(fetched.values(), default=0) <= 1
    assert sum(sizes.values()) < 0.6 * whole, "cells go to the worker that made most of what is below them"
    with distributed.Client(two.address, set_as_default=False) as client:
        moved = client.run(lambda dask_worker: dask_worker.state.transfer_incoming_count_total)
    assert set(moved.values()) == {0}, "nothing goes from worker to worker beside that"


def test_pieces_of_a_large_mesh_are_read_by_the_workers(
    two: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(partitioning, "split_large", partial(split_large, limit=10_000, most=300))
    scene, here = read_scene([write_stone(tmp_path / "stone.ply", 12)]), MemoryStore()
    bake(scene, here, replace(SMALL, leaf_size=0.5))
    bake(scene, DirectoryStore(tmp_path / "world"), replace(on(two.address), leaf_size=0.5))
    assert len(list(here.list("record/chunk"))) > 5
    assert contents(DirectoryStore(tmp_path / "world")) == contents(here)


def test_a_worker_killed_in_the_middle_costs_nothing_that_was_finished(
    two: LocalCluster, local: dict[str, bytes], tmp_path: Path
) -> None:
    victim = two.add_worker(threads=2)
    with distributed.Client(two.address, set_as_default=False) as client:
        client.wait_for_workers(3, timeout=60)
    finished: dict[str, int] = {}

    def kill() -> None:
        victim.kill()
        victim.wait()
        finished.update(records(tmp_path / "world"))

    bake(village(), DirectoryStore(tmp_path / "world"), on(two.address), Watching(8, kill))
    after = records(tmp_path / "world")
    assert 8 <= len(finished) < len(after)
    assert {name: after[name] for name in finished} == finished, "no finished cell was baked twice"
    assert contents(DirectoryStore(tmp_path / "world")) == local


def test_from_the_command_line_with_relative_paths(
    two: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_objects(tmp_path / "objects", ObjectsOptions(count=2, triangles=200))
    monkeypatch.chdir(tmp_path)
    words = ["bake", "objects/scene.toml", "--leaf-size", "8", "--resolution", "16", "--directions", "5", "--json"]
    assert main([*words, "-o", "there", "--scheduler", two.address]) == 0, capsys.readouterr().err
    assert main([*words, "-o", "here", "--workers", "1"]) == 0
    assert contents(DirectoryStore("there")) == contents(DirectoryStore("here"))


def test_an_interrupted_bake_leaves_the_cluster_as_it_was(two: LocalCluster, tmp_path: Path) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake(village(), DirectoryStore(tmp_path / "world"), on(two.address), Watching(3, interrupt))
    assert not DirectoryStore(tmp_path / "world").exists(TOKEN_KEY)
    with distributed.Client(two.address, set_as_default=False) as client:
        deadline = time.monotonic() + 20
        while _left_behind(client) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert _left_behind(client) == []


def _left_behind(client: distributed.Client) -> list[str]:
    """Tasks and plugins of a bake that a cluster still has."""
    found = client.run_on_scheduler(lambda dask_scheduler: [*dask_scheduler.tasks, *dask_scheduler.worker_plugins])
    for names in client.run(lambda dask_worker: [*dask_worker.state.tasks, *dask_worker.plugins]).values():
        found += names
    return [str(name) for name in found if "farfield" in str(name)]


class Failing(Held):
    """Cannot be loaded, for a reason that no scene is to blame for."""

    def load(self) -> Mesh:
        """Raises."""
        raise StoreError("is full", "/there", "free some space")


class Deadly(Held):
    """Kills the process that loads it."""

    def load(self) -> Mesh:
        """Does not return."""
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


def one(source: Held) -> Scene:
    """A scene of one mesh."""
    return replace(scene_of((source.mesh, [(0.0, 0.0, 0.0)])), meshes=[source])


def test_an_error_of_the_work_comes_back_as_it_is(two: LocalCluster, tmp_path: Path) -> None:
    with pytest.raises(StoreError) as caught:
        bake(one(Failing(ground(0, 1))), DirectoryStore(tmp_path / "world"), on(two.address))
    assert (caught.value.what, caught.value.where, caught.value.hint) == ("is full", "/there", "free some space")


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    make_objects(tmp_path / "objects", ObjectsOptions(count=2, triangles=200))
    monkeypatch.setattr(cluster, "CONNECT_WITHIN", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        words = ["bake", str(tmp_path / "objects/scene.toml"), "-o", str(tmp_path / "w"), "--scheduler", address]
        assert main(words) == 1
    error = capsys.readouterr().err
    assert f"{address}: no scheduler answers there" in error
    assert error.count("\n") == 1


def test_an_address_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(ClusterError, match="not a scheduler's address"):
        bake(village(), DirectoryStore(tmp_path / "w"), on("gopher://here:70"))


def test_workers_beside_a_scheduler_are_refused() -> None:
    with pytest.raises(OptionError, match="leave it out"):
        BakeOptions(workers=2, scheduler="tcp://127.0.0.1:8786")


def test_without_distributed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("farfield.bake.cluster", "farfield.bake.cluster_worker"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"farfield\[cluster\]"):
        bake(village(), DirectoryStore(tmp_path / "w"), on("tcp://127.0.0.1:8786"))


def look(store: DirectoryStore, expected: Expected) -> None:
    """What a worker does first."""
    worker = SimpleNamespace(contact_address="tcp://there:1")
    asyncio.run(SceneOnWorker(village(), store, expected).setup(worker))  # type: ignore[arg-type]


def test_a_world_or_a_source_that_a_worker_does_not_see(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("farfield.bake.cluster_worker.SEEN_WITHIN", 0.0)
    store = DirectoryStore(tmp_path / "w")
    source = tmp_path / "a.glb"
    source.write_bytes(b"12345")
    with pytest.raises(ClusterError, match="tcp://there:1 does not see this world"):
        look(store, Expected(b"mine"))
    store.put(TOKEN_KEY, b"another's")
    with pytest.raises(ClusterError, match="does not see this world"):
        look(store, Expected(b"mine"))
    store.put(TOKEN_KEY, b"mine")
    look(store, Expected(b"mine", ((source, 5),)))
    with pytest.raises(ClusterError, match=r"has numba .* \(here 0.2\)"):
        look(store, Expected(b"mine", versions=versions() | {"numba": "0.2"}))
    for wrong in ((source, 6), (tmp_path / "b.glb", 5)):
        with pytest.raises(ClusterError, match="does not see this source"):
            look(store, Expected(b"mine", (wrong,)))


class Elsewhere(DirectoryStore):
    """A folder that is another one in other processes."""

    def __reduce__(self) -> tuple[type[DirectoryStore], tuple[str]]:
        return DirectoryStore, (f"{self.location}-of-its-own",)


@pytest.mark.slow
def test_what_a_worker_does_not_see_is_one_error_of_the_bake(two: LocalCluster, tmp_path: Path) -> None:
    with pytest.raises(ClusterError, match="does not see this world"):
        bake(village(), Elsewhere(tmp_path / "w"), on(two.address))


@pytest.mark.slow
@pytest.mark.parametrize(("signalled", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_command_that_is_ended_can_be_given_again(
    two: LocalCluster, tmp_path: Path, signalled: signal.Signals, code: int
) -> None:
    world = tmp_path / "world"
    scene = make_objects(tmp_path / "objects", ObjectsOptions(count=12, triangles=2000)).path
    words = ["--leaf-size", "8", "--resolution", "32", "--directions", "5"]
    line = [sys.executable, "-m", "farfield", "bake", str(scene), *words]
    on_cluster = [*line, "-o", str(world), "--scheduler", two.address]
    with open(tmp_path / "errors", "w") as errors, subprocess.Popen(on_cluster, stderr=errors) as command:
        while len(records(world)) < 20 and command.poll() is None:
            time.sleep(0.02)
        command.send_signal(signalled)
        assert command.wait(timeout=30) == code
    kept = records(world)
    subprocess.run(on_cluster, check=True, capture_output=True)
    after = records(world)
    assert {name: after[name] for name in kept} == kept
    subprocess.run([*line, "-o", str(tmp_path / "here")], check=True, capture_output=True)
    assert contents(DirectoryStore(world)) == contents(DirectoryStore(tmp_path / "here"))
    with distributed.Client(two.address, set_as_default=False) as client:
        assert _left_behind(client) == []
    if signalled == signal.SIGINT:
        assert (tmp_path / "errors").read_text().splitlines()[-1] == "farfield: interrupted"


@pytest.mark.slow
def test_no_workers_and_workers_of_another_kind(
    spare: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "JOIN_WITHIN", 0.5)
    with pytest.raises(ClusterError, match=r"no workers.*dask worker tcp"):
        bake(village(), DirectoryStore(tmp_path / "w"), on(spare.address))
    monkeypatch.setattr(cluster, "JOIN_WITHIN", 60.0)
    for line, expected in (
        ("import farfield; farfield.__version__ = '0.0.0'", r"has farfield 0.0.0 \(here"),
        ("import sys; sys.modules['farfield'] = None", "cannot load farfield"),
    ):
        (tmp_path / "sitecustomize.py").write_text(line)
        spare.add_worker(first=str(tmp_path))
        with pytest.raises(ClusterError, match=expected):
            bake(village(), DirectoryStore(tmp_path / "w"), on(spare.address))
        spare.stop_workers()
        with distributed.Client(spare.address, set_as_default=False) as client:
            while client.nthreads():
                time.sleep(0.1)


@pytest.mark.slow
def test_work_that_kills_every_worker(spare: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "LOOK_EVERY", 0.2)
    monkeypatch.setattr(cluster, "JOIN_WITHIN", 60.0)
    spare.add_worker()
    with monkeypatch.context() as impatient:
        impatient.setattr(cluster, "ALONE_FOR", 0.0)
        with pytest.raises(ClusterError, match="no worker is left"):
            bake(one(Deadly(ground(0, 1))), DirectoryStore(tmp_path / "w"), on(spare.address))
    spare.add_worker()
    spare.add_worker()
    with pytest.raises(ClusterError, match="2 workers died at the same work"):
        bake(one(Deadly(ground(0, 1))), DirectoryStore(tmp_path / "w"), on(spare.address))


@pytest.mark.slow
def test_a_scheduler_killed_in_the_middle(spare: LocalCluster, local: dict[str, bytes], tmp_path: Path) -> None:
    spare.add_worker()
    with pytest.raises(ClusterError, match="connection to the scheduler was lost"):
        bake(village(), DirectoryStore(tmp_path / "w"), on(spare.address), Watching(5, spare.stop_scheduler))
    spare.stop()
    bake(village(), DirectoryStore(tmp_path / "w"), SMALL)
    assert contents(DirectoryStore(tmp_path / "w")) == local
