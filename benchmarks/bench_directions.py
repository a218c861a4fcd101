"""How many directions a world needs, and how many of a cell a viewer draws (OV Figure 5): narrow streets, and trees.

    farfield bench directions [--quick] [--json]
    python benchmarks/bench_directions.py [--work DIR] [--data DIR] [--pictures DIR]      leaves the pictures as well

The square kilometre of Tokyo of bench_quality.py at half its size (256 px, pictures of 320 x 240, every third of its
cameras) and the grove of bench_antialiasing.py, from r on, baked with each preset of directions and two layers. Of each
world 2, 3 and 5 directions of a cell are drawn, and the tiles that the index picks: covered PSNR and FLIP against the
geometry, bytes of the tiles in a picture, and beside them the bytes of all tiles and of the world.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from bench_antialiasing import Grove, seen_from, write_scene
from bench_quality import DATA, FOLDER, LEAF_SIZE, WORK, Case, baked, compared, summary
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.view.path import read_path
from farfield.view.renderer import RenderOptions
from farfield.view.tiles import TileCache
from farfield.world.world import World

sys.path.insert(0, str(FOLDER.parent / "scripts"))
from convert_tokyo import write_flatgeobuf

PRESETS = ("5", "9", "13", "17", "26")
"""Directions that a world holds of each cell."""
DRAWN = {str(views): RenderOptions(views=views) for views in (2, 3, 5)} | {"picks": RenderOptions()}
"""What is drawn of a cell: so many directions, or the tiles that its index picks."""
SIZE = 320, 240
EVERY = 3
"""Of the cameras under benchmarks/cameras."""


def run(quick: bool = False) -> dict[str, Any]:
    """Scene -> preset -> bytes, and what is drawn -> figures; quick: a few houses, two presets, one small picture."""
    with tempfile.TemporaryDirectory(prefix="farfield-directions-") as name:
        work = Path(name)
        if quick:
            return {"blocks": figures(blocks(work, "5"), ("5", "9"), work)}
        return both_scenes(work, DATA)


def both_scenes(work: Path, data: Path, pictures: Path | None = None) -> dict[str, Any]:
    """See `run`. pictures: folder for SCENE/PRESET/DRAWN-CAMERA.png."""
    cases = {"tokyo": tokyo(work / "tokyo", data, PRESETS[0]), "grove": grove(work / "grove", PRESETS[0])}
    return {
        name: figures(case, PRESETS, work / name, None if pictures is None else pictures / name)
        for name, case in cases.items()
    }


def figures(case: Case, presets: tuple[str, ...], work: Path, pictures: Path | None = None) -> dict[str, Any]:
    """Of one scene. case: with the world of the first preset; pictures: folder for PRESET/DRAWN-CAMERA.png."""
    found: dict[str, Any] = {}
    for preset in presets:
        grid = case.world.grid
        case = replace(case, world=_baked(case.scene, work, preset, grid.leaf_size, grid.resolution))
        cache = TileCache(case.world, 1 << 30)
        found[preset] = {
            "tile_bytes": sum(size for entry in case.world.cells() for _, _, size in entry.tiles),
            "world_bytes": case.world.manifest.statistics.bytes,
        }
        for name, options in DRAWN.items():
            pictured = pictures and pictures / preset / f"{name}.png"
            rows = summary(list(compared(case, options, cache, pictured)))
            found[preset][name] = {key: rows[key] for key in ("psnr_covered", "flip_covered", "tile_bytes", "splats")}
    return found


def tokyo(work: Path, data: Path, preset: str) -> Case:
    """The square kilometre, from every third of its cameras."""
    from scenes import make

    scene = make("tokyo", data, work / "scenes")
    cameras = tuple(frame.camera for frame in read_path(FOLDER / "cameras/tokyo.json").frames[::EVERY])
    return Case(scene, _baked(scene, work, preset, LEAF_SIZE["tokyo"], 256), cameras, 0, work / "truth", SIZE)


def grove(work: Path, preset: str) -> Case:
    """The trees, from both cameras."""
    kind, scene = Grove(), write_scene(Grove(), work)
    return seen_from(kind, scene, _baked(scene, work, preset, kind.leaf_size, kind.resolution), 0, work)


def blocks(work: Path, preset: str) -> Case:
    """Sixteen houses 8 m wide and up to 20 m high with 3 m between them."""
    random = np.random.default_rng(5)
    corners = [(11.0 * x, 11.0 * y) for x in range(4) for y in range(4)]
    houses = np.array([shapely.box(x, y, x + 8, y + 8) for x, y in corners], object)
    write_flatgeobuf(work / "houses.fgb", houses, random.uniform(8, 20, len(houses)))
    scene = work / "scene.toml"
    scene.write_text(
        'crs = "EPSG:6677"\norigin = [0.0, 0.0, 0.0]\n\n[[source]]\npath = "houses.fgb"\nheight_attribute = "height"\n'
    )
    camera = Camera((-30.0, -40.0, 40.0), (20.0, 20.0, 5.0))
    return Case(scene, _baked(scene, work, preset, 16.0, 64), (camera,), 0, work / "truth", (80, 60), 4)


def _baked(scene: Path, work: Path, preset: str, leaf_size: float, resolution: int) -> World:
    options = BakeOptions(leaf_size=leaf_size, resolution=resolution, directions=preset, workers=1)
    return baked(scene, work / f"world-{preset}", options)


SHOWN = (("true", "5/3", "9/3", "17/3"), ("9/2", "9/5", "9/picks", "17/5"))
"""Rows of the figure: PRESET/DRAWN."""
HEIGHT = 196
"""Pixels of a picture that the figure shows: below them is what is left out."""


def panel(folder: Path, camera: int) -> NDArray[np.uint8]:
    """The true picture, then three of 5, 9 and 17 directions; below, 2 and 5 of 9, picks of 9, and 5 of 17."""
    return np.concatenate([np.concatenate([_tile(folder, name, camera) for name in row], axis=1) for row in SHOWN])


def _tile(folder: Path, name: str, camera: int) -> NDArray[np.uint8]:
    left = SIZE[0] * (name != "true")
    with Image.open(folder / f"{'9/3' if name == 'true' else name}-{camera:02d}.png") as image:
        return np.array(image.convert("RGB").crop((left, 0, left + SIZE[0], HEIGHT)))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=WORK.with_name("directions"))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--pictures", type=Path, help="where to leave pictures side by side")
    given = parser.parse_args()
    print(json.dumps(both_scenes(given.work, given.data, given.pictures), indent=1))
    if given.pictures:
        Image.fromarray(panel(given.pictures / "tokyo", 3)).save(given.pictures / "panel.png")


if __name__ == "__main__":
    main()
