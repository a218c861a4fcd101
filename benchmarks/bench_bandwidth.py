"""Bytes a second depend on the speed, not on the size of the world (OV 4.2): landscapes of 1, 8 and 64 times the area.

    farfield bench bandwidth [--quick] [--json]

A patch of land and forest (`farfield make landscape`) alone, in the middle of 8 and of 64 like it, so that the same
paths lead over the same ground. The real page flies them in steps; at each it has fetched the whole cut, seen or not,
before it goes on. Bytes count from the first step on: of tiles, geometry and index, by HTTP. Then, in the largest
world, longer paths at 1, 2, 4 and 8 times the height: the speed at which they need a link of 20 Mbit/s. Pixels of
leaves are 1 m wide and the picture is so small that leaves are fine enough from 24 m on: a patch is 21 times as wide,
so that it has all the levels whose cells change often.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser

from farfield.bake.options import BakeOptions
from farfield.pipeline import bake_sources
from farfield.scene.procedural.landscape import LandscapeOptions, make_landscape
from farfield.serve.run import ServeOptions, serving
from farfield.store.contract import Store
from farfield.store.opening import open_store

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser, visiting

Triple = tuple[float, float, float]
LEAF = 64.0
"""Metres."""
SIZE = (160, 120)
OPTIONS = {"supersampling": 1, "bias": 2.5, "ahead": 0, "cacheBytes": 3 << 30, "uploadBytes": 1 << 30}
"""Of the page: leaves are fine enough from 0.38 of their size on."""
SPEED = 20.0
"""Metres a second."""
LINK = 20e6 / 8
"""Bytes a second."""
PATCHES: dict[str, list[tuple[int, int]]] = {
    "1": [(0, 0)],
    "8": [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (1, 1)],
    "64": [(x, y) for x in range(-4, 4) for y in range(-4, 4)],
}
"""Where patches lie by how many there are, in patches; the paths are in the one at 0, 0."""

FLY = """async eyes => {
  const rest = async () => {
    await farfield.whenComplete();
    for (let quiet = 0; quiet < 3; ) {
      await new Promise(requestAnimationFrame);
      quiet = farfield.stats().under_way > 0 ? 0 : quiet + 1;
    }
  };
  const bytes = [];
  for (const [x, y, z] of eyes) {
    farfield.setCamera({eye: [x, y, z], target: [x + 100, y + 40, z - 40], fov: 46.8});
    await rest();
    bytes.push(farfield.stats().bytes);
  }
  return bytes;
}"""
"""Flies from eye to eye; gives the bytes received so far at each."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """What is flown over, and how."""

    leaves: int
    """Along the side of a patch."""
    resolution: int
    paths: int
    """Side by side."""
    length: float
    """Metres of a path."""
    height: float
    """Metres above the land, of the lowest flight; leaves end at 64 m."""
    worlds: tuple[str, ...] = tuple(PATCHES)

    @property
    def side(self) -> float:
        """Metres, of a patch."""
        return self.leaves * LEAF


FULL = Sizes(leaves=8, resolution=64, paths=3, length=256.0, height=50.0)
QUICK = Sizes(leaves=2, resolution=16, paths=1, length=64.0, height=50.0, worlds=("1", "8"))


def run(quick: bool = False) -> dict[str, Any]:
    """Bytes a second by world, and the speed that the link allows by height."""
    sizes = QUICK if quick else FULL
    with tempfile.TemporaryDirectory(prefix="farfield-bandwidth-") as name, opened_browser() as browser:
        folder = Path(name)
        worlds = {count: _baked(folder, count, sizes) for count in sizes.worlds}
        rates = {count: _bytes_a_second(browser, store, sizes) for count, store in worlds.items()}
        values = [rate["bytes_a_second"] for rate in rates.values()]
        return {
            "speed": SPEED,
            "area": rates,
            "spread": round(max(values) / min(values) - 1, 3),
            "height": _by_height(browser, worlds[sizes.worlds[-1]], sizes),
        }


def _baked(folder: Path, count: str, sizes: Sizes) -> Store:
    place = folder / f"world-{count}"
    options = BakeOptions(leaf_size=LEAF, resolution=sizes.resolution, directions="9", depth_layers=1, workers=2)
    bake_sources([_scene(folder / f"scene-{count}", PATCHES[count], sizes)], place, options)
    return open_store(str(place))


def _scene(folder: Path, patches: list[tuple[int, int]], sizes: Sizes) -> Path:
    """The scene.toml of like patches side by side."""
    made = make_landscape(
        folder, LandscapeOptions(side=sizes.side, step=8.0, relief=2.0, tree_triangles=60, towns=0, seed=5)
    )
    shifts = sizes.side * np.array(patches, dtype=np.float64)
    lines = []
    for land in sorted(folder.glob("land-*.glb")):
        table = np.column_stack([shifts, np.zeros((len(shifts), 2)), np.ones(len(shifts))])
        np.save(land.with_suffix(".npy"), table)
        lines.append(f'[[source]]\npath = "{land.name}"\ninstances = "{land.stem}.npy"\n')
    for trees in sorted(folder.glob("trees-*.npy")):
        table = np.load(trees)
        moved = [table + np.array([x, y, 0, 0, 0]) for x, y in shifts]
        np.save(trees, np.concatenate(moved))
    text = made.path.read_text()
    lines += [part for part in text.split("\n\n") if "trees-" in part]
    made.path.write_text("\n\n".join(lines))
    return made.path


def _bytes_a_second(browser: Browser, store: Store, sizes: Sizes) -> dict[str, float]:
    bytes_, metres, first = 0.0, 0.0, 0.0
    for path in _paths(sizes, sizes.height, sizes.length):
        received = _flown(browser, store, path)
        first += received[0] / sizes.paths
        bytes_ += received[-1] - received[0]
        metres += sizes.length
    return {
        "first_picture_bytes": round(first),
        "bytes_a_metre": round(bytes_ / metres, 1),
        "bytes_a_second": round(SPEED * bytes_ / metres),
    }


def _by_height(browser: Browser, store: Store, sizes: Sizes) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for times in (1, 2, 4, 8):
        height, length = times * sizes.height, times * sizes.length
        received = _flown(browser, store, next(_paths(sizes, height, length)))
        metre = (received[-1] - received[0]) / length
        found[f"{height:.0f}"] = {"bytes_a_metre": round(metre, 1), "most_speed": round(LINK / max(metre, 1e-9), 1)}
    return found


def _paths(sizes: Sizes, height: float, length: float) -> Iterator[list[Triple]]:
    """Eyes along lines through the middle of the patch at 0, 0."""
    for n in range(sizes.paths):
        aside = (n - (sizes.paths - 1) / 2) * LEAF * 1.3
        along = np.linspace(-length / 2, length / 2, round(length / (LEAF / 8) * sizes.height / height) + 1)
        middle = sizes.side / 2
        yield [(middle + s, middle + aside + 0.3 * s, height) for s in along.tolist()]


def _flown(browser: Browser, store: Store, eyes: list[Triple]) -> list[float]:
    """Bytes received at each of the eyes, from an empty cache on."""
    with serving(store, ServeOptions(port=0)) as url, visiting(browser, url, SIZE) as page:
        page.options(**OPTIONS)
        received: list[float] = page.do(FLY, eyes)
        return received
