"""A world that changes while a page shows it: the page follows without being loaded again."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from e2e.browsing import Visit, psnr
from e2e.conftest import OPTIONS
from e2e.world import town
from farfield.bake.bake import bake
from farfield.pipeline import copy_place
from farfield.scene.model import Scene
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore, open_store
from farfield.world.garbage import drop_garbage

EYE, TARGET = (-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)
HOUSE = 5
"""An instance that is one of the houses."""

WATCH = """() => {
  window.sawEmpty = 0;
  window.switched = null;
  farfield.world.events.on("generation", ({generation}) => window.switched = {generation, at: Date.now()});
  const look = () => {
    if (farfield.stats().splats + farfield.stats().triangles === 0) window.sawEmpty++;
    requestAnimationFrame(look);
  };
  look();
}"""
"""Notes when a new generation takes the place of the old one, and frames in which nothing was drawn."""


def moved_house() -> Scene:
    """The town with one house 3 m further north."""
    scene = town()
    transform = scene.instances.transform.copy()
    transform[HOUSE, 1, 3] += 3.0
    return replace(scene, instances=replace(scene.instances, transform=transform))


def without_house() -> Scene:
    """The town with one house less; the ids of the others stay."""
    scene = town()
    kept = [n for n in range(len(scene.instances.mesh)) if n != HOUSE]
    placed = scene.instances
    instances = replace(
        placed,
        mesh=placed.mesh[kept],
        transform=placed.transform[kept],
        first_object=placed.first_object[kept],
        objects=placed.objects[kept],
    )
    return replace(scene, instances=instances)


@pytest.fixture
def copy(world: DirectoryStore, tmp_path: Path) -> DirectoryStore:
    """A copy of the town that a test may bake into."""
    shutil.copytree(world.location, tmp_path / "town")
    return DirectoryStore(tmp_path / "town")


@pytest.fixture
def live(copy: DirectoryStore) -> Iterator[str]:
    """The address of that copy, served by another process, as it mostly is."""
    code = (
        "import sys\n"
        "from farfield.serve.run import ServeOptions, serve\n"
        "from farfield.store import DirectoryStore\n"
        "serve(DirectoryStore(sys.argv[1]), ServeOptions(port=0), lambda url: print(url, flush=True))\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, copy.location], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.terminate()


def complete(page: Visit, generation: int) -> None:
    """Waits until the page shows all that it wants of a generation."""
    page.page.wait_for_function(f"farfield.stats().generation === {generation}", polling=20, timeout=20_000)
    page.complete()


@pytest.mark.parametrize("near", [0, 20])
@pytest.mark.parametrize("change", [moved_house, without_house])
def test_a_changed_world_is_shown_within_seconds(
    copy: DirectoryStore,
    live: str,
    visit: Callable[..., Visit],
    change: Callable[[], Scene],
    near: int,
    record_property: Callable[[str, object], None],
) -> None:
    page = visit(live)
    page.options(nearRadius=near, farGeometry=False, supersampling=1)
    page.look(EYE, TARGET)
    before, asked = page.picture(), len(page.fetched)
    old = set(page.fetched)
    page.do(WATCH)
    kept: dict[str, Any] = page.do("({eye: farfield.getCamera().eye, begun: performance.timeOrigin})")

    result = bake(change(), copy, OPTIONS)
    ended = time.time()
    complete(page, 2)
    seconds = time.time() - ended
    assert result.manifest.generation == 2
    record_property("seconds", round(seconds, 2))
    print(f"\n{change.__name__}, near radius {near} m: complete {seconds:.2f} s after the end of the bake")
    assert seconds < 20, "0.4 s on a machine of our own; the aim is 2 s, and tests share theirs"

    assert page.do("({eye: farfield.getCamera().eye, begun: performance.timeOrigin})") == kept, "not loaded again"
    assert page.do("sawEmpty") == 0, "the old picture stays until the new one is there"
    stats = page.stats()
    assert stats["tiles_missing"] == stats["stand_ins"] == 0
    anew = page.fetched[asked:]
    assert anew
    assert not old & set(anew), "what has not changed is not fetched again"
    assert len(anew) < len(old) / 2

    fresh = visit(live)
    fresh.options(nearRadius=near, farGeometry=False, supersampling=1)
    fresh.look(EYE, TARGET)
    shown = page.picture()
    assert psnr(shown, fresh.picture()) > 50, "as a page that is opened now shows it"
    assert psnr(shown, before) < 40, "the house is elsewhere"
    assert page.stats()["splats_in_frustum"] == fresh.stats()["splats_in_frustum"]
    assert page.stats()["triangles"] == fresh.stats()["triangles"]


def test_generations_in_a_row_with_the_old_ones_swept_away(
    copy: DirectoryStore, live: str, visit: Callable[..., Visit]
) -> None:
    page = visit(live)
    page.options(nearRadius=0, supersampling=1)
    page.look(EYE, TARGET)
    for generation, scene in enumerate((moved_house(), without_house(), town()), 2):
        bake(scene, copy, OPTIONS)
        if generation == 3:
            drop_garbage(copy)
        if generation > 2:
            complete(page, generation)
    assert page.stats()["tiles_missing"] == 0
    fresh = visit(live)
    fresh.options(nearRadius=0, supersampling=1)
    fresh.look(EYE, TARGET)
    assert psnr(page.picture(), fresh.picture()) > 50


def test_another_grid_is_opened_in_place(copy: DirectoryStore, live: str, visit: Callable[..., Visit]) -> None:
    page = visit(live)
    page.options(nearRadius=0, supersampling=1)
    page.look(EYE, TARGET)
    begun = page.do("performance.timeOrigin")
    bake(town(), copy, replace(OPTIONS, resolution=16))
    complete(page, 2)
    assert page.do("performance.timeOrigin") == begun
    assert tuple(page.do("farfield.getCamera().eye")) == EYE
    assert page.stats()["tiles_missing"] == 0
    fresh = visit(live)
    fresh.options(nearRadius=0, supersampling=1)
    fresh.look(EYE, TARGET)
    assert psnr(page.picture(), fresh.picture()) > 50


def test_a_world_baked_from_nothing_at_the_same_address(
    copy: DirectoryStore, live: str, visit: Callable[..., Visit], tmp_path: Path
) -> None:
    """It has generation 1 again: the page goes by what the manifest says."""
    page = visit(live)
    page.options(nearRadius=0, supersampling=1)
    page.look(EYE, TARGET)
    before = page.picture()
    page.do(WATCH)
    result = bake(moved_house(), DirectoryStore(tmp_path / "anew"), OPTIONS)
    assert result.manifest.generation == 1
    Path(copy.location).rename(tmp_path / "old")
    (tmp_path / "anew").rename(copy.location)
    page.page.wait_for_function("window.switched !== null", polling=20, timeout=20_000)
    page.complete()
    assert page.stats()["generation"] == 1
    assert page.stats()["tiles_missing"] == 0
    fresh = visit(live)
    fresh.options(nearRadius=0, supersampling=1)
    fresh.look(EYE, TARGET)
    assert psnr(page.picture(), fresh.picture()) > 50
    assert psnr(page.picture(), before) < 40, "the house is elsewhere"


def test_an_archive_that_is_replaced_while_it_is_served(
    world: DirectoryStore, visit: Callable[..., Visit], tmp_path: Path
) -> None:
    copy_place(world.location, tmp_path / "town.farfield")
    bake(moved_house(), DirectoryStore(tmp_path / "anew"), OPTIONS)
    copy_place(tmp_path / "anew", tmp_path / "anew.farfield")
    with serving(open_store(tmp_path / "town.farfield"), ServeOptions(port=0)) as url:
        page = visit(url)
        page.options(nearRadius=0, supersampling=1)
        page.look(EYE, TARGET)
        before = page.picture()
        page.do(WATCH)
        (tmp_path / "anew.farfield").replace(tmp_path / "town.farfield")
        page.page.wait_for_function("window.switched !== null", polling=20, timeout=20_000)
        page.complete()
        assert page.stats()["tiles_missing"] == 0
        assert psnr(page.picture(), before) < 40
        page.leave()


def test_without_events_what_is_missing_leads_to_the_newer_generation(
    copy: DirectoryStore, visit: Callable[..., Visit]
) -> None:
    """As on a plain server of files: nobody tells, and old tiles are gone when the eye comes to them."""
    with serving(copy, ServeOptions(port=0)) as url:
        # A tile asked for alone that is gone: the browser itself says so on the console.
        page = visit(url, script="delete window.EventSource", expect_errors=True)
        page.options(nearRadius=0, supersampling=1)
        page.look((-400.0, -400.0, 300.0), TARGET)
        bake(moved_house(), copy, OPTIONS)
        drop_garbage(copy)
        time.sleep(1.5)
        assert page.stats()["generation"] == 1
        page.look(EYE, TARGET)
        assert page.stats()["generation"] == 2
        assert page.stats()["tiles_missing"] == 0
        bake(town(), copy, OPTIONS)
        assert page.do("farfield.world.refresh()") is True
        complete(page, 3)
        assert [error for error in page.errors if "404 (Not Found)" not in error] == []
