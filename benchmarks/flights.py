"""A flight of the real page over a slow link, both on one clock that the flight moves on.

The page draws in software and may need seconds for a frame; the link must not send more for it. So nothing passes time
but a frame of the flight: the server's link (farfield.serve.clock) and all that the page knows of time stand still
between them. Everything else is as users have it: the page, HTTP, batches, workers. What comes in a frame's tenth of a
second is decoded before the next frame; the decoder is no part of what is measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import cos, inf, radians, sin
from pathlib import Path
from statistics import median
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

from playwright.sync_api import Browser, Page

from farfield.serve.clock import SteppedClock
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store

Triple = tuple[float, float, float]
FRAME = 0.1
"""Seconds of the flight between frames."""
SLICES = 5
"""Steps of the link a frame: what is asked for in answer to something is asked for at most so much of a frame later."""
STALL_SECONDS = 3600.0
"""By the wall a reader may take long."""
SETTLE_SECONDS = 0.3
"""By the wall, for requests on their way between page and server."""
CONNECTIONS = 5
"""Browsers open six to a server, one of which listens for new generations; what is asked for beyond them waits."""
MOST = ("cache_bytes", "uploaded_bytes", "ahead_bytes", "coarsened")
"""Figures of the page of which the greatest is told."""
SCRIPT = Path(__file__).with_suffix(".js")


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the camera is."""

    eye: Triple
    target: Triple
    fov: float = 46.8

    @property
    def given(self) -> dict[str, Any]:
        """As the page takes it."""
        return {"eye": self.eye, "target": self.target, "fov": self.fov}


@dataclass(frozen=True, slots=True)
class Journey:
    """A flight through a world."""

    store: Store
    start: Triple
    speed: float
    """Metres a second."""
    heading: float
    """Degrees from east, anticlockwise, at the start."""
    turns: tuple[float, float] = (60.0, 40.0)
    """The heading swings by so many degrees to both sides, once in so many seconds; (inf, seconds): a circle."""
    pitch: float = -12.0
    """Degrees that the camera looks up."""
    seconds: float = 60.0
    options: dict[str, Any] = field(default_factory=dict)
    """Of the page."""
    size: tuple[int, int] = (640, 480)
    drawn_every: int = 1
    """Frames; of the others, or with 0 of all, everything is done but drawing itself: software needs seconds for it."""
    frame: float = FRAME
    """Seconds between frames."""

    def poses(self) -> Iterator[Pose]:
        """One a frame."""
        x, y, z = self.start
        for n in range(round(self.seconds / self.frame)):
            heading = radians(self._heading_at(n * self.frame))
            ahead = (cos(heading), sin(heading))
            yield Pose((x, y, z), (x + 100 * ahead[0], y + 100 * ahead[1], z + 100 * sin(radians(self.pitch))))
            x, y = x + ahead[0] * self.speed * self.frame, y + ahead[1] * self.speed * self.frame

    def _heading_at(self, t: float) -> float:
        swing, period = self.turns
        return self.heading + (360 * t / period if swing == inf else swing * sin(2 * 3.14159265 * t / period))


@dataclass(slots=True)
class Flown:
    """What a flight gave, one entry a frame."""

    journey: Journey
    frames: list[dict[str, float]] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    """Milliseconds of processor time of the page's thread and of the process that draws; empty where nobody tells."""

    def facts(self, settled: float = 3.0) -> dict[str, Any]:
        """Figures; what is shown counts from `settled` seconds on, memory throughout."""
        first = round(settled / FRAME)
        frames, last = self.frames[first:], self.frames[-1]
        empty = [frame["cells_empty"] > 0 for frame in self.frames]
        share = [frame["stand_in_share"] for frame in frames]
        levels = [frame["stand_in_share"] * frame["stand_in_levels"] for frame in frames]
        return {
            "frames": len(self.frames),
            "frames_with_empty_cells": sum(empty[first:]),
            "frames_with_empty_cells_at_first": sum(empty[:first]),
            "frames_with_stand_ins": sum(one > 0 for one in share),
            "stand_in_share": _round(sum(share) / len(share)),
            "stand_in_levels": _round(sum(levels) / max(sum(share), 1e-9)),
            "levels_lost": _round(sum(levels) / len(share)),
            "levels_lost_p99": _round(percentile(levels, 0.99)),
            "bytes": last["bytes"],
            "requests": last["requests"],
            "most": {name: max(frame[name] for frame in self.frames) for name in MOST},
            "budget": {name: last[name] for name in ("cache_budget", "ahead_budget")},
            "times": self._times(first),
        }

    def _times(self, first: int) -> dict[str, Any]:
        """Milliseconds a frame: of those that are drawn, and of all without drawing."""
        drawn = range(0, len(self.frames), self.journey.drawn_every or len(self.frames) + 1)
        after = [n for n in drawn if n >= first]
        facts: dict[str, Any] = {"script": _spread([frame["script_ms"] for frame in self.frames[first:]])}
        if self.journey.drawn_every and after:
            facts |= {"frames_drawn": len(after), "drawn": _spread([self.frames[n]["drawn_ms"] for n in after])}
        if self.processor:
            facts["processor"] = _spread([self.processor[n] for n in range(first, len(self.frames)) if n not in drawn])
            if "drawn" in facts:
                facts["processor_drawn"] = _spread([self.processor[n] for n in after])
        return facts


