"""The page on a baked world: opens, draws as the reference renderer does, flies."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from e2e.browsing import Visit, psnr
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.store import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World

Triple = tuple[float, float, float]
SKY = linear_from_srgb(np.array([158, 191, 235]) / 255)
CAMERAS: list[tuple[Triple, Triple]] = [
    ((-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)),
    ((45.0, 10.0, 8.0), (0.0, 0.0, 2.0)),
    ((-90.0, 60.0, 50.0), (0.0, 0.0, 0.0)),
]


def test_opens_without_errors_and_soon_shows_a_complete_picture(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.complete()
    stats = page.stats()
    assert stats["first_picture_ms"] < 20_000, "5 s on a machine of our own; tests share theirs"
    assert stats["tiles_missing"] == stats["tiles_pending"] == 0
    assert stats["splats"] + stats["triangles"] > 500
    page.says("made for tests")
    page.page.get_by_label("Show figures and controls").click()
    page.says("Figures")
    assert np.ptp(page.picture(), axis=(0, 1)).max() > 100


@pytest.mark.parametrize(("eye", "target"), CAMERAS)
@pytest.mark.parametrize(("samples", "bias", "views"), [(1, 0.0, 3), (2, 4.0, 2), (4, 3.0, 1)])
def test_draws_what_the_reference_renderer_draws(
    address: str,
    visit: Callable[..., Visit],
    world: DirectoryStore,
    eye: Triple,
    target: Triple,
    samples: int,
    bias: float,
    views: int,
) -> None:
    page = visit(address)
    page.options(supersampling=samples, nearRadius=0, bias=bias, views=views, patches=False)
    page.look(eye, target)
    assert bias == 0 or max(map(int, page.stats()["cells"])) > 0, "some cells of upper levels"
    options = RenderOptions(supersampling=samples, near_radius=0.0, bias=bias, views=views)
    expected = render_world(World.open(world), Camera(eye, target, 46.8), (640, 480), options).pixels(SKY)
    assert psnr(page.picture(), expected) >= 30
    # Planes of pixels as one differ at their rims: each of these pixels is as wide as 10 to 80 of the picture.
    splats = page.stats()["splats_in_frustum"]
    page.options(patches=True)
    page.complete()
    assert psnr(page.picture(), expected) >= 26
    assert page.stats()["splats_in_frustum"] < 0.7 * splats


def test_near_geometry_is_lit_like_the_pictures(
    address: str, visit: Callable[..., Visit], world: DirectoryStore
) -> None:
    page = visit(address)
    page.complete()
    page.options(supersampling=2, nearRadius=30, farGeometry=False)
    page.look((-34.0, -36.0, 12.0), (0.0, 0.0, 2.0))
    stats = page.stats()
    assert stats["triangles"] > 20
    assert stats["splats"] > 1000
    options = RenderOptions(supersampling=2, near_radius=30.0)
    camera = Camera((-34.0, -36.0, 12.0), (0.0, 0.0, 2.0), 46.8)
    expected = render_world(World.open(world), camera, (640, 480), options).pixels(SKY)
    assert psnr(page.picture(), expected) >= 30


def test_light_changes_without_fetching(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.complete()
    page.quiet()
    before, fetched = page.picture(), len(page.fetched)
    page.options(light={"azimuth": 45, "elevation": 10, "ambient": 0.1})
    page.complete()
    assert psnr(page.picture(), before) < 30
    assert len(page.fetched) == fetched


def test_the_address_keeps_the_view(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address + "#eye=-30,-20,9&target=1,2,3&fov=40&sun=90,20")
    page.complete()
    assert page.do("farfield.getCamera()") == {"eye": [-30, -20, 9], "target": [1, 2, 3], "fov": 40}
    assert page.do("farfield.world.options.light.azimuth") == 90
    page.page.locator("#picture").hover(position={"x": 200, "y": 300})
    page.page.mouse.wheel(0, -300)
    page.page.wait_for_function("!location.hash.includes('eye=-30,-20,9&')")
    assert "fov=40" in page.page.url


def test_keys_mouse_and_panel_move_what_they_should(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.complete()
    keyboard, mouse = page.page.keyboard, page.page.mouse

    def moved(by: Callable[[], None], part: str) -> bool:
        before = json.dumps(page.do("farfield.getCamera()")[part])
        by()
        return json.dumps(page.do("farfield.getCamera()")[part]) != before

    def fly() -> None:
        keyboard.down("w")
        page.page.wait_for_timeout(500)
        keyboard.up("w")

    def orbit() -> None:
        mouse.move(150, 300)
        mouse.down()
        mouse.move(190, 320, steps=3)
        mouse.up()

    page.page.locator("#picture").focus()
    assert moved(fly, "target")
    assert moved(orbit, "eye")
    page.page.get_by_label("Show figures and controls").click()
    page.page.get_by_label("Elevation").fill("80")
    assert page.do("farfield.world.options.light.elevation") == 80
    page.page.get_by_label("Hide figures and controls").click()
    assert not page.page.get_by_text("Figures").is_visible()


def test_twenty_seconds_of_flight(address: str, visit: Callable[..., Visit]) -> None:
    """No error, no value fetched while it is held, memory within the budget."""
    page = visit(address)
    page.options(cacheBytes=3 << 20, supersampling=1, nearRadius=20, farGeometry=False)
    page.complete()
    flight = page.fly(20, (0.0, 0.0, 2.0), radius=45, height=12)
    assert flight["again"] == []
    assert flight["most"] <= 3 << 20
    assert flight["fetched"] > 0
    assert flight["frames"] > 5
    assert flight["last"]["tiles_missing"] == 0


def test_a_budget_that_does_not_hold_the_picture_makes_it_coarser(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.options(nearRadius=0)
    page.look(*CAMERAS[0])
    fine = page.stats()
    budget = fine["cache_bytes"] // 4
    page.options(cacheBytes=budget)
    page.complete()
    coarse = page.stats()
    assert coarse["coarsened"] > 0
    assert 0 < coarse["splats"] < fine["splats"]
    assert coarse["cache_bytes"] <= budget


def test_what_is_held_is_not_fetched_again(address: str, visit: Callable[..., Visit]) -> None:
    """What was given up on its way may be asked for again."""
    page = visit(address)
    page.options(nearRadius=20, farGeometry=False)
    page.do("""() => {
      const asked = window.fetch;
      window.again = [];
      window.fetch = (url, init) => {
        const {pathname, searchParams} = new URL(url);
        const keys = pathname.endsWith("/batch") ? searchParams.getAll("key") : [pathname.slice(1)];
        window.again.push(...keys.filter((key) => farfield.world.holds(key)));
        return asked(url, init);
      };
    }""")
    for eye, target in [*CAMERAS, *CAMERAS]:
        page.look(eye, target)
    assert len(set(page.fetched)) > 50
    assert page.do("again") == []


LOW: list[tuple[Triple, Triple]] = [((-34.0, -30.0, 1.5), (0.0, 0.0, 2.0)), ((30.0, 2.0, 1.5), (-10.0, 8.0, 2.0))]


@pytest.mark.parametrize("near", [0, 20])
def test_at_rest_nothing_is_missing_that_was_left_out(address: str, visit: Callable[..., Visit], near: float) -> None:
    """Bit for bit, drawn from another place before, or right before. No shadows: their maps follow the eye loosely."""
    page = visit(address)
    page.options(nearRadius=near, farGeometry=False, supersampling=2, shadows=False)
    less = 0
    for eye, target in [*CAMERAS, *LOW]:
        page.options(culling="none")
        page.look(eye, target)
        everything = page.picture()
        page.options(culling="all")
        page.look(target, eye)
        page.look((eye[0] + 1.0, eye[1], eye[2]), target)
        page.look(eye, target)
        assert np.array_equal(page.picture(), everything)
        page.do("farfield.setOptions({})")
        page.complete()
        assert np.array_equal(page.picture(), everything)
        stats = page.stats()
        assert 0 < stats["splats_drawn"] <= stats["splats_in_frustum"] <= stats["splats_in_memory"]
        less += stats["splats_drawn"] < stats["splats_in_frustum"]
    assert less >= 3


def test_what_was_left_out_by_mistake_is_drawn_at_once(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.options(nearRadius=0, shadows=False, fade=0)
    page.look(*CAMERAS[0])
    right, usual = page.picture(), page.stats()["splats_drawn"]
    drawn = page.do("""async () => {
      const {session} = farfield.world, {draw} = session, drawn = [];
      session.draw = function (...parts) {
        draw.apply(this, parts);
        drawn.push(farfield.stats().splats_drawn);
      };
      // As if a wall had stood right before the eye.
      for (const {values} of session.before.levels) values.fill(0.9);
      farfield.setOptions({});
      while (drawn.length < 2) await new Promise(requestAnimationFrame);
      delete session.draw;
      return drawn;
    }""")
    assert drawn[0] == 0
    assert drawn[1] >= usual > 0
    page.complete()
    assert np.array_equal(page.picture(), right)
