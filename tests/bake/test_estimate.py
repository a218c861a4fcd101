"""What a bake says is to be expected, against what comes of it, in worlds of different kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from bake.scenes import box, ground, quad_mesh, scene_of
from bake.test_bake import SMALL
from farfield.bake import engine
from farfield.bake.bake import bake
from farfield.bake.context import BakeJob
from farfield.bake.estimate import FEWEST_LEAVES, Estimate, estimate
from farfield.bake.walk import Children
from farfield.bake.worker import Outcome
from farfield.progress import NoProgress
from farfield.scene.model import Material, Mesh, Scene
from farfield.scene.procedural.blobs import blob
from farfield.store.memory import MemoryStore
from farfield.world.index import CellEntry
from farfield.world.world import World

WALL = Material("wall", (0.8, 0.7, 0.6, 1.0))
Place = tuple[float, float, float]


def scattered(count: int, lower: Sequence[float], upper: Sequence[float], seed: int = 1) -> list[Place]:
    """Random places in a box."""
    random = np.random.default_rng(seed)
    return [(float(x), float(y), float(z)) for x, y, z in random.uniform(lower, upper, (count, 3))]


def houses(count: int, lower: float, upper: float, seed: int) -> Mesh:
    """One mesh of many boxes, as footprints give it."""
    random = np.random.default_rng(seed)
    corners = []
    for x, y, _ in scattered(count, (lower, lower, 0), (upper, upper, 0), seed):
        w, d, h = random.uniform((0.5, 0.5, 1), (2, 2, 9))
        corners.append(box((x, y, 0.0), (x + w, y + d, h), WALL).positions.reshape(-1, 4, 3))
    return quad_mesh(np.concatenate(corners), WALL)


def uneven() -> Scene:
    """A dense town in a corner of sparse country."""
    here = [(0.0, 0.0, 0.0)]
    return scene_of((ground(0, 44), here), (houses(300, 1, 13, 2), here), (houses(25, 1, 41, 3), here))


def forest() -> Scene:
    """Trees of leaf cards, placed by instances."""
    random = np.random.default_rng(4)
    middle = random.normal((0, 0, 4), (1, 1, 1.2), (150, 1, 3))
    crown = quad_mesh(middle + random.normal(0, 0.25, (150, 4, 3)), Material("leaf", (0.2, 0.4, 0.1, 1.0)))
    trunk = box((-0.2, -0.2, 0.0), (0.2, 0.2, 4.0), WALL)
    trees = scattered(90, (0, 0, 0), (44, 44, 0))
    return scene_of((ground(0, 44), [(0.0, 0.0, 0.0)]), (crown, trees), (trunk, trees))


def floating() -> Scene:
    """Intricate objects in space."""
    kinds = [blob(600, 3.0, seed) for seed in range(3)]
    return scene_of(*((kind, scattered(9, (0, 0, 0), (20, 20, 20), n)) for n, kind in enumerate(kinds)))


def terrain() -> Scene:
    """Hills, one mesh."""
    x, y = np.meshgrid(np.linspace(0, 44, 71), np.linspace(0, 44, 71), indexing="ij")
    p = np.stack([x, y, 3 * np.sin(x / 9) * np.cos(y / 7)], 2)
    quads = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], 2).reshape(-1, 4, 3)
    return scene_of((quad_mesh(quads, Material("grass", (0.2, 0.4, 0.1, 1.0))), [(0.0, 0.0, 0.0)]))


def diagonal() -> Scene:
    """Walls that lead across cells of which most are empty, though the boxes about them are not."""
    walls = []
    for n in range(12):
        a, b = np.array([2.0 * n, 0.0]), np.array([44.0, 44.0 - 2 * n])
        walls.append([[*a, 0.0], [*b, 0.0], [*b, 4.0], [*a, 4.0]])
    return scene_of((quad_mesh(np.array(walls), WALL), [(0.0, 0.0, 0.0)]))


@dataclass(frozen=True)
class Told:
    """An estimate, what it was made from, and the world that came of it."""

    expected: Estimate
    job: BakeJob
    children: Children
    sampled: Sequence[Outcome]
    world: World

    def again(self, seconds: Callable[[CellEntry], float], workers: int = 1) -> Estimate:
        """The estimate, had each cell taken so long."""

        def timed(outcome: Outcome) -> Outcome:
            return replace(outcome, seconds=seconds(outcome.cell.record.entry) if outcome.cell is not None else 0.0)

        found = estimate(self.job, self.children, [timed(outcome) for outcome in self.sampled], workers)
        assert found is not None
        return found


def told(scene: Scene) -> Told:
    """Bakes a scene and listens."""
    heard: list[Any] = []

    def listening(*given: Any) -> Estimate | None:
        heard.extend([estimate(*given), *given])
        return heard[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "estimate", listening)
        store = MemoryStore()
        bake(scene, store, replace(SMALL, directions="5"))
    expected, job, children, sampled, _ = heard
    return Told(expected, job, children, sampled, World.open(store))


@pytest.fixture(scope="module", params=[uneven, forest, floating, terrain, diagonal], ids=lambda make: make.__name__)
def case(request: pytest.FixtureRequest) -> Told:
    """A world of each kind."""
    return told(request.param())


def close(expected: float, found: float) -> bool:
    """Within a factor of two."""
    return found / 2 <= expected <= 2 * found


def test_cells_tiles_and_bytes_are_within_a_factor_of_two(case: Told) -> None:
    found = case.world.manifest.statistics
    assert len(case.job.plan.leaves) >= 2 * len(case.sampled), "a sample, not the whole"
    print(case.expected, found)
    assert close(case.expected.cells, found.cells)
    assert close(case.expected.tiles, found.tiles)
    assert close(case.expected.bytes, found.bytes)


def test_time_is_that_of_all_cells_shared_by_the_workers(case: Told) -> None:
    """With times that depend on what a cell holds: by the clock nothing could be said."""

    def seconds(entry: CellEntry) -> float:
        return 0.02 + 1e-5 * sum(size for _, _, size in entry.tiles)

    assert close(case.again(seconds).seconds, sum(seconds(entry) for entry in case.world.cells()))
    alone, four = (case.again(lambda _: 0.5, workers).seconds for workers in (1, 4))
    assert close(4 * four, alone)


def test_the_first_of_each_worker_tell_no_time(case: Told) -> None:
    """They read the compiled kernels."""
    slow = [next(o for o in case.sampled if o.key.level == level and o.cell is not None) for level in (0, 1)]
    late = {str(outcome.key) for outcome in slow}
    entries = [outcome for outcome in case.sampled if outcome not in slow]
    usual = case.again(lambda _: 0.5)
    first = replace(case, sampled=[*slow, *entries]).again(lambda entry: 1000.0 if entry.key in late else 0.5)
    assert close(first.seconds, usual.seconds)


def test_what_an_earlier_bake_had_finished_tells_nothing() -> None:
    scene, store = terrain(), MemoryStore()
    notes: list[str] = []

    class Listening(NoProgress):
        def note(self, text: str) -> None:
            notes.append(text)

    for rebuilt in (True, False):
        result = bake(scene, store, replace(SMALL, directions="5"), Listening())
        assert (result.cells_rebuilt == result.manifest.statistics.cells) is rebuilt
        assert any("to expect: about" in note for note in notes) is rebuilt
        notes.clear()


def test_a_small_world_is_not_sampled() -> None:
    heard: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "estimate", lambda *given: heard.append(given))
        result = bake(scene_of((ground(0, 15), [(0.0, 0.0, 0.0)])), MemoryStore(), replace(SMALL, directions="5"))
    assert result.manifest.statistics.cells < FEWEST_LEAVES
    assert heard == []
