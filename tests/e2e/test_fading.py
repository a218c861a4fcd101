"""What is shown goes over into what is drawn: moved to where its surfaces are, by time, and in the end not at all."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable

import numpy as np
import pytest
from PIL import Image

from e2e.browsing import Pixels, Visit, psnr

Triple = tuple[float, float, float]
EYE, TARGET = (-40.0, -42.0, 14.0), (0.0, 0.0, 2.0)
ASIDE = (-38.0, -44.0, 14.0)
SLOWLY = 600.0
"""Seconds: however slow frames are, what was shown before is nearly all there is."""


@pytest.mark.parametrize("near", [0, 30])
def test_at_rest_nothing_is_left_of_what_was_before(address: str, visit: Callable[..., Visit], near: float) -> None:
    page = visit(address)
    page.options(nearRadius=near, farGeometry=False, fade=0)
    page.look(EYE, TARGET)
    without = page.picture()
    page.options(fade=0.5)
    page.look(ASIDE, TARGET)
    page.look(EYE, TARGET)
    # Half floats on the way, hence a step of rounding.
    assert np.abs(page.picture().astype(int) - without).max() <= 1
    assert page.do("farfield.world.frame.isFading") is False


def test_another_light_comes_gradually(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.options(fade=SLOWLY)
    page.look(EYE, TARGET)
    before = page.picture()
    page.options(light={"azimuth": 45, "elevation": 10})
    _frames(page)
    between = page.picture()
    page.complete()
    after = page.picture()
    assert psnr(between, before) > 35 > psnr(after, before) + 5


@pytest.mark.parametrize("near", [0, 30])
def test_what_was_shown_moves_with_its_surfaces(address: str, visit: Callable[..., Visit], near: float) -> None:
    """Seen from aside, in a light that has changed meanwhile: the old light where both show the same, else the new."""
    page = visit(address)
    page.options(nearRadius=near, farGeometry=False, fade=SLOWLY)
    page.look(ASIDE, TARGET)
    expected = page.picture()
    page.look(EYE, TARGET)
    before = page.picture()
    page.options(light={"azimuth": 45, "elevation": 10})
    page.do("camera => farfield.setCamera(camera)", {"eye": ASIDE, "target": TARGET, "fov": 46.8})
    _frames(page)
    moved = page.picture()
    page.complete()
    after = page.picture()
    ground = np.abs(expected.astype(int) - after).max(axis=-1) > 4
    assert ground.mean() > 0.2
    nearer = _error(moved, expected)[ground] < _error(moved, after)[ground]
    assert nearer.mean() > 0.8, "but for rims"
    assert psnr(moved, expected) > psnr(before, expected) + 1


def test_motion_is_blurred_along_its_way_and_rest_is_not(address: str, visit: Callable[..., Visit]) -> None:
    page = visit(address)
    page.options(fade=0, shutter=1, nearRadius=0)
    page.look(ASIDE, TARGET)
    sharp = page.picture()
    page.options(shutter=0)
    page.complete()
    assert np.abs(page.picture().astype(int) - sharp).max() <= 1
    page.options(shutter=1)
    page.look((ASIDE[0] + 0.5, ASIDE[1], ASIDE[2]), TARGET)
    blurred = _picture_in_motion(page, ASIDE)
    page.complete()
    assert np.array_equal(page.picture(), sharp)
    assert _roughness(blurred, axis=1) < 0.8 * _roughness(sharp, axis=1)
    assert _roughness(blurred, axis=0) > 0.8 * _roughness(sharp, axis=0)
    assert abs(blurred.mean() - sharp.mean()) < 1


def _picture_in_motion(page: Visit, eye: Triple) -> Pixels:
    """(h, w, 3) uint8: the first that is shown from another place."""
    address: str = page.do(
        """camera => new Promise((resolve) => {
          const {world} = farfield, {update} = world;
          world.update = (seen, renderer, ...rest) => {
            const different = update.call(world, seen, renderer, ...rest);
            if (different && !world.frame.fading.uniforms.pastSame.value) {
              delete world.update;
              renderer.render(world.parent, seen);
              resolve(document.getElementById("picture").toDataURL());
            }
            return different;
          };
          farfield.setCamera(camera);
        })""",
        {"eye": eye, "target": TARGET, "fov": 46.8},
    )
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        return np.array(image.convert("RGB"))


def _roughness(picture: Pixels, axis: int) -> float:
    """How sharp edges across an axis are: squares, since in all an edge that is blurred has as far to go."""
    return float((np.diff(picture.astype(float), axis=axis) ** 2).mean())


def _frames(page: Visit) -> None:
    """Waits for two more frames."""
    page.do("""async () => {
      const {frames} = farfield.stats();
      while (farfield.stats().frames < frames + 2) await new Promise(requestAnimationFrame);
    }""")


def _error(a: Pixels, b: Pixels) -> Pixels:
    return np.abs(a.astype(int) - b).sum(axis=-1)
