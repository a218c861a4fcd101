"""How near the far field comes to the true picture: covered PSNR and FLIP of the three scenes (benchmarks/scenes.py).

    python benchmarks/bench_quality.py [--work DIR] [--data DIR] [--scenes tokyo,forest,statues] [--pictures DIR]

Each scene is baked with the default options, then drawn from pictures alone and compared with its geometry at the
cameras under benchmarks/cameras: NAME.json from r on, NAME_far.json from 4 r on ("two levels up"). Worlds and true
pictures are kept in the work folder; a true picture of a million triangles in 64 samples takes 15 s.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.quality.metrics import compare
from farfield.quality.pictures import read_picture
from farfield.scene.read import read_scene
from farfield.store.opening import open_store
from farfield.view.left_out import LeftOut
from farfield.view.path import read_path
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, picture_radius, render_world
from farfield.view.tiles import TileCache
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.world import World

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "worlds" / "quality"
DATA = Path(os.environ.get("FARFIELD_SHARED_DATA", FOLDER.parent.parent / "shared/data"))
SIZE = 640, 480
LEAF_SIZE = {"tokyo": 128.0, "forest": 32.0, "statues": 4.0, "avenues": 128.0}
"""Metres: some 70 leaves a scene, and its side is twice the near radius of the far cameras."""
LEVELS_UP = {"leaf": 0, "far": 2}
GOALS = {"tokyo": (29.5, 0.07), "forest": (26.5, 0.15), "statues": (33.0, 0.042)}
"""Least PSNR in dB and largest FLIP over covered pixels, from r on."""
LESS = 1.5
"""dB by which pictures farther up may be worse."""
VARIANTS = ("gain40", "gain20", "gain10", "gain5", "3x1", "3x2", "5x1", "5x2")
"""What is drawn of a cell: tiles by least gain a kilobyte, or VIEWS x LAYERS."""
DEFAULT = "gain10"


@dataclass(frozen=True, slots=True)
class Case:
    """A scene at a level: its world, its cameras and what is left out."""

    scene: Path
    world: World
    cameras: tuple[Camera, ...]
    levels_up: int
    truths: Path
    """Folder of the true pictures, made when they are missing."""
    size: tuple[int, int] = SIZE
    samples: int = 8
    """Of a true picture, along each side of a pixel."""

    def near_radius(self, camera: Camera) -> float:
        """2^n r, metres."""
        return float(picture_radius(self.world, camera, self.size) * 2.0**self.levels_up)


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of every scene; quick: of a few statues and trees that come with the package, in small pictures."""
    if quick:
        return {"small": measure(small_case(Path(tempfile.mkdtemp(prefix="farfield-quality-"))), (DEFAULT,))}
    return figures(WORK, DATA, list(GOALS), VARIANTS)


def figures(
    work: Path, data: Path, names: Sequence[str], variants: Sequence[str], pictures: Path | None = None
) -> dict[str, Any]:
    """scene -> level -> variant -> figures, and whether the default variant meets the goals.

    pictures: folder for SCENE-LEVEL/VARIANT-CAMERA.png: true picture, picture and difference, side by side.
    """
    found: dict[str, Any] = {}
    for name in names:
        found[name] = {}
        for level in LEVELS_UP:
            folder = None if pictures is None else pictures / f"{name}-{level}"
            found[name][level] = measure(case(name, level, work, data), variants, folder)
    return {"scenes": found, "goals_met": {name: meets(name, levels) for name, levels in found.items()}}


def meets(name: str, levels: dict[str, Any]) -> bool:
    """Whether the default variant reaches the goals: PSNR and FLIP at the leaves, PSNR above."""
    psnr, flip = GOALS[name]
    found = {level: variants[DEFAULT] for level, variants in levels.items() if DEFAULT in variants}
    least = {level: psnr - LESS * (LEVELS_UP[level] > 0) for level in found}
    return (
        bool(found)
        and all(figures["psnr_covered"] >= least[level] for level, figures in found.items())
        and all(figures["flip_covered"] <= flip for level, figures in found.items() if LEVELS_UP[level] == 0)
    )


def measure(case: Case, variants: Sequence[str], pictures: Path | None = None) -> dict[str, Any]:
    """Variant -> means over the cameras. pictures: where to leave side-by-side pictures."""
    found = {}
    cache = TileCache(case.world, 2 << 30)
    for name in variants:
        pictured = pictures and pictures / f"{name}.png"
        found[name] = summary(list(compared(case, options_of(name), cache, pictured)))
    return found


