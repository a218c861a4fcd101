"""A bake killed at any moment goes on where it was, to the same bytes; two at once are refused."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from farfield.errors import StoreError
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.store.directory import DirectoryStore

OPTIONS = ["--leaf-size", "8", "--resolution", "32", "--directions", "5", "--workers", "2", "--json"]


def command(scene: Path, world: Path) -> list[str]:
    """`farfield bake`, as a user calls it."""
    return [sys.executable, "-m", "farfield", "bake", str(scene), "-o", str(world), *OPTIONS]


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
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some objects."""
    return make_objects(tmp_path_factory.mktemp("objects"), ObjectsOptions(count=12, triangles=2000)).path


@pytest.fixture(scope="module")
def whole(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], float]:
    """An uninterrupted bake's bytes, and the seconds it took."""
    world = tmp_path_factory.mktemp("whole") / "world"
    begun = time.monotonic()
    subprocess.run(command(scene, world), check=True, capture_output=True)
    return contents(world), time.monotonic() - begun


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_and_started_again(
    scene: Path, whole: tuple[dict[str, bytes], float], tmp_path: Path, kills: int
) -> None:
    expected, seconds = whole
    world, chance = tmp_path / "world", random.Random(kills)
    kept: dict[str, int] = {}
    for _ in range(kills):
        bake = subprocess.Popen(
            command(scene, world), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(chance.uniform(0.3, 1.0) * seconds)
        bake.send_signal(signal.SIGKILL)
        bake.wait()
        deadline = time.monotonic() + 20
        while survivors(bake.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert survivors(bake.pid) == [], "workers end with the process that began them"
        now = records(world)
        assert {name: now.get(name) for name in kept} == kept, "no finished cell was baked twice"
        kept = now
    result = subprocess.run(command(scene, world), check=True, capture_output=True, text=True)
    after = records(world)
    assert {name: after[name] for name in kept} == kept
    assert json.loads(result.stdout)["cells_rebuilt"] == len(after) - len(kept)
    assert contents(world) == expected


def test_a_second_bake_into_the_same_world_is_refused(scene: Path, tmp_path: Path) -> None:
    world = tmp_path / "world"
    with DirectoryStore(world).writing():
        refused = subprocess.run(command(scene, world), capture_output=True, text=True)
    assert refused.returncode == 1
    assert "another process is writing to this world" in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_a_folder_that_is_read_only_is_said(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    tmp_path.chmod(0o500)
    with pytest.raises(StoreError, match="cannot be written"), DirectoryStore(tmp_path / "world").writing():
        pass
