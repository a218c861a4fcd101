"""A world in a three.js scene of someone else: y up, among other things, before a background of its own."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser

from e2e.browsing import Visit

MAGENTA, BLUE = (255, 0, 255), (0, 0, 255)
THREE = Path(__file__).parents[2] / "viewer/node_modules/three"

PAGE = """<!doctype html><style>body {margin: 0}</style><body><script type="importmap">
{"imports": {"three": "./three/build/three.module.js", "three/addons/": "./three/examples/jsm/"}}
</script><script type="module">
import * as THREE from "three";
import {FarfieldWorld} from "./viewer/farfield.js";

const renderer = new THREE.WebGLRenderer();
renderer.setSize(640, 480);
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
scene.background = new THREE.Color(0xff00ff);
const camera = new THREE.PerspectiveCamera(45, 4 / 3, 0.5, 1000);
camera.position.set(0, 30, 45);
camera.lookAt(0, 0, 0);

const world = new FarfieldWorld("./", {
  sky: null, nearRadius: 0, supersampling: 2,
  sessions: false, // this page comes from the test: Chromium lets it open no socket to this machine
});
world.rotation.x = -Math.PI / 2; // three.js has y up
world.scale.setScalar(0.5);
scene.add(world);

// Half above the ground and half below it, so that the world hides its lower half.
const post = new THREE.Mesh(new THREE.BoxGeometry(2, 40, 2), new THREE.MeshBasicMaterial({color: 0x0000ff}));
scene.add(post);

renderer.setAnimationLoop(() => {
  world.update(camera, renderer);
  renderer.render(scene, camera);
});
window.shown = world.whenComplete();
window.world = world;
window.THREE = THREE;
window.shows = async () => {
  for (let n = 0; n < 4; n++) await new Promise(requestAnimationFrame);
};
</script>"""


@pytest.fixture
def embedded(browser: Browser, address: str) -> Visit:
    """The page above, as if it lay beside the world."""
    if not THREE.exists():
        pytest.skip("three.js is not installed: npm ci in viewer/")
    page = browser.new_context(viewport={"width": 640, "height": 480}).new_page()
    visit = Visit(page, expect_errors=False)
    page.route("**/embedding.html", lambda route: route.fulfill(body=PAGE, content_type="text/html"))
    page.route(
        "**/three/**", lambda route: route.fulfill(path=THREE / route.request.url.split("/three/", 1)[1].split("?")[0])
    )
    page.goto(f"{address}embedding.html")
    page.wait_for_function("window.shown !== undefined")
    page.evaluate("shown")
    page.wait_for_timeout(200)
    return visit


def _share(pixels: np.ndarray, color: tuple[int, int, int], tolerance: int = 12) -> float:
    return float((np.abs(pixels.astype(int) - color).max(-1) <= tolerance).mean())


def test_shares_depth_and_background_with_the_scene(embedded: Visit) -> None:
    page = embedded.page
    shot = page.screenshot()
    stats = page.evaluate("world.stats")
    page.evaluate("world.visible = false")
    page.wait_for_timeout(300)
    alone = page.screenshot()
    page.context.close()
    assert embedded.errors == []
    assert stats["splats"] > 1000
    with_world, without = _pixels(shot), _pixels(alone)
    assert 0.1 < _share(with_world, MAGENTA) < 0.8, "the world stands before the background"
    assert _share(with_world[150:160, 316:324], BLUE) == 1, "the post stands before the world"
    assert _share(without[300:310, 316:324], BLUE) == 1
    assert _share(with_world[300:310, 316:324], BLUE) == 0, "the ground hides its lower half"


PICKED = """async ([x, y]) => {
  const found = await world.pick(x, y), camera = new THREE.PerspectiveCamera(45, 4 / 3, 0.5, 1000);
  camera.position.set(0, 30, 45);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
  const place = found && new THREE.Vector3(...found.position).applyMatrix4(world.matrixWorld).project(camera);
  return found && {...found, pixel: [320 * (1 + place.x), 240 * (1 - place.y)]};
}"""
"""What is at a pixel of the page above, and where in the picture it is by its position."""


def test_tells_what_is_picked_in_local_metres_wherever_it_is_placed(embedded: Visit) -> None:
    page = embedded.page
    for x, y in [(320, 330), (200, 280), (450, 300)]:
        found = page.evaluate(PICKED, [x, y])
        assert found["id"] > 0
        assert np.abs(np.array(found["pixel"]) - [x + 0.5, y + 0.5]).max() < 0.5
        assert np.abs(found["position"][:2]).max() < 32
        assert -0.5 < found["position"][2] < 7
    assert page.evaluate(PICKED, [320, 5]) is None
    aborted = "world.pick(320, 330, AbortSignal.abort()).catch(({tag}) => tag)"
    assert page.evaluate(aborted) == "aborted"
    page.context.close()
    assert embedded.errors == []


MOVING = """async () => {
  const {session} = world, {draw} = session, box = (width, height, material) => {
    const mesh = new THREE.Mesh(new THREE.BoxGeometry(width, width, height), material);
    world.addMoving(mesh);
    return mesh;
  };
  window.drawn = 0;
  session.draw = function (...parts) { window.drawn++; return draw.apply(this, parts); };
  // Half below the ground; and a white table far above it, upright and lit.
  window.pole = box(4, 80, new THREE.MeshBasicMaterial({color: 0x0000ff}));
  window.table = box(12, 1, new THREE.MeshStandardMaterial({color: 0xffffff}));
  pole.rotation.z = 1;
  pole.position.set(-30, 0, 0);
  table.position.set(0, 0, 25);
  await window.shows();
}"""


def test_moving_objects_are_hidden_by_the_world_lit_like_it_and_drawn_alone(embedded: Visit) -> None:
    page = embedded.page
    page.evaluate("world.parent.children.at(-1).visible = false")
    page.evaluate("shows()")
    before = _pixels(page.screenshot())
    page.evaluate(MOVING)
    left = _pixels(page.screenshot())
    pole = np.argwhere(np.abs(left.astype(int) - BLUE).max(-1) <= 12).mean(axis=0)
    changed = np.argwhere((left != before).any(-1))
    assert 1000 < (left == BLUE).all(-1).sum() < 12_000
    assert pole[0] < 250, "the ground hides its lower half"
    # White in the sun, 35 degrees high: 0.3 + sin 35, in linear light.
    lit = round(255 * (1.055 * (0.3 + np.sin(np.radians(35))) ** (1 / 2.4) - 0.055))
    assert ((np.abs(left.astype(int) - lit).max(-1) <= 1) & (before != left).any(-1)).sum() > 200
    page.evaluate("pole.position.x = 30")
    page.evaluate("shows()")
    right = _pixels(page.screenshot())
    moved = np.argwhere(np.abs(right.astype(int) - BLUE).max(-1) <= 12).mean(axis=0)
    assert moved[1] > pole[1] + 100
    page.evaluate("world.removeMoving(table), (pole.visible = false)")
    page.evaluate("shows()")
    assert np.array_equal(_pixels(page.screenshot()), before)
    assert page.evaluate("drawn") == 0, "the world itself was not drawn again"
    stats = page.evaluate("world.stats")
    assert (stats["moving_objects"], stats["moving_triangles"]) == (1, 0)
    page.context.close()
    assert embedded.errors == []
    assert len(changed) > 300


def _pixels(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return np.array(image.convert("RGB"))
