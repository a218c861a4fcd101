"""Flights over a link of 20 Mbit/s with a round trip of 40 ms, looking ahead or not (OV 6.2): what is missing.

    farfield bench flight [--quick] [--json]
    python benchmarks/bench_flight.py [SCENE ...] [--save JSON] [--plot PICTURE]

The real page at 640 x 480 from an empty cache, 60 s at ten frames a second, on a clock that the frames move on
(flights.py). Tokyo: 50 m/s at 100 m over the city (`farfield bench tokyo` leaves its world; leaves are 1 km wide). The
forest and the statues of the picture figures (scenes.py): circles over the tops, as low as nothing is in the way, at
three times Tokyo's speed in leaves a second. Wards: Tokyo by BlockMaps, see docs/performance.md. A cell of the cut
within the picture is empty when nothing is drawn in its place, neither finer nor coarser. Levels lost: how much coarser
what is drawn is than it should be, averaged over the picture. Quick: the town of the tests, 4 s.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from cities import STATION
from e2e.browsing import opened_browser
from e2e.world import town
from flights import FRAME, Flown, Journey, fly

ROOT = Path(__file__).parents[1]
BANDWIDTH = 20e6 / 8
"""Bytes a second."""
DELAY = 0.04
"""Seconds of the round trip."""
DRAWN_EVERY = 10
"""Frames, where drawing is timed: software takes seconds for each. One that comes after nine that are not drawn has all
that they would have uploaded to do, and an older picture to cull by."""
AHEAD = 8.0
"""Seconds, the viewer's default."""


def _tokyo() -> Journey:
    store = open_store(str(ROOT / "worlds/tokyo23/world-1"))
    return Journey(store, (16_000.0, 14_500.0, 100.0), 50.0, 90.0)


def _wards() -> Journey:
    """The same city by BlockMaps, from Tokyo Station north."""
    store = open_store(str(ROOT / "worlds/wards"))
    east, north, _ = World.open(store).manifest.origin
    return Journey(store, (STATION[0] - east, STATION[1] - north, 100.0), 50.0, 90.0)


def _forest() -> Journey:
    store = open_store(str(ROOT / "worlds/quality/forest"))
    return Journey(store, (48.0, 0.0, 40.0), 5.0, 90.0, turns=(inf, 60.0), pitch=-20.0)


def _statues() -> Journey:
    store = open_store(str(ROOT / "worlds/quality/statues"))
    return Journey(store, (6.0, 0.0, 2.5), 0.625, 90.0, turns=(inf, 60.0), pitch=-20.0)


SCENES: dict[str, Callable[[], Journey]] = {"tokyo": _tokyo, "wards": _wards, "forest": _forest, "statues": _statues}


def run(quick: bool = False) -> dict[str, Any]:
    """Figures by scene, looking ahead and not; of scenes whose worlds are there."""
    with tempfile.TemporaryDirectory(prefix="farfield-flight-") as folder, opened_browser() as browser:
        if quick:
            return {"town": _facts(_both(browser, _town(Path(folder)), BANDWIDTH / 20))}
        journeys = {name: make() for name, make in SCENES.items() if _is_there(make)}
        facts = {name: _facts(_both(browser, journey, BANDWIDTH)) for name, journey in journeys.items()}
        for name, journey in journeys.items():
            facts[name]["drawn"] = _drawn(browser, journey).facts()
        return facts


def _town(folder: Path) -> Journey:
    store = DirectoryStore(folder / "town")
    bake(town(), store, BakeOptions(leaf_size=8.0, resolution=32, directions="5", workers=1))
    options = {"nearRadius": 8}
    return Journey(store, (-20.0, -10.0, 10.0), 5.0, 0.0, seconds=4.0, options=options, drawn_every=1)


def _is_there(make: Callable[[], Journey]) -> bool:
    try:
        make()
    except Exception:
        return False
    return True


def _both(browser: Browser, journey: Journey, bandwidth: float) -> dict[str, Flown]:
    """Not looking ahead, and looking ahead."""
    journeys = {"off": _with(journey, ahead=0), "on": _with(journey, ahead=AHEAD)}
    if journey.drawn_every == 1 and journey.seconds > 10:
        journeys = {name: replace(one, drawn_every=0) for name, one in journeys.items()}
    return {name: fly(browser, one, bandwidth, DELAY) for name, one in journeys.items()}


def _drawn(browser: Browser, journey: Journey, every: int = DRAWN_EVERY) -> Flown:
    return fly(browser, replace(_with(journey, ahead=AHEAD), drawn_every=every), BANDWIDTH, DELAY)


def _with(journey: Journey, **options: Any) -> Journey:
    return replace(journey, options={"supersampling": 1} | journey.options | options)


def _facts(flown: dict[str, Flown]) -> dict[str, Any]:
    return {name: one.facts(1.0 if len(one.frames) < 100 else 3.0) for name, one in flown.items()}


def _curves(flown: Flown) -> dict[str, list[float]]:
    """What is plotted, one value a frame."""
    frames = flown.frames
    return {
        "levels_lost": [frame["stand_in_share"] * frame["stand_in_levels"] for frame in frames],
        "cells_empty": [frame["cells_empty"] for frame in frames],
        "cache_bytes": [frame["cache_bytes"] for frame in frames],
        "bytes": [frame["bytes"] for frame in frames],
        "script_ms": [frame["script_ms"] for frame in frames],
        "processor_ms": flown.processor,
    }


def plot(curves: dict[str, dict[str, dict[str, list[float]]]], picture: Path) -> None:
    """Levels lost along each flight, with and without looking ahead, and bytes received."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(curves), figsize=(4 * len(curves), 4.6), sharex=True, squeeze=False)
    for (name, both), (lost, received) in zip(curves.items(), axes.T, strict=True):
        for mode, color in (("off", "#c55"), ("on", "#26a")):
            seconds = [FRAME * n for n in range(len(both[mode]["levels_lost"]))]
            lost.plot(seconds, both[mode]["levels_lost"], color=color, label=f"look-ahead {mode}", linewidth=1.2)
            received.plot(seconds, [value / 1e6 for value in both[mode]["bytes"]], color=color, linewidth=1.2)
        lost.set(title=name, ylabel="levels lost", ylim=(0, None))
        received.plot(seconds, [BANDWIDTH * t / 1e6 for t in seconds], color="#aaa", linewidth=0.8)
        received.set(xlabel="seconds", ylabel="MB received (grey: the link)", ylim=(0, None))
    axes[0][0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(picture, dpi=110)


def main() -> None:
    """Flies over the scenes named, saves their curves and plots them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--save", type=Path)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--drawn", type=int, metavar="N", help="looking ahead only, every Nth frame drawn and timed")
    given = parser.parse_args()
    kept: dict[str, Any] = json.loads(given.save.read_text()) if given.save and given.save.exists() else {}
    with opened_browser() as browser:
        for name in given.scenes:
            journey = replace(SCENES[name](), seconds=given.seconds)
            flown = (
                {"drawn": _drawn(browser, journey, given.drawn)} if given.drawn else _both(browser, journey, BANDWIDTH)
            )
            print(json.dumps({name: _facts(flown)}, indent=1), flush=True)
            one = kept.setdefault(name, {"curves": {}, "facts": {}})
            one["facts"] |= _facts(flown)
            one["curves"] |= {mode: _curves(each) for mode, each in flown.items()}
            if given.save:
                given.save.write_text(json.dumps(kept))
    if given.plot:
        plot({name: one["curves"] for name, one in kept.items()}, given.plot)


if __name__ == "__main__":
    main()
