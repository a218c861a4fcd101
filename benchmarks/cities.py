"""Tokyo as scenes for BlockMaps, written from `tokyo23_lod1`: footprints with heights on a plane of asphalt.

    python benchmarks/cities.py DATA OUTPUT [city|quarter|wards|unique ...]

wards: all 1,768,200 buildings of the 23 wards. city: 80,414 of them, as many as the paper's Paris has, those in the
square round Tokyo Station that holds so many. quarter: a quarter of these. unique: the same 80,414 with a façade of its
own for each. The same input gives the same scenes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenes import ground, write

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from convert_tokyo import BATCH, CRS, encoded, open_archive, write_encoded

PARIS = 80_414
"""Buildings (BLK 5)."""
STATION = (-5790.0, -35360.0)
"""EPSG:6677 coordinates of Tokyo Station."""
CREDIT = "github.com/indigo-lab/plateau-tokyo23ku-building-mvt-2020, from Project PLATEAU (MLIT Japan); CC BY 4.0"
BESIDE = 100.0
"""Metres of ground beyond the first vertices of all buildings."""


def wards(data: Path, folder: Path) -> Path:
    """All of Tokyo. Returns the scene.toml."""
    return _scene(data, folder, None)


def city(data: Path, folder: Path) -> Path:
    """As many buildings as Paris has. Returns the scene.toml."""
    return _scene(data, folder, PARIS)


def quarter(data: Path, folder: Path) -> Path:
    """A quarter as many. Returns the scene.toml."""
    return _scene(data, folder, PARIS // 4)


def unique(data: Path, folder: Path) -> Path:
    """The same with unique façades. Returns the scene.toml."""
    return _scene(data, folder, PARIS, 'facades = "unique"')


def _scene(data: Path, folder: Path, count: int | None, *keys: str) -> Path:
    archive = open_archive(data / "tokyo23_lod1/buildings.npz")
    first = archive.anchor[archive.first_ring[:-1]] * 0.1 + archive.origin
    away = np.abs(first - STATION).max(axis=1)
    buildings = np.sort(np.argsort(away, kind="stable")[:count])
    kind = archive.kind(buildings)
    batches = (buildings[at : at + BATCH] for at in range(0, len(buildings), BATCH))
    wkb = np.concatenate([encoded(archive.shapes(batch), kind) for batch in batches])
    write_encoded(folder / "buildings.fgb", wkb, archive.height[buildings], kind)
    lower, upper = first[buildings].min(axis=0), first[buildings].max(axis=0)
    origin = np.floor(lower / 1024) * 1024
    middle = ((lower + upper) / 2 - origin).tolist()
    return write(folder, [
        f'crs = "{CRS}"', f"origin = [{origin[0]}, {origin[1]}, 0.0]", f"credits = {json.dumps([CREDIT])}",
        "\n".join(['[[source]]\npath = "buildings.fgb"\nheight_attribute = "height"', *keys]),
        ground(float((upper - lower).max()) + 2 * BESIDE, "asphalt", (middle[0], middle[1])),
    ])  # fmt: skip


SCENES: dict[str, Callable[[Path, Path], Path]] = {"city": city, "quarter": quarter, "wards": wards, "unique": unique}


def make(name: str, data: Path, output: Path) -> Path:
    """Writes one scene into its folder below `output`, unless it is there, and returns its scene.toml."""
    folder = output / name
    if not (folder / "scene.toml").exists():
        folder.mkdir(parents=True, exist_ok=True)
        SCENES[name](data.resolve(), folder)
    return folder / "scene.toml"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("names", nargs="*", default=list(SCENES))
    given = parser.parse_args()
    for name in given.names:
        print(make(name, given.data, given.output))


if __name__ == "__main__":
    main()
