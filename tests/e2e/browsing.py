"""A page of the viewer in a browser, and what tests ask of it."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import ConsoleMessage, Page, Request

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

Pixels = NDArray[np.uint8]
_TILE = re.compile(r"(?:orthoview|geometry|mesh)/[0-9a-f/-]+$")


class Visit:
    """An open page and what it has said and asked for so far."""

    def __init__(self, page: Page, expect_errors: bool) -> None:
        self.page = page
        self.expect_errors = expect_errors
        self.errors: list[str] = []
        self.fetched: list[str] = []
        """Keys of tiles and geometry, in the order asked for, alone or in batches."""
        page.on("console", self._heard)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._asked)

    def do(self, script: str, argument: object = None) -> Any:
        """What a script, an expression or a function of `argument`, gives in the page."""
        return self.page.evaluate(script, argument)

    def complete(self) -> None:
        """Waits until the picture is complete."""
        self.do("farfield.whenComplete()")

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

    def picture(self) -> Pixels:
        """(480, 640, 3) uint8: what is on the screen, without the interface."""
        self.do("farfield.hideInterface()")
        with Image.open(io.BytesIO(self.page.screenshot())) as image:
            return np.array(image.convert("RGB"))

    def says(self, text: str) -> None:
        """Waits until the page shows a text."""
        self.page.get_by_text(text).first.wait_for(state="visible")

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(message.text)

    def _asked(self, request: Request) -> None:
        if "/batch?" in request.url:
            self.fetched += [part.removeprefix("key=") for part in request.url.split("?")[1].split("&")]
        elif found := _TILE.search(request.url):
            self.fetched.append(found[0])


def psnr(a: Pixels, b: Pixels) -> float:
    """Peak signal-to-noise ratio in dB."""
    error = (a.astype(np.float64) - b.astype(np.float64)) ** 2
    return float("inf") if not error.any() else float(10 * np.log10(255.0**2 / error.mean()))
