"""A page of the viewer in a browser, and what tests ask of it."""

from __future__ import annotations

import io
import json
import re
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, sync_playwright

FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=gl-egl",
    "--ignore-gpu-blocklist",
]
"""Software WebGL2 (Mesa llvmpipe through EGL); the same on machines with and without a graphics card."""

FLIGHT = """async ({seconds, middle, radius, height}) => {
  const begun = performance.now(), first = farfield.stats(), again = [], asked = window.fetch, underWay = new Set();
  let most = 0;
  window.fetch = (url, init) => {
    const {pathname, searchParams} = new URL(url.url ?? url);
    const keys = pathname.endsWith("/batch") ? searchParams.getAll("key") : [pathname.slice(1)];
    again.push(...keys.filter((key) => farfield.world.holds(key) || underWay.has(key)));
    keys.forEach((key) => underWay.add(key));
    const over = () => keys.forEach((key) => underWay.delete(key));
    init?.signal?.addEventListener("abort", over);
    return asked(url, init).then((response) => {
      response.clone().arrayBuffer().then(over, over);
      return response;
    }, (error) => {
      over();
      throw error;
    });
  };
  const [x, y, z] = middle;
  for (let t = 0; t < seconds; t = (performance.now() - begun) / 1000) {
    const a = t / seconds * 2 * Math.PI, r = radius * (1 + 0.55 * Math.sin(2 * a));
    const eye = [x + r * Math.cos(a), y + r * Math.sin(a), z + height * (1 + 0.8 * Math.sin(3 * a))];
    farfield.setCamera({eye, target: middle});
    await new Promise(requestAnimationFrame);
    most = Math.max(most, farfield.stats().cache_bytes);
  }
  await farfield.whenComplete();
  window.fetch = asked;
  const last = farfield.stats();
  return {most, again, frames: last.frames - first.frames, fetched: last.bytes - first.bytes, last};
}"""
"""A round about `middle` that comes near and goes away, up and down, looking at it. What it gives: the most bytes held
at once, keys that were asked for while they were held or on their way, frames drawn,
bytes received, and the page's last figures."""

Pixels = NDArray[np.uint8]
COMPLETE = """milliseconds => {
  const late = () => new Error("no complete picture in time: " + JSON.stringify(farfield.stats()));
  const deadline = new Promise((_, fail) => setTimeout(() => fail(late()), milliseconds));
  return Promise.race([farfield.whenComplete(), deadline]);
}"""
"""Waits for the complete picture, so long."""
_TILE = re.compile(r"(?:orthoview|geometry|mesh)/[0-9a-f/-]+$")


class Visit:
    """An open page and what it has said and asked for so far."""

    def __init__(self, page: Page, expect_errors: bool, patience: float = 180.0) -> None:
        """patience: seconds that a complete picture may take."""
        self.page = page
        self.patience = patience
        self.expect_errors = expect_errors
        self.errors: list[str] = []
        self.fetched: list[str] = []
        """Keys of tiles and geometry, in the order asked for, alone or in batches, or sent in a session."""
        page.on("console", self._heard)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.fetched.extend(keys_of(request)))
        page.on("websocket", lambda socket: socket.on("framereceived", self._sent))

    def do(self, script: str, argument: object = None) -> Any:
        """What a script, an expression or a function of `argument`, gives in the page."""
        return self.page.evaluate(script, argument)

    def complete(self) -> None:
        """Waits until the picture is complete."""
        self.do(COMPLETE, 1000 * self.patience)

    def look(self, eye: tuple[float, float, float], target: tuple[float, float, float], fov: float = 46.8) -> None:
        """Sets the camera and waits until the picture is complete."""
        self.do("camera => farfield.setCamera(camera)", {"eye": eye, "target": target, "fov": fov})
        self.complete()

    def options(self, **changes: object) -> None:
        """Sets options."""
        self.do("changes => farfield.setOptions(changes)", changes)

    def stats(self) -> dict[str, Any]:
        """The page's figures."""
        found: dict[str, Any] = self.do("farfield.stats()")
        return found

    def quiet(self) -> None:
        """Waits until nothing has come for a second: what the picture does not need is fetched after it."""
        known, since = -1, time.monotonic()
        end = since + self.patience
        while time.monotonic() < since + 1:
            assert time.monotonic() < end, f"never quiet: {self.stats()}"
            now, under_way = self.do("(({requests, under_way}) => [requests, under_way])(farfield.stats())")
            if now != known or under_way:
                known, since = now, time.monotonic()
            self.page.wait_for_timeout(100)

    def fly(self, seconds: float, middle: tuple[float, float, float], radius: float, height: float) -> dict[str, Any]:
        """Flies along FLIGHT; radius and height: metres, on average."""
        way = {"seconds": seconds, "middle": middle, "radius": radius, "height": height}
        flight: dict[str, Any] = self.do(FLIGHT, way)
        return flight

    def picture(self) -> Pixels:
        """(480, 640, 3) uint8: what is on the screen, without the interface."""
        self.do("farfield.hideInterface()")
        with Image.open(io.BytesIO(self.page.screenshot())) as image:
            return np.array(image.convert("RGB"))

    def leave(self) -> None:
        """Closes the page; before its server ends, which a page that listens to it notes on the console."""
        self.page.context.close()

    def says(self, text: str) -> None:
        """Waits until the page shows a text."""
        self.page.get_by_text(text).first.wait_for(state="visible")

    def _sent(self, message: str | bytes) -> None:
        told = json.loads(message) if isinstance(message, str) else {}
        if told.get("type") == "value":
            self.fetched.append(told["key"])

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(message.text)


def keys_of(request: Request) -> list[str]:
    """Keys of tiles and geometry that are asked for, alone or in a batch."""
    if "/batch?" in request.url:
        return [part.removeprefix("key=") for part in request.url.split("?")[1].split("&")]
    found = _TILE.search(request.url)
    return [found[0]] if found else []


def system_chromium() -> str | None:
    """Path of the system's Chromium; None when Playwright's own is to be used."""
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    return next(filter(None, found), None)


@contextmanager
def opened_browser(flags: Sequence[str] = ()) -> Iterator[Browser]:
    """A Chromium that draws in software; `flags` are more of them."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=system_chromium(), args=[*FLAGS, *flags])
        yield browser
        browser.close()


@contextmanager
def visiting(
    browser: Browser, url: str, size: tuple[int, int] = (640, 480), script: Path | None = None
) -> Iterator[Visit]:
    """The viewer's page in a window of its own with an empty cache, patient with pictures that take minutes.

    script: is run before the page's own.
    """
    page = browser.new_context(viewport={"width": size[0], "height": size[1]}).new_page()
    visit = Visit(page, expect_errors=False, patience=1800.0)
    try:
        page.set_default_timeout(600_000)
        if script is not None:
            page.add_init_script(path=script)
        page.goto(url)
        page.wait_for_function("window.farfield !== undefined && !!farfield.world.manifest")
        yield visit
    finally:
        visit.leave()


def psnr(a: Pixels, b: Pixels) -> float:
    """Peak signal-to-noise ratio in dB."""
    error = (a.astype(np.float64) - b.astype(np.float64)) ** 2
    return float("inf") if not error.any() else float(10 * np.log10(255.0**2 / error.mean()))


def differing(a: Pixels, b: Pixels) -> float:
    """Share of the pixels that differ.

    Pages that were sent the same in another order may differ in a few: of splats equally deep the one drawn first
    stays, and that is often the one that came first (1 pixel of 307,200 seen).
    """
    return float((a != b).any(-1).mean())
