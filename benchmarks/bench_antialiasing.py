"""What is filtered when baked against what is when drawn (OV 5.1, Figure 6): trees near and far, samples of both sides.

    farfield bench antialiasing [--quick] [--json]
    python benchmarks/bench_antialiasing.py [--work DIR] [--pictures DIR]      leaves the pictures as well

A grove of the package's trees, baked with 1, 2 x 2 (the default) and 4 x 4 samples a leaf pixel, each drawn with 1,
2 x 2 and 4 x 4 samples a pixel of the picture, from r and from 8 r on, three levels up. Beside it, what is filtered by
the picture alone: the geometry, and the leaves at every distance, with as many samples. Covered PSNR and FLIP against
the geometry with 144 samples a pixel, and megabytes of tiles in a picture.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench_quality import FOLDER, WORK, Case, baked, compared, save_side_by_side, summary, truth
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import compare
from farfield.scene.read import read_scene
from farfield.view.left_out import LeftOut
from farfield.view.renderer import RenderOptions
from farfield.view.tiles import TileCache
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.world import World

DEMO = FOLDER.parent / "src/farfield/demo"
BAKED = (1, 2, 4)
DRAWN = (1, 2, 4)
"""Samples along each side of a pixel: of a leaf, and of the picture."""
DEFAULT = 2
"""Of BAKED; its leaves are drawn from afar as well."""
FOV = 46.8264
"""Vertical, degrees; 60 across."""


@dataclass(frozen=True, slots=True)
class Grove:
    """How large everything is."""

    side: float = 128.0
    """Metres."""
    trees: int = 60
    leaf_size: float = 16.0
    resolution: int = 128
    size: tuple[int, int] = (320, 240)
    truth: int = 12
    """Samples of the true picture along each side of a pixel."""
    headings: tuple[float, ...] = (20.0, 140.0)
    """From which cameras look at the middle, degrees."""
    levels: tuple[int, ...] = (0, 3)
    """n of 2^n r, the distance of the nearest trees."""


QUICK = Grove(48.0, 3, 16.0, 32, (64, 48), 6, (20.0,), (0, 1))


def run(quick: bool = False) -> dict[str, Any]:
    """Distance -> what is baked -> samples of the picture -> figures; quick: three trees in small pictures."""
    with tempfile.TemporaryDirectory(prefix="farfield-antialiasing-") as name:
        return figures(QUICK if quick else Grove(), Path(name))


def figures(grove: Grove, work: Path, pictures: Path | None = None) -> dict[str, Any]:
    """See `run`. pictures: folder for DISTANCE-BAKED-DRAWN-CAMERA.png."""
    scene = write_scene(grove, work)
    worlds = {samples: _baked(grove, scene, work, samples) for samples in BAKED}
    found: dict[str, Any] = {}
    for up in grove.levels:
        case = seen_from(grove, scene, worlds[DEFAULT], up, work)
        prefix = pictures and pictures / f"{2**up}r"
        rows = {"geometry": _summaries({k: list(_geometry(case, k, prefix)) for k in DRAWN})}
        if up:
            rows["leaves"] = _pictures(case, -float(up), prefix and prefix.with_name(f"{prefix.name}-leaves"))
        for samples, world in worlds.items():
            named = prefix and prefix.with_name(f"{prefix.name}-{samples}")
            rows[f"{samples} x {samples}"] = _pictures(replace(case, world=world), 0.0, named)
        found[f"from {2**up} r on"] = rows
    return found


def _pictures(case: Case, bias: float, pictures: Path | None) -> dict[str, dict[str, float]]:
    """Samples of the picture -> figures, drawn from orthoviews."""
    cache, rows = TileCache(case.world, 1 << 30), {}
    for samples in DRAWN:
        pictured = pictures and pictures.with_name(f"{pictures.name}-{samples}.png")
        options = RenderOptions(supersampling=samples, bias=bias)
        rows[samples] = list(compared(case, options, cache, pictured))
    return _summaries(rows)


def _geometry(case: Case, samples: int, pictures: Path | None) -> Iterator[dict[str, float]]:
    """The measures of geometry drawn with fewer samples than the true picture."""
    for number, camera in enumerate(case.cameras):
        left_out = LeftOut(case.world.grid, camera.eye, case.near_radius(camera))
        options = TruthOptions(samples, left_out=left_out)
        pixels = draw_truth(read_scene([case.scene]), camera, case.size, options).pixels(None)
        if pictures is not None:
            file = pictures.with_name(f"{pictures.name}-geometry-{samples}-{number:02d}.png")
            save_side_by_side(file, truth(case, number), pixels)
        yield compare(truth(case, number), pixels)


def _summaries(rows: dict[int, list[dict[str, float]]]) -> dict[str, dict[str, float]]:
    kept = ("psnr_covered", "flip_covered", "tile_bytes")
    means = {samples: summary(measures) for samples, measures in rows.items()}
    return {f"{k} x {k}": {name: mean[name] for name in kept if name in mean} for k, mean in means.items()}


def seen_from(grove: Grove, scene: Path, world: World, up: int, work: Path) -> Case:
    """The grove, its nearest trees 2^up r away from cameras that look down on it by some ten degrees."""
    radius = grove.leaf_size * grove.size[0] / (2 * grove.resolution * math.tan(math.radians(30)))
    away = 0.5 * grove.side + 1.05 * 2**up * radius
    cameras = []
    for heading in grove.headings:
        x, y = away * math.cos(math.radians(heading)), away * math.sin(math.radians(heading))
        cameras.append(Camera((x, y, 12.0 + away / 6), (0.0, 0.0, 8.0), FOV))
    return Case(scene, world, tuple(cameras), up, work / f"truth-{up}", grove.size, grove.truth)


def write_scene(grove: Grove, folder: Path) -> Path:
    """Oaks and aspens at random on grass. Returns the scene.toml."""
    random, half = np.random.default_rng(60), grove.side / 2 - 8
    folder.mkdir(parents=True, exist_ok=True)
    places = random.uniform(-half, half, (grove.trees, 2))
    turned, scale = random.uniform(0, 360, grove.trees), random.uniform(0.6, 1.0, grove.trees)
    table = np.column_stack([places, np.zeros(grove.trees), turned, scale])
    parts = [f'[[ground]]\nsize = {grove.side}\ntexture = "grass"']
    for k, name in enumerate(("oak_medium", "aspen_medium")):
        np.save(folder / f"{name}.npy", table[k::2])
        parts.append(f'[[source]]\npath = "{DEMO / name}.glb"\ninstances = "{name}.npy"')
    path = folder / "scene.toml"
    path.write_text("\n\n".join(parts) + "\n")
    return path


def _baked(grove: Grove, scene: Path, work: Path, samples: int) -> World:
    options = BakeOptions(leaf_size=grove.leaf_size, resolution=grove.resolution, samples=samples, workers=1)
    return baked(scene, work / f"world-{samples}", options)


SHOWN = (("true", "geometry-1", "geometry-4"), ("1-4", "2-1", "2-4"))
"""Rows of the figure, once for each distance: BAKED-DRAWN."""
PARTS = {"1r": (40, 70, 200, 160), "8r": (80, 100, 240, 150)}
"""Distance -> what the figure shows, pixels of the picture; twice as large."""


def panel(folder: Path) -> NDArray[np.uint8]:
    """True picture, geometry with 1 and 16 samples; below, tiles of 1 drawn with 16, tiles of 4 with 1 and with 16."""
    rows = [[_tile(folder, distance, name) for name in row] for distance in PARTS for row in SHOWN]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def _tile(folder: Path, distance: str, name: str) -> NDArray[np.uint8]:
    left, top, right, bottom = PARTS[distance]
    aside = Grove().size[0] * (name != "true")
    with Image.open(folder / f"{distance}-{'2-4' if name == 'true' else name}-00.png") as image:
        part = image.convert("RGB").crop((left + aside, top, right + aside, bottom))
    return np.array(part.resize((2 * part.width, 2 * part.height), Image.Resampling.NEAREST))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=WORK.with_name("antialiasing"))
    parser.add_argument("--pictures", type=Path, help="where to leave pictures side by side")
    given = parser.parse_args()
    print(json.dumps(figures(Grove(), given.work, given.pictures), indent=1))
    if given.pictures:
        Image.fromarray(panel(given.pictures)).save(given.pictures / "panel.png")


if __name__ == "__main__":
    main()
