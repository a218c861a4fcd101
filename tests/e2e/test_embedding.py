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

const world = new FarfieldWorld("./", {sky: null, nearRadius: 0, supersampling: 2});
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


def _pixels(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return np.array(image.convert("RGB"))
