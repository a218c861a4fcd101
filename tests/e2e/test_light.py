"""The page's light: sky and haze as the reference renderer has them, shadows on pictures and geometry alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from e2e.browsing import Pixels, Visit, psnr
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb
from farfield.store import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.shading import Light
from farfield.world.world import World

EYE, TARGET = (-40.0, -42.0, 30.0), (0.0, 0.0, 0.0)
LOW_EYE, LOW_TARGET = (-34.0, -36.0, 4.0), (0.0, 0.0, 6.0)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "haze"), [(225.0, 35.0, 150.0), (50.0, 8.0, 60.0), (50.0, -6.0, None)]
)
@pytest.mark.parametrize("near_radius", [0.0, 30.0])
def test_sky_and_haze_are_those_of_the_reference_renderer(
    address: str,
    visit: Callable[..., Visit],
    world: DirectoryStore,
    azimuth: float,
    elevation: float,
    haze: float | None,
    near_radius: float,
) -> None:
    page = visit(address)
    page.options(patches=False, supersampling=2, nearRadius=near_radius, farGeometry=False, sky="clear", haze=haze)
    page.options(light={"azimuth": azimuth, "elevation": elevation})
    page.look(LOW_EYE, LOW_TARGET)
    light = Light(azimuth=azimuth, elevation=elevation, sky="clear", haze=haze)
    camera, options = (
        Camera(LOW_EYE, LOW_TARGET, 46.8),
        RenderOptions(supersampling=2, near_radius=near_radius, light=light),
    )
    picture = render_world(World.open(world), camera, (640, 480), options)
    expected, shown = picture.pixels(light.backdrop(camera, (640, 480))), page.picture()
    assert psnr(shown, expected) >= 30
    sky = picture.alpha == 0
    assert sky.mean() > 0.2
    # At a rim one may see a sample of what the other sees none of.
    assert (np.abs(shown[sky].astype(int) - expected[sky]).max(axis=1) > 2).sum() <= 3


def test_one_colour_of_sky_hazes_too(address: str, visit: Callable[..., Visit], world: DirectoryStore) -> None:
    page = visit(address)
    page.options(supersampling=2, nearRadius=0, haze=80.0)
    page.look(EYE, TARGET)
    light, camera = Light(haze=80.0), Camera(EYE, TARGET, 46.8)
    options = RenderOptions(supersampling=2, near_radius=0.0, light=light)
    expected = render_world(World.open(world), camera, (640, 480), options).pixels(light.sky_linear)
    assert psnr(page.picture(), expected) >= 30


def shares_of_sun(page: Visit, **changes: object) -> np.ndarray:
    """(h, w) what shadows leave of each pixel's luminance, linear."""
    page.options(**changes, shadows=False)
    page.complete()
    plain = brightness(page.picture())
    page.options(shadows=True)
    page.complete()
    return brightness(page.picture()) / np.maximum(plain, 1e-3)


def brightness(pixels: Pixels) -> np.ndarray:
    """(h, w) linear."""
    return np.asarray(linear_from_srgb(pixels / 255.0).mean(-1))


def test_pictures_and_geometry_have_the_same_shadows(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.options(supersampling=2, light={"azimuth": 130, "elevation": 35})
    page.look(EYE, TARGET)
    fetched = 0
    found = []
    for near_radius in (500, 0, 60):
        page.options(nearRadius=near_radius, farGeometry=False)
        page.complete()
        page.quiet()
        fetched = len(page.fetched)
        found.append(shares_of_sun(page))
        assert len(page.fetched) == fetched, "shadows need nothing more"
    geometry, pictures, both = found
    for shares in found:
        dark = shares < 0.6
        assert 0.03 < dark.mean() < 0.5
        # What lies in the shadow keeps the ambient light alone: 0.3 of 0.3 + sin 35 degrees on the ground.
        assert np.median(shares[dark]) == pytest.approx(0.3 / (0.3 + np.sin(np.radians(35))), abs=0.06)
        assert np.median(shares[~dark]) == pytest.approx(1, abs=0.02)
    assert ((geometry < 0.6) != (pictures < 0.6)).mean() < 0.03
    assert ((geometry < 0.6) != (both < 0.6)).mean() < 0.03


def test_a_shadow_lies_where_the_sun_puts_it(address: str, visit: Callable[..., Visit]) -> None:
    """Shadows turn with the sun, and end with it."""
    page = visit(address)
    page.options(supersampling=1, nearRadius=500, farGeometry=False)
    page.look((0.0, -0.1, 120.0), (0.0, 0.0, 0.0))
    dark = []
    for azimuth in (90, 270):
        shares = shares_of_sun(page, light={"azimuth": azimuth, "elevation": 30})
        dark.append(shares < 0.6)
        assert 0.02 < dark[-1].mean() < 0.4
    east, west = (np.flatnonzero(shadow.any(0)) for shadow in dark)
    assert east.min() < west.min(), "a sun in the east throws shadows to the west"
    assert east.max() < west.max()
    assert np.abs(shares_of_sun(page, light={"elevation": -5}) - 1).max() < 0.02


def test_the_address_keeps_the_air(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address + "#sun=90,20&sky=clear&haze=500&shadows=1")
    page.complete()
    options = page.do("(({sky, haze, shadows}) => ({sky, haze, shadows}))(farfield.world.options)")
    assert options == {"sky": "clear", "haze": 500, "shadows": True}
    page.page.get_by_label("Show figures and controls").click()
    assert page.page.get_by_label("Shadows").is_checked()
    page.page.get_by_label("Shadows").uncheck()
    page.page.get_by_label("Haze").fill("0")
    page.page.wait_for_function("!location.hash.includes('shadows') && !location.hash.includes('haze')")
    assert "sky=clear" in page.page.url