def fly(browser: Browser, journey: Journey, bandwidth: float | None, delay: float) -> Flown:
    """Flies, beginning with an empty cache. bandwidth: bytes a second; delay: seconds."""
    clock = SteppedClock()
    options = ServeOptions(port=0, bandwidth=bandwidth, delay=delay, clock=clock, stall_seconds=STALL_SECONDS)
    with serving(journey.store, options) as url, on_the_clock(browser, url, journey, clock) as page:
        drawn_by = _drawing_threads(browser)
        flown = Flown(journey)
        for n, pose in enumerate(journey.poses()):
            before = _spent(drawn_by)
            frame = page.evaluate(
                "given => flight.step(...given)",
                [1000 * FRAME, pose.given, journey.drawn_every > 0 and n % journey.drawn_every == 0],
            )
            flown.frames.append(frame)
            if drawn_by:
                flown.processor.append(_spent(drawn_by) - before)
            for _ in range(SLICES):
                clock.advance(FRAME / SLICES)
                settle(page, clock)
        return flown


@contextmanager
def on_the_clock(browser: Browser, url: str, journey: Journey, clock: SteppedClock) -> Iterator[Page]:
    """The page with its manifest read and its options set, and nothing of the world fetched."""
    width, height = journey.size
    context = browser.new_context(viewport={"width": width, "height": height})
    try:
        page = context.new_page()
        page.set_default_timeout(600_000)
        page.add_init_script(path=SCRIPT)
        with _running(clock):
            # Sessions keep time by clocks of their own: what is measured is the page's own fetching.
            page.goto(f"{url}?sessions=0")
            page.wait_for_function("window.farfield !== undefined && !!farfield.world.manifest", polling=20)
        page.evaluate("options => farfield.setOptions(options)", journey.options)
        yield page
    finally:
        context.close()


@contextmanager
def _running(clock: SteppedClock) -> Iterator[None]:
    """Lets the clock go meanwhile, faster than the wall's."""
    ended = Event()

    def run() -> None:
        while not ended.wait(0.01):
            clock.advance(0.05)

    thread = Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def settle(page: Page, clock: SteppedClock) -> None:
    """Waits until the page has read what was sent, and the server has been asked for what the page wants then."""
    given_up = monotonic() + SETTLE_SECONDS
    while min(page.evaluate("flight.settle()"), CONNECTIONS) != clock.under_way and monotonic() < given_up:
        sleep(0.001)


def _drawing_threads(browser: Browser) -> list[Path]:
    """Where Linux tells how long the page's thread and those of the process that draws have run; none elsewhere."""
    found = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    threads: list[Path] = []
    for process in found:
        folder = Path(f"/proc/{process['id']}/task")
        if not folder.exists():
            continue
        if process["type"] == "GPU":
            threads += [thread / "schedstat" for thread in folder.iterdir()]
        elif process["type"] == "renderer":
            threads.append(folder / str(process["id"]) / "schedstat")
    return threads


def _spent(threads: list[Path]) -> float:
    """Milliseconds of processor time."""
    spent = 0
    for thread in threads:
        try:
            spent += int(thread.read_text().split()[0])
        except (OSError, IndexError):
            continue
    return spent / 1e6


def percentile(values: list[float], share: float) -> float:
    """The least of the values that so large a share of them does not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def _spread(values: list[float]) -> dict[str, float] | None:
    if not values:
        return None
    middle, high = median(values), percentile(values, 0.99)
    return {"median": _round(middle), "p99": _round(high), "ratio": _round(high / middle)}


def _round(value: float) -> float:
    return round(value, 4) if abs(value) < 10 else round(value, 1)
