"""A bake that is ended, by whatever, goes on where it was, to the same bytes; two at once are refused."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from farfield.errors import StoreError
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.store.directory import DirectoryStore

OPTIONS = ["--leaf-size", "8", "--resolution", "32", "--directions", "5", "--workers", "2", "--json"]
BEGUN = 5
"""Finished cells by which a bake is in its middle: all together are some eighteen times as many."""

Bake = subprocess.Popen[str]


def command(scene: Path, world: Path) -> list[str]:
    """`farfield bake`, as a user calls it."""
    return [sys.executable, "-m", "farfield", "bake", str(scene), "-o", str(world), *OPTIONS]


def start(scene: Path, world: Path) -> Bake:
    """That command in a session of its own."""
    return subprocess.Popen(
        command(scene, world), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def contents(world: Path) -> dict[str, bytes]:
    """Everything in a world."""
    store = DirectoryStore(world)
    return {key: store.get(key) for key in store.list()}


def records(world: Path) -> dict[str, int]:
    """When each finished cell was noted, nanoseconds; without the notes about the whole bake."""
    cells = (world / "record").glob("*/**/*")
    return {str(path): path.stat().st_mtime_ns for path in cells if path.is_file()}


def survivors(session: int) -> list[int]:
    """Processes of a session that are still there."""
    return [pid for pid, _, its in processes() if its == session]


def workers(bake: Bake) -> list[int]:
    """Worker processes of a bake."""
    return [pid for pid, parent, _ in processes() if parent == bake.pid and b"spawn_main" in command_line(pid)]


def processes() -> Iterator[tuple[int, int, int]]:
    """Number, parent and session of each process there is."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent, _, session = stat.read_text().rsplit(")", 1)[1].split()[:4]
        except OSError:
            continue
        if state != "Z":
            yield int(stat.parent.name), int(parent), int(session)


def command_line(pid: int) -> bytes:
    """Of a process; empty when it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def begins(bake: Bake, _: Path) -> bool:
    """A worker is being started."""
    return bool(workers(bake))


def is_halfway(_: Bake, world: Path) -> bool:
    """Some cells are finished."""
    return len(records(world)) >= BEGUN


def end_of(bake: Bake) -> tuple[int, str]:
    """Exit code and the last line of a bake that ends; nothing else is on stderr but progress, and nobody is left."""
    _, said = bake.communicate(timeout=120)
    lines = said.splitlines()
    assert [line for line in lines if not line.startswith("farfield: ")] == []
    deadline = time.monotonic() + 20
    while survivors(bake.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert survivors(bake.pid) == [], "workers end with the process that began them"
    return bake.returncode, lines[-1]


def interrupted(
    scene: Path, world: Path, act: Callable[[Bake], None], when: Callable[[Bake, Path], bool] = is_halfway
) -> tuple[int, str]:
    """As `end_of`, of a bake to which `act` is done at that moment."""
    bake = start(scene, world)
    while not when(bake, world):
        assert bake.poll() is None, "it ended before anything was done to it"
        time.sleep(0.005)
    act(bake)
    return end_of(bake)


def goes_on(scene: Path, world: Path, expected: dict[str, bytes]) -> None:
    """The same command ends in the expected bytes, and bakes no finished cell again."""
    kept = records(world)
    result = subprocess.run(command(scene, world), check=True, capture_output=True, text=True)
    after = records(world)
    assert {name: after[name] for name in kept} == kept, "no finished cell was baked twice"
    fresh = [json.loads(Path(name).read_bytes())["entry"] for name in after.keys() - kept.keys()]
    # A cell that turned out to hold nothing is noted too, so that nobody looks into it again.
    assert json.loads(result.stdout)["cells_rebuilt"] == sum("tiles" in entry for entry in fresh)
    assert contents(world) == expected


@pytest.fixture(autouse=True, scope="module")
def _interruptible() -> Iterator[None]:
    """A shell's background jobs, and all that they start, begin with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some objects."""
    return make_objects(tmp_path_factory.mktemp("objects"), ObjectsOptions(count=5, triangles=1000)).path


@pytest.fixture(scope="module")
def whole(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], float]:
    """An uninterrupted bake's bytes, and the seconds it took."""
    world = tmp_path_factory.mktemp("whole") / "world"
    begun = time.monotonic()
    subprocess.run(command(scene, world), check=True, capture_output=True)
    return contents(world), time.monotonic() - begun


