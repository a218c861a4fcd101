"""Shapes of splats beside each other (OV Figure 8): a tree beside a wall, drawn from one view 70 degrees aside.

    farfield bench splats [--quick] [--json]
    python benchmarks/bench_splats.py --pictures DIR      leaves the pictures as well

The paper's five (view/splats.py, b to f) and what viewers draw: covered PSNR and FLIP against the geometry, once from a
single view whose camera stands 70 degrees from the eye, the paper's setting, and once from the three views and two
layers that viewers take. 16 samples a pixel; a pixel of the picture is as large as one of the views.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from bench_quality import baked, save_side_by_side
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.octree.grid import CellKey
from farfield.quality.metrics import compare
from farfield.scene.read import read_scene
from farfield.view.frame import Frame
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.shading import Light
from farfield.view.splats import Splats
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from convert_tokyo import write_flatgeobuf

TREE = Path(__file__).parents[1] / "src/farfield/demo/oak_medium.glb"
ASIDE = math.radians(70.0)
"""Between the eye and the camera of the view, which looks along +y; the wall's normal is halfway."""
AWAY = 60.0
"""Metres from the eye to the middle."""
FOV = 20.0
SIZE = 320, 240
SAMPLES = 4
"""Along each side of a pixel; of the true picture twice as many."""


def run(quick: bool = False, pictures: Path | None = None) -> dict[str, Any]:
    """setting -> shape -> covered PSNR in dB, covered FLIP."""
    with tempfile.TemporaryDirectory(prefix="farfield-splats-") as name:
        folder = Path(name)
        scene = _scene(folder)
        size, samples = ((80, 60), 2) if quick else (SIZE, SAMPLES)
        camera = Camera((AWAY * math.sin(ASIDE), -AWAY * math.cos(ASIDE), 5.5), (0.0, 0.0, 5.5), FOV)
        pitch = 2 * math.tan(math.radians(FOV / 2)) * AWAY / size[1]
        leaf = 16.0
        options = BakeOptions(leaf_size=leaf, resolution=round(leaf / pitch / 8) * 8, directions="17", workers=1)
        world = baked(scene, folder / "world", options)
        truth = draw_truth(read_scene([scene]), camera, size, TruthOptions(2 * samples)).pixels(None)
        found: dict[str, Any] = {"one view, 70 degrees aside": {}, "three views, two layers": {}}
        for splats in Splats:
            drawn = _one_view(world, camera, size, samples, splats), _viewer(world, camera, size, samples, splats)
            for setting, picture in zip(found, drawn, strict=True):
                pixels = picture.pixels(None)
                figures = compare(truth, pixels)
                found[setting][splats.value] = [round(figures[name], 4) for name in ("psnr_covered", "flip_covered")]
                if pictures is not None:
                    save_side_by_side(pictures / f"{setting[:3]}-{splats.value}.png", truth, pixels)
        return found


def _scene(folder: Path) -> Path:
    """An oak, and a façade 12 m wide beside and behind it. Returns the scene.toml."""
    normal = ASIDE / 2
    along, behind = np.array([math.cos(normal), math.sin(normal)]), np.array([-math.sin(normal), math.cos(normal)])
    corners = [3.0 * behind + u * along + v * behind for u, v in ((-1, 0), (11, 0), (11, 2), (-1, 2))]
    write_flatgeobuf(folder / "wall.fgb", np.array([shapely.Polygon(corners)], object), np.array([9.0]))
    path = folder / "scene.toml"
    path.write_text(
        f'crs = "EPSG:6677"\norigin = [0.0, 0.0, 0.0]\n\n[[source]]\npath = "wall.fgb"\nheight_attribute = "height"\n\n'
        f'[[source]]\npath = "{TREE}"\ntranslate = [{-3.0 * along[0]}, {-3.0 * along[1]}, 0.0]\n'
    )
    return path


def _viewer(world: World, camera: Camera, size: tuple[int, int], samples: int, splats: Splats) -> Picture:
    options = RenderOptions(supersampling=samples, near_radius=0.0, far_only=True, splats=splats)
    return render_world(world, camera, size, options)


def _one_view(world: World, camera: Camera, size: tuple[int, int], samples: int, splats: Splats) -> Picture:
    """All leaves from the first layer of the view that looks along +y."""
    frame, light = Frame.empty(camera, size, samples), Light()
    direction = next(d for d in world.manifest.direction_by_number.values() if d.vector == (0.0, -1.0, 0.0))
    for cell in _leaves(world):
        entry = world.entry(cell)
        if (direction.number, 0) in {(d, layer) for d, layer, _ in entry.tiles}:
            layer = world.tile(entry, direction.number, 0).layer
            frame.splat(layer, direction, world.grid, 0, light, None, splats)
    return frame.develop(light)


def _leaves(world: World) -> list[CellKey]:
    pending, leaves = list(world.roots), []
    while pending:
        cell = pending.pop()
        pending += world.children(cell)
        leaves += [cell] if cell.level == 0 else []
    return leaves


def panel(folder: Path, setting: str) -> NDArray[np.uint8]:
    """The true picture and the six shapes in a row each: whole, and two parts four times as large."""
    columns = []
    for splats in (None, *Splats):
        name = (splats or Splats.COVERED).value
        with Image.open(folder / f"{setting[:3]}-{name}.png") as image:
            start = SIZE[0] * (splats is not None)
            whole = image.convert("RGB").crop((start, 0, start + SIZE[0], SIZE[1]))
        parts = [whole.crop(box).resize((160, 160), Image.Resampling.NEAREST) for box in PARTS]
        columns.append(np.concatenate([np.array(whole.resize((160, 120))), *(np.array(p) for p in parts)]))
    return np.concatenate(columns, axis=1)


PARTS = (70, 80, 110, 120), (190, 90, 230, 130)
"""Pixels of the picture: leaves, and windows."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=Path)
    given = parser.parse_args()
    print(json.dumps(run(pictures=given.pictures), indent=2))
    if given.pictures:
        for setting in ("one", "three"):
            Image.fromarray(panel(given.pictures, setting)).save(given.pictures / f"panel-{setting}.png")


if __name__ == "__main__":
    main()