def options_of(variant: str) -> RenderOptions:
    """Of a variant, such as gain10 or 3x2."""
    if variant.startswith("gain"):
        return RenderOptions(least_gain=float(variant.removeprefix("gain")))
    views, layers = variant.split("x")
    return RenderOptions(views=int(views), layers=int(layers))


def summary(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Means of the rows of `compared`."""
    return {name: round(fmean(row[name] for row in rows), 4) for name in rows[0]}


def compared(
    case: Case, options: RenderOptions, cache: TileCache, pictures: Path | None = None
) -> Iterator[dict[str, float]]:
    """For each camera the measures of its picture against the true one, and what it cost."""
    for number, camera in enumerate(case.cameras):
        chosen = replace(options, far_only=True, near_radius=case.near_radius(camera))
        picture = render_world(case.world, camera, case.size, chosen, cache)
        pixels, reference = picture.pixels(None), truth(case, number)
        if pictures is not None:
            save_side_by_side(pictures.with_stem(f"{pictures.stem}-{number:02d}"), reference, pixels)
        yield compare(reference, pixels) | costs(picture)


def costs(picture: Picture) -> dict[str, float]:
    """Of one picture."""
    s = picture.statistics
    return {"cells": s.cells, "splats": s.splats, "tile_bytes": s.tile_bytes, "seconds": s.seconds}


def truth(case: Case, number: int) -> NDArray[np.uint8]:
    """(h, w, 4) uint8: the true picture of a camera, drawn once and kept."""
    file = case.truths / f"{number:02d}.png"
    if not file.exists():
        camera = case.cameras[number]
        left_out = LeftOut(case.world.grid, camera.eye, case.near_radius(camera))
        picture = draw_truth(read_scene([case.scene]), camera, case.size, TruthOptions(case.samples, left_out=left_out))
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(picture.pixels(None)).save(file)
    return read_picture(file)


def save_side_by_side(file: Path, reference: NDArray[np.uint8], picture: NDArray[np.uint8]) -> None:
    """True picture, picture, and twice their difference about grey."""
    from farfield.quality.metrics import over_sky

    a, b = (over_sky(p, (158, 191, 235)).astype(int) for p in (reference, picture))
    difference = np.clip(128 + 2 * (b - a), 0, 255)
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate([a, b, difference], axis=1).astype(np.uint8)).save(file)


def case(name: str, level: str, work: Path, data: Path) -> Case:
    """One of the three scenes, baked into the work folder unless it is there."""
    from scenes import make

    scene = make(name, data, work / "scenes")
    world = baked(scene, work / name, BakeOptions(leaf_size=LEAF_SIZE[name]))
    file = FOLDER / "cameras" / (f"{name}.json" if level == "leaf" else f"{name}_{level}.json")
    cameras = tuple(frame.camera for frame in read_path(file).frames)
    return Case(scene, world, cameras, LEVELS_UP[level], work / f"{name}-truth-{level}")


def baked(scene: Path, folder: Path, options: BakeOptions) -> World:
    """The world of a scene; what was baked before is taken as it is."""
    if not (folder / "world.json").exists():
        bake(read_scene([scene]), open_store(folder, create=True), options)
    return World.open(open_store(folder))


def small_case(work: Path) -> Case:
    """Statues and a tree of the demo on a ground, at an eighth of the resolution, in small pictures."""
    demo = FOLDER.parent / "src/farfield/demo"
    places = {"pan": (0, 0), "eagle": (14, 4), "theodoric_the_great": (4, 14), "aspen_medium": (13, 14)}
    sources = [
        f'[[source]]\npath = "{demo / name}.glb"\ntranslate = [{x}.0, {y}.0, 0.0]' for name, (x, y) in places.items()
    ]
    scene = work / "scene.toml"
    ground = '[[ground]]\nsize = [40.0, 40.0]\ntranslate = [8.0, 8.0, 0.0]\ntexture = "paving"'
    scene.write_text("\n\n".join([*sources, ground]) + "\n")
    world = baked(scene, work / "world", BakeOptions(leaf_size=16.0, resolution=64, directions="9", workers=1))
    cameras = (Camera((-28.0, -20.0, 14.0), (8.0, 8.0, 1.0)), Camera((34.0, -24.0, 20.0), (8.0, 8.0, 1.0)))
    return Case(scene, world, cameras, 0, work / "truth", (160, 120), 4)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--pictures", type=Path, help="where to leave pictures side by side")
    parser.add_argument("--scenes", default=",".join(GOALS))
    parser.add_argument("--variants", default=",".join(VARIANTS), help="gainPIXELS or VIEWSxLAYERS, …")
    given = parser.parse_args()
    found = figures(given.work, given.data, given.scenes.split(","), given.variants.split(","), given.pictures)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER))
    main()
