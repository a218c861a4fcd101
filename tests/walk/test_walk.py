"""Walks through a small town with the real server, and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image

from e2e.world import HALF, town
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.cli import main
from farfield.scene.model import Scene
from farfield.store.directory import DirectoryStore
from farfield.stream.tree import NONE, CellTree
from farfield.view.path import CameraPath, PathFrame
from farfield.walk.observer import Poses
from farfield.walk.walk import WalkedWorld, WalkOptions, walk
from farfield.world.index import Impostor
from farfield.world.keys import texture_key

SECONDS, BANDWIDTH = 5, 30_000


@pytest.fixture(scope="module")
def scene() -> Scene:
    return town()


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> DirectoryStore:
    store = DirectoryStore(tmp_path_factory.mktemp("walk") / "world")
    bake(scene, store, BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    return store


@pytest.fixture(scope="module")
def path() -> CameraPath:
    """Along the edge of the town, looking at its middle."""
    frames = [PathFrame(n / 10, (-26.0 + 0.2 * n, -28.0, 2.0), (0.0, 0.0, 2.0), 50.0) for n in range(10 * SECONDS)]
    return CameraPath(10.0, tuple(frames))


def test_objects_are_told_from_geometry(world: DirectoryStore, scene: Scene) -> None:
    objects = WalkedWorld.of(world).objects
    assert len(objects.ids) == scene.object_count
    assert np.bincount(objects.piece_object, objects.piece_share) == pytest.approx(1.0)
    ground = objects.boxes[np.argmax(objects.boxes[:, 3] - objects.boxes[:, 0])]
    assert ground == pytest.approx([-HALF, -HALF, 0, HALF, HALF, 0], abs=1e-3)
    # Each face is an object here: beside the ground the roofs of 20 houses, 15 huts and 20 lamps lie flat.
    assert objects.is_ground.sum() == 1 + 20 + 15 + 20
    standing = objects.without_ground()
    assert (standing.boxes[:, 5] > standing.boxes[:, 2] + 1).all()
    assert len(standing.piece_object) == (~objects.is_ground[objects.piece_object]).sum()
    assert standing.piece_object.max() == len(standing.ids) - 1


def test_pieces_know_their_instances(world: DirectoryStore) -> None:
    known = WalkedWorld.of(world)
    objects, listed = known.objects, known.tree.instances
    own = np.flatnonzero(objects.piece_instance != NONE)
    assert set(objects.piece_instance[own].tolist()) == set(range(len(listed.leaf)))
    assert len(listed.leaf) > 20
    boxes, around = objects.boxes[objects.piece_object[own]], listed.bounds[objects.piece_instance[own]]
    assert (boxes[:, :3] >= around[:, :3] - 0.01).all()
    assert (boxes[:, 3:] <= around[:, 3:] + 0.01).all()


def test_boards_count(world: DirectoryStore, path: CameraPath) -> None:
    """As soon as their images are there, for viewers that draw any geometry."""
    known = WalkedWorld.of(world)
    images = tuple((f"{side:016x}", 100) for side in range(8))
    entries = [
        replace(entry, instances=tuple(replace(one, impostors=(Impostor(96, images),)) for one in entry.instances))
        for entry in known.tree.entries
    ]
    tree = CellTree(known.tree.grid, entries, known.tree.parents.tolist())
    walked = WalkedWorld(known.world, tree, known.objects)
    pose = Poses(path).at(1.0)
    for near_radius, least in ((None, 0.3), (0.0, 0.0)):
        measure = walked.measure(WalkOptions(1.0, near_radius=near_radius))
        assert measure.sample(pose).quality == 0
        measure.hold(texture_key(name) for name, _ in images)
        quality = measure.sample(pose).quality
        assert quality > least if least else quality == 0


def test_a_walk(world: DirectoryStore, path: CameraPath) -> None:
    found = walk(world, path, WalkOptions(BANDWIDTH, latency=0.05, size=(320, 240), frames=2))
    assert len(found.quality) == len(found.missing) == SECONDS
    assert 0 <= found.quality[0] < found.mean_quality <= 1
    assert found.quality[-1] > 0.5
    assert 0 < found.bytes <= BANDWIDTH * (SECONDS + 0.5)
    times, keys, sizes = zip(*found.received.arrivals, strict=True)
    assert list(times) == sorted(times)
    assert len(set(keys)) == len(keys)
    assert [world.size(key) for key in keys] == list(sizes)
    assert sum(sizes) <= found.bytes
    # There and back again, and its bytes.
    assert times[0] > 2 * 0.05 + sizes[0] / BANDWIDTH - 0.06
    assert [frame.second for frame in found.frames] == [0.0, 2.0, 4.0]
    first, _, last = found.frames
    assert last.flip < first.flip
    assert last.psnr > first.psnr


def test_the_command(
    world: DirectoryStore, path: CameraPath, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = told(capsys, world, recorded(path, tmp_path), "--plot", str(tmp_path / "walk.png"), "--seconds", "4")
    assert {"mean_quality", "quality", "bytes", "missing_after"} <= facts.keys()
    assert len(facts["quality"]) == 4
    assert 0 < facts["mean_quality"] <= 1
    assert facts["missing_after"] is None or 3 <= facts["missing_after"] < 4
    with Image.open(tmp_path / "walk.png") as picture:
        assert picture.size == (800, 400)


def test_wrong_calls_of_the_command(
    world: DirectoryStore, path: CameraPath, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.json").write_text('{"fps": 10, "frames": [')
    (tmp_path / "back.json").write_text(recorded(path, tmp_path).read_text().replace('"t": 0.2', '"t": 9.0', 1))
    good = str(recorded(path, tmp_path))
    for arguments, code, words in [
        (
            (world.location, "--path", str(tmp_path / "none.json"), "--bandwidth", "1000"),
            1,
            "none.json: cannot be read",
        ),
        ((world.location, "--path", str(tmp_path / "bad.json"), "--bandwidth", "1000"), 1, "not a recorded path"),
        ((world.location, "--path", str(tmp_path / "back.json"), "--bandwidth", "1000"), 1, "must ascend"),
        ((str(tmp_path), "--path", good, "--bandwidth", "1000"), 1, str(tmp_path)),
        ((world.location, "--path", good, "--bandwidth", "0"), 2, "--bandwidth: must be"),
        ((world.location, "--path", good, "--bandwidth", "1000", "--size", "big"), 2, "--size"),
    ]:
        assert main(["walk", *arguments]) == code
        out, line = capsys.readouterr()
        assert out == ""
        assert line.count("\n") == 1
        assert words in line


def recorded(path: CameraPath, folder: Path) -> Path:
    frames = [{"t": f.t, "eye": f.eye, "target": f.target, "fov": f.fov} for f in path.frames]
    file = folder / "path.json"
    file.write_text(json.dumps({"fps": path.fps, "frames": frames}))
    return file


def told(capsys: pytest.CaptureFixture[str], world: DirectoryStore, path: Path, *options: str) -> dict[str, Any]:
    assert main(["walk", world.location, "--path", str(path), "--bandwidth", str(BANDWIDTH), "--json", *options]) == 0
    facts: dict[str, Any] = json.loads(capsys.readouterr().out)
    return facts
