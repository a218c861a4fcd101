"""Updates of squares of Tokyo (OV 6, Table 3): 200 m, 400 m and 800 m wide, from file to the next generation.

    farfield bench update [--quick] [--json]; needs the world that `farfield bench tokyo` leaves.

In each square every building grows by 3 m, and then shrinks again, by a file of the whole city: `farfield update WORLD
FILE --region …`, a process of its own as users call it, reads the square by the file's index, bakes what it reaches,
and the paths to the root. Beside it: an update without a region, which finds the changes by itself; and one that finds
none.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio

from bench_tokyo import ARCHIVE, ROOT, SMALL

SQUARES = (200.0, 400.0, 800.0)
PLACES = {
    "Shinjuku": (-12_000.0, -34_300.0),
    "Shibuya": (-12_100.0, -37_700.0),
    "Ueno": (-5_100.0, -31_800.0),
    "Kamata": (-10_500.0, -48_500.0),
    "Nerima": (-16_300.0, -29_400.0),
}
"""Middles in EPSG:6677, metres: how many leaves a square meets depends on where it lies."""


def run(quick: bool = False) -> dict[str, Any]:
    """Seconds and cells of each update."""
    if not ARCHIVE.exists():
        return {"left_out": f"{ARCHIVE.name} is absent"}
    with tempfile.TemporaryDirectory(prefix="farfield-update-") as name:
        folder = Path(name)
        if quick:
            source, world = _small(folder)
            x0, y0, x1, y1 = pyogrio.read_info(source)["total_bounds"]
            return _measure(source, world, folder, SQUARES[:1], {"middle": ((x0 + x1) / 2, (y0 + y1) / 2)})
        source, world = ROOT / "worlds/tokyo23/buildings.fgb", ROOT / "worlds/tokyo23/world-1"
        if not world.exists():
            return {"left_out": "farfield bench tokyo has not been run"}
        return _measure(source, world, folder, SQUARES, PLACES)


def _small(folder: Path) -> tuple[Path, Path]:
    """A few hundred metres of the city as a world."""
    source, world = folder / "small.fgb", folder / "world"
    script = ROOT / "scripts/convert_tokyo.py"
    subprocess.run(
        [sys.executable, str(script), str(ARCHIVE), str(source), "--bbox=-150,-150,150,150"],
        check=True,
        capture_output=True,
    )
    _farfield("bake", str(source), "-o", str(world), *SMALL, "--directions", "9", "--depth-layers", "1")
    return source, world


def _measure(
    source: Path, world: Path, folder: Path, squares: tuple[float, ...], places: dict[str, tuple[float, float]]
) -> dict[str, Any]:
    facts: dict[str, Any] = {"nothing changed, no region": _update(world, source)}
    city = _City(source)
    grown = city.grown(folder / "grown.fgb", (-np.inf, -np.inf, np.inf, np.inf))
    for size in squares:
        found = []
        for place, middle in places.items():
            region = _square(middle, size)
            option = "--region=" + ",".join(f"{c:g}" for c in region)
            found += [_update(world, grown, option) | {"place": place}, _update(world, source, option)]
        facts[f"{size:.0f} m"] = found[::2]
        facts[f"{size:.0f} m, median seconds"] = float(np.median([update["seconds"] for update in found]))
    place, middle = next(iter(places.items()))
    one = city.grown(folder / "one.fgb", _square(middle, squares[-1]))
    facts[f"{squares[-1]:.0f} m of {place}, no region"] = _update(world, one)
    _update(world, source)
    return facts


def _square(middle: tuple[float, float], size: float) -> tuple[float, ...]:
    x, y = middle
    return x - size / 2, y - size / 2, x + size / 2, y + size / 2


class _City:
    """A file of buildings in memory."""

    def __init__(self, source: Path) -> None:
        self._meta, _, self._shapes, self._columns = pyogrio.raw.read(source)
        _, bounds = pyogrio.read_bounds(source)
        self._middle = (bounds[:2] + bounds[2:]) / 2

    def grown(self, target: Path, region: tuple[float, ...]) -> Path:
        """The file with buildings in the region 3 m higher."""
        x0, y0, x1, y1 = region
        x, y = self._middle
        chosen = (x >= x0) & (x < x1) & (y >= y0) & (y < y1)
        fields = list(self._meta["fields"])
        columns = list(self._columns)
        number = fields.index("height")
        columns[number] = np.where(chosen, columns[number] + 3.0, columns[number]).astype(columns[number].dtype)
        target.unlink(missing_ok=True)
        meta = self._meta
        pyogrio.raw.write(target, self._shapes, columns, fields, crs=meta["crs"], geometry_type=meta["geometry_type"])
        return target


def _update(world: Path, source: Path, *options: str) -> dict[str, Any]:
    begun = time.perf_counter()
    facts = json.loads(_farfield("update", str(world), str(source), *options, "--json"))
    seconds = round(time.perf_counter() - begun, 2)
    return {"seconds": seconds, "cells_rebuilt": facts["cells_rebuilt"], "cells": facts["cells"]}


def _farfield(*arguments: str) -> str:
    ended = subprocess.run([sys.executable, "-m", "farfield", *arguments], capture_output=True, text=True, check=True)
    return ended.stdout
