"""Updates of squares of Tokyo (OV 6, Table 3): 200 m, 400 m and 800 m wide, from file to the next generation.

    farfield bench update [--quick] [--json]; needs the world that `farfield bench tokyo` leaves.

In each square every building grows by 3 m, in a file of the whole city: `farfield update WORLD FILE --region …`, a
process of its own as users call it, reads the square by the file's index, bakes what it reaches, and the paths to the
root. Beside it: an update without a region, which finds the changes by itself; and one that finds none.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio

from bench_tokyo import ARCHIVE, ROOT, SMALL

SQUARES = (200.0, 400.0, 800.0)
MIDDLE = (-12_000.0, -34_300.0)
"""In EPSG:6677, metres: Shinjuku."""


def run(quick: bool = False) -> dict[str, Any]:
    """Seconds and cells of each update."""
    if not ARCHIVE.exists():
        return {"left_out": f"{ARCHIVE.name} is absent"}
    with tempfile.TemporaryDirectory(prefix="farfield-update-") as name:
        folder = Path(name)
        if quick:
            source, world = _small(folder)
            return _measure(source, world, folder, SQUARES[:1])
        source, world = ROOT / "worlds/tokyo23/buildings.fgb", ROOT / "worlds/tokyo23/world-1"
        if not world.exists():
            return {"left_out": "farfield bench tokyo has not been run"}
        return _measure(source, world, folder, SQUARES)


def _small(folder: Path) -> tuple[Path, Path]:
    """A few hundred metres of the city as a world."""
    source, world = folder / "small.fgb", folder / "world"
    x, y = MIDDLE
    box = f"--bbox={x - 150},{y - 150},{x + 150},{y + 150}"
    script = ROOT / "scripts/convert_tokyo.py"
    subprocess.run([sys.executable, str(script), str(ARCHIVE), str(source), box], check=True, capture_output=True)
    _farfield("bake", str(source), "-o", str(world), *SMALL, "--directions", "9", "--depth-layers", "1")
    return source, world


def _measure(source: Path, world: Path, folder: Path, squares: tuple[float, ...]) -> dict[str, Any]:
    facts: dict[str, Any] = {"nothing changed, no region": _update(world, source)}
    for size in squares:
        region = tuple(float(c) for c in (*np.subtract(MIDDLE, size / 2), *np.add(MIDDLE, size / 2)))
        changed = _grown(source, folder / f"grown-{size:.0f}.fgb", region)
        facts[f"{size:.0f} m"] = _update(world, changed, "--region", ",".join(f"{c:g}" for c in region))
        facts[f"{size:.0f} m back"] = _update(world, source, "--region", ",".join(f"{c:g}" for c in region))
    facts[f"{size:.0f} m, no region"] = _update(world, changed)
    _update(world, source)
    return facts


def _grown(source: Path, target: Path, region: tuple[float, ...]) -> Path:
    """The file with buildings in the region 3 m higher."""
    meta, _, shapes, columns = pyogrio.raw.read(source)
    fields = list(meta["fields"])
    name = next(field for field in fields if "eight" in field)
    _, bounds = pyogrio.read_bounds(source)
    middle = (bounds[:2] + bounds[2:]) / 2
    x0, y0, x1, y1 = region
    chosen = (middle[0] >= x0) & (middle[0] < x1) & (middle[1] >= y0) & (middle[1] < y1)
    columns[fields.index(name)] = np.where(chosen, columns[fields.index(name)] + 3.0, columns[fields.index(name)])
    target.unlink(missing_ok=True)
    pyogrio.raw.write(target, shapes, columns, fields, crs=meta["crs"], geometry_type=meta["geometry_type"])
    return target


def _update(world: Path, source: Path, *options: str) -> dict[str, Any]:
    facts = json.loads(_farfield("update", str(world), str(source), *options, "--json"))
    return {name: facts[name] for name in ("seconds", "cells_rebuilt", "cells")}


def _farfield(*arguments: str) -> str:
    ended = subprocess.run([sys.executable, "-m", "farfield", *arguments], capture_output=True, text=True, check=True)
    return ended.stdout