@pytest.fixture(scope="module")
def expected(whole: tuple[dict[str, bytes], float]) -> dict[str, bytes]:
    """An uninterrupted bake's bytes."""
    return whole[0]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, in memory."""
    if os.geteuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root may mount a file system")
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "farfield-test", folder], capture_output=True, text=True)
    if made.returncode:
        pytest.skip(f"nothing can be mounted here: {made.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


def remount(disk: Path, options: str) -> None:
    """Changes how it is mounted."""
    subprocess.run(["mount", "-o", f"remount,{options}", disk], check=True)


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_and_started_again(
    scene: Path, whole: tuple[dict[str, bytes], float], tmp_path: Path, kills: int
) -> None:
    expected, seconds = whole
    world, chance = tmp_path / "world", random.Random(kills)
    kept: dict[str, int] = {}
    for _ in range(kills):
        bake = start(scene, world)
        time.sleep(chance.uniform(0.3, 1.0) * seconds)
        bake.kill()
        bake.communicate(timeout=60)
        deadline = time.monotonic() + 20
        while survivors(bake.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert survivors(bake.pid) == [], "workers end with the process that began them"
        now = records(world)
        assert {name: now.get(name) for name in kept} == kept, "no finished cell was baked twice"
        kept = now
    goes_on(scene, world, expected)


def to_all(bake: Bake) -> None:
    """Ctrl-C, as a terminal tells it to the command and its workers alike."""
    os.killpg(bake.pid, signal.SIGINT)


def to_the_command(bake: Bake) -> None:
    """Ctrl-C, to the command alone."""
    bake.send_signal(signal.SIGINT)


def termination(bake: Bake) -> None:
    """SIGTERM, as a system says it that shuts down."""
    bake.terminate()


@pytest.mark.parametrize("when", [pytest.param(begins, marks=pytest.mark.slow), is_halfway])
@pytest.mark.parametrize("act", [to_all, pytest.param(to_the_command, marks=pytest.mark.slow), termination])
def test_interrupted(
    scene: Path,
    expected: dict[str, bytes],
    tmp_path: Path,
    act: Callable[[Bake], None],
    when: Callable[[Bake, Path], bool],
) -> None:
    assert interrupted(scene, tmp_path / "world", act, when) == (130, "farfield: interrupted")
    goes_on(scene, tmp_path / "world", expected)


def test_a_worker_that_the_system_kills(scene: Path, expected: dict[str, bytes], tmp_path: Path) -> None:
    code, line = interrupted(scene, tmp_path / "world", lambda bake: os.kill(workers(bake)[0], signal.SIGKILL))
    assert code == 1
    assert line.startswith("farfield: a worker process was killed (give it more memory or fewer --workers")
    goes_on(scene, tmp_path / "world", expected)


def test_a_full_disk(scene: Path, expected: dict[str, bytes], disk: Path) -> None:
    page = 4096
    remount(disk, f"size={sum(-(-len(value) // page) * page for value in expected.values()) // 2}")
    code, line = end_of(start(scene, disk / "world"))
    assert code == 1
    assert line.startswith(f"farfield: {disk}/world: ")
    assert line.endswith("cannot be written: no space left on device (free some space; what is stored so far is kept)")
    assert records(disk / "world")
    remount(disk, "size=256m")
    goes_on(scene, disk / "world", expected)


def test_a_write_that_ends_in_its_middle(scene: Path, expected: dict[str, bytes], tmp_path: Path) -> None:
    """The system takes the beginning of a value and refuses the rest."""
    world = tmp_path / "world"
    largest = max(len(value) for key, value in expected.items() if not key.startswith(("index.html", "viewer/")))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest - 1, before[1]))
    try:
        bake = start(scene, world)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    code, line = end_of(bake)
    assert code == 1
    assert line.endswith("cannot be written: file too large (raise the limit of a file's size: ulimit -f)")
    goes_on(scene, world, expected)


def test_a_disk_that_is_read_only(scene: Path, disk: Path) -> None:
    remount(disk, "ro")
    code, line = end_of(start(scene, disk / "world"))
    assert code == 1
    assert line.startswith(f"farfield: {disk}/world: ")
    assert "cannot be written: read-only file system (the file system is mounted read-only" in line
    assert list(disk.iterdir()) == []


def test_a_world_begun_on_a_disk_that_has_become_read_only(scene: Path, expected: dict[str, bytes], disk: Path) -> None:
    interrupted(scene, disk / "world", to_the_command)
    begun = contents(disk / "world")
    remount(disk, "ro")
    code, line = end_of(start(scene, disk / "world"))
    assert code == 1
    assert "cannot be written: read-only file system (the file system is mounted read-only" in line
    remount(disk, "rw")
    assert contents(disk / "world") == begun
    goes_on(scene, disk / "world", expected)


def test_a_second_bake_into_the_same_world_is_refused(scene: Path, expected: dict[str, bytes], tmp_path: Path) -> None:
    """And leaves no trace in the work of the first."""
    world = tmp_path / "world"
    first = start(scene, world)
    while not is_halfway(first, world):
        assert first.poll() is None
        time.sleep(0.005)
    # However long the second takes to be refused, the first is not done before.
    first.send_signal(signal.SIGSTOP)
    second = subprocess.run([*command(scene, world), "--quality", "high"], capture_output=True, text=True)
    first.send_signal(signal.SIGCONT)
    assert second.returncode == 1
    assert second.stderr == (
        f"farfield: {world}: another process is writing to this world (wait until it is done, or end it)\n"
    )
    assert end_of(first)[0] == 0
    assert contents(world) == expected


def test_a_folder_that_is_read_only_is_said(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    tmp_path.chmod(0o500)
    with pytest.raises(StoreError, match="cannot be written"), DirectoryStore(tmp_path / "world").writing():
        pass
