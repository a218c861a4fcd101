"""Light on pictures and on geometry beside each other: the seam at the near radius, and canopies over the levels.

    farfield bench light [--quick] [--json]
    python benchmarks/bench_light.py [--scenes tokyo,forest,statues] [--cameras N] [--page] [--pictures DIR]

Seam: the leaves from r to 2 r, alone, are drawn once as geometry and once from pictures, of the same world at the same
cameras, under front, side and back light, and compared where both show the same surface. Figures are pictures less
geometry, in steps of 255 of sRGB: `signed`, and `blocks` by size, are mean differences of the light of 16 x 16 pixels
together, which is what an eye that looks for an edge sees; `pixels` is the mean size over single pixels, which holds
all that pictures lack in sharpness too. Canopy: linear luminance over covered pixels of the forest's leaf level, two
and four levels up, divided by the geometry's.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_quality import DATA, GOALS, WORK, Case, case, save_side_by_side, small_case
from farfield.errors import CorruptTileError
from farfield.geometry.cameras import Camera
from farfield.geometry.color import linear_from_srgb, srgb_from_linear
from farfield.geometry.frustum import Frustum
from farfield.octree.grid import Grid
from farfield.scene.read import read_scene
from farfield.serve.run import ServeOptions, serving
from farfield.view.frame import Frame
from farfield.view.geometry import Batches, GeometryPass
from farfield.view.kinds import ShownForm
from farfield.view.left_out import LeftOut
from farfield.view.near import NearGeometry
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, SoundTree, chosen_tiles, picture_radius, render_world
from farfield.view.shading import Light, radiance
from farfield.view.tiles import TileCache, Wanted
from farfield.view.truth import TruthOptions, draw_truth
from farfield.world.index import CellEntry

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.browsing import opened_browser, visiting

Pixels = NDArray[np.uint8]
SIDES = {"front": 180.0, "side": 90.0, "back": 0.0}
"""Degrees from the way the camera looks to the way to the sun."""
ELEVATION = 35.0
BLOCK = 16
"""Pixels a side whose light is taken together: means of sRGB, a concave curve, would take blur for brightness."""
GOAL = 2.0
"""Largest mean difference at the seam, of 255."""
PAGE_CAMERAS = {
    "tokyo": Camera((192.0, 1150.0, 180.0), (192.0, 1388.0, 40.0), 46.8264),
    "forest": Camera((-60.0, -90.0, 50.0), (-25.0, -30.0, 10.0), 46.8264),
    "statues": Camera((-9.0, -12.0, 4.0), (-3.0, -3.0, 0.5), 46.8264),
}
"""From above, so that nothing near hides what lies from r to 2 r."""
SAMPLES = 4
WHITE = Light(ambient=1.0, sun_strength=0.0)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def run(quick: bool = False) -> dict[str, Any]:
    """Figures of every scene; quick: of a few statues and trees that come with the package, in small pictures."""
    if quick:
        small = small_case(Path(tempfile.mkdtemp(prefix="farfield-light-")))
        return {"seam": {"small": seam(small, 1)}, "canopy": canopy(small, (0, 1), (35.0,))}
    found = {name: seam(case(name, "leaf", WORK, DATA), 2) for name in GOALS}
    return {"seam": found, "canopy": canopy(case("forest", "leaf", WORK, DATA))}


def seam(case: Case, cameras: int, pictures: Path | None = None) -> dict[str, Any]:
    """side -> mean figures over so many of the case's cameras. pictures: folder for geometry, pictures, difference."""
    cache, found = TileCache(case.world, 2 << 30), {}
    for side in SIDES:
        rows = []
        for number, camera in enumerate(spread(case.cameras, cameras)):
            light = lit_from(camera, side)
            ring = leaves_between(case, camera)
            geometry, drawn = as_geometry(case, camera, ring, light), from_pictures(case, camera, ring, light, cache)
            pixels = geometry.pixels(light.sky_linear), drawn.pixels(light.sky_linear)
            alike = (geometry.alpha == 1) & (drawn.alpha == 1) & same_depth(geometry, drawn, case.world.grid)
            rows.append(differences(*pixels, alike))
            if pictures is not None:
                file = pictures / f"{case.scene.parent.name}-{side}-{number}.png"
                save_side_by_side(file, geometry.pixels(None), drawn.pixels(None))
        found[side] = {name: round(fmean(row[name] for row in rows), 2) for name in rows[0]}
    return found | {"goal_met": all(found[side]["blocks"] <= GOAL for side in SIDES)}


def same_depth(a: Picture, b: Picture, grid: Grid) -> NDArray[np.bool_]:
    """(h, w) bool: pixels in which both show the same surface, as far as depth can tell: within four leaf pixels."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(a.depth - b.depth) < 4 * grid.pitch(0))


def leaves_between(case: Case, camera: Camera) -> list[CellEntry]:
    """Leaves from r to 2 r, where pictures begin, as far as the camera may see them."""
    world, radius = case.world, picture_radius(case.world, camera, case.size)
    cut = SoundTree(world).cut(camera, case.size, RenderOptions(near_radius=2 * radius))
    near = LeftOut(world.grid, camera.eye, radius)
    keys = [key for key in cut.geometry if near.keeps(np.array([[key.x, key.y, key.z]]))[0]]
    frustum = Frustum.of(camera, case.size)
    entries = [world.entry(key) for key in keys]
    return [entry for entry in entries if frustum.touches(np.array(entry.bounds))]


def as_geometry(case: Case, camera: Camera, leaves: Sequence[CellEntry], light: Light) -> Picture:
    """Those leaves alone, as triangles."""
    frame = Frame.empty(camera, case.size, SAMPLES)
    reader = NearGeometry(case.world, np.array(camera.eye))
    reader.draw(map(ShownForm, leaves), Batches(GeometryPass(frame, light)))
    return frame.develop(light)


def from_pictures(case: Case, camera: Camera, leaves: Sequence[CellEntry], light: Light, cache: TileCache) -> Picture:
    """Those leaves alone, from their pictures."""
    frame, numbers, eye = Frame.empty(camera, case.size, SAMPLES), case.world.manifest.direction_by_number, camera.eye
    wanted = [Wanted(entry.cell, chosen_tiles(case.world, entry, np.array(eye), RenderOptions())) for entry in leaves]
    for cell, layers in cache.cells(wanted):
        if isinstance(layers, CorruptTileError):
            raise layers
        for (direction, _), layer in zip(cell.places, layers, strict=True):
            frame.splat(layer, numbers[direction], case.world.grid, 0, light)
    return frame.develop(light)


def differences(a: Pixels, b: Pixels, where: NDArray[np.bool_]) -> dict[str, float]:
    """b less a over those pixels: signed mean and mean size of the blocks' differences, and mean size over pixels."""
    height, width = (n // BLOCK * BLOCK for n in where.shape)

    def blocks(values: NDArray[Any]) -> NDArray[np.float64]:
        cut = values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1)
        return np.asarray(cut.sum((1, 3)), dtype=np.float64)

    count = blocks(where.astype(np.float64))
    full = count[..., 0] >= BLOCK * BLOCK / 4
    weight = count[full]
    first, second = (255 * srgb_from_linear(blocks(_linear(p) * where[..., None])[full] / weight) for p in (a, b))
    pixels = np.abs(b[..., :3].astype(np.float64) - a[..., :3])[where]
    return {
        "signed": float(((second - first) * weight).sum() / (3 * weight.sum())),
        "blocks": float((np.abs(second - first) * weight).sum() / (3 * weight.sum())),
        "pixels": float(pixels.mean()),
        "share": float(where.mean()),
    }


def _linear(pixels: Pixels) -> NDArray[np.float64]:
    return linear_from_srgb(pixels[..., :3] / 255.0)


def lit_from(camera: Camera, side: str, elevation: float = ELEVATION) -> Light:
    """A sun behind the camera, beside it, or before it."""
    ahead = camera.axes[2]
    azimuth = math.degrees(math.atan2(ahead[0], ahead[1]))
    return Light(azimuth=(azimuth + SIDES[side]) % 360.0, elevation=elevation)


def spread(cameras: Sequence[Camera], count: int) -> Sequence[Camera]:
    """So many of them, evenly."""
    return [cameras[n * len(cameras) // count] for n in range(count)]


def canopy(
    case: Case, levels: Sequence[int] = (0, 2, 4), elevations: Sequence[float] = (15.0, 35.0, 60.0)
) -> dict[str, Any]:
    """side -> sun's elevation -> level -> luminance of the pictures divided by that of the geometry.

    "everywhere": the same under light from everywhere, which tells of colours and of what is seen, not of shading.
    """
    cache, camera = TileCache(case.world, 2 << 30), far_camera(case)
    geometry = Unlit.of(case, camera)
    levels = [n for n in levels if n <= case.world.grid.top_level]

    def ratios(light: Light) -> dict[str, float]:
        truth, found = geometry.luminance(light), {}
        for level in levels:
            bias = bias_of(case, camera, level)
            options = RenderOptions(supersampling=SAMPLES, light=light, near_radius=0.0, bias=bias)
            picture = render_world(case.world, camera, case.size, options, cache)
            found[str(level)] = round(luminance(picture) / truth, 4)
        return found

    found: dict[str, Any] = {"everywhere": ratios(WHITE)}
    for side in SIDES:
        found[side] = {f"{height:g}": ratios(lit_from(camera, side, height)) for height in elevations}
    return found


@dataclass(frozen=True, slots=True)
class Unlit:
    """True samples, to be lit in many ways: drawing the triangles takes longest."""

    albedo: NDArray[np.float32]
    """(n, 3) linear."""
    normal: NDArray[np.float32]
    """(n, 3) unit vectors that face the eye."""

    @classmethod
    def of(cls, case: Case, camera: Camera) -> Unlit:
        """A sample is a pixel of a picture so much larger."""
        size = case.size[0] * SAMPLES, case.size[1] * SAMPLES
        picture = draw_truth(read_scene([case.scene]), camera, size, TruthOptions(1, WHITE, normals=True))
        covered = picture.alpha > 0
        assert picture.normal is not None
        return cls(picture.color[covered], picture.normal[covered])

    def luminance(self, light: Light) -> float:
        """Linear, mean over the samples."""
        return float((radiance(self.albedo, self.normal, light) @ LUMINANCE).mean())


def far_camera(case: Case) -> Camera:
    """One that sees the scene from 25 degrees above, so far away that all cells are at about one distance."""
    lower, upper = np.array(case.world.manifest.bounds)
    middle, size = (lower + upper) / 2, float(np.linalg.norm((upper - lower)[:2]))
    away = 8 * size * np.array([0.55, -0.72, 0.42])
    return Camera(tuple((middle + away).tolist()), tuple(middle.tolist()), math.degrees(2 * math.atan(0.3 / 8)))


def bias_of(case: Case, camera: Camera, level: int) -> float:
    """The bias that makes the cut be of that level alone."""
    away = float(np.linalg.norm(np.array(camera.eye) - camera.target))
    radius = picture_radius(case.world, camera, case.size)
    # Cells of a level reach from r 2^(level - bias) to twice that; the middle of it is put at the scene.
    return level + 0.5 - math.log2(away / radius)


def luminance(picture: Picture) -> float:
    """Linear, mean over what is covered."""
    weight = picture.alpha.astype(np.float64)
    return float(((picture.color @ LUMINANCE) * weight).sum() / weight.sum())


def page_seam(case: Case, camera: Camera, pictures: Path | None = None) -> dict[str, Any]:
    """As `seam`, of the page: near radius 2 r against r, over pixels of the leaves between; shadows off and on."""
    radius = picture_radius(case.world, camera, case.size)
    options = RenderOptions(supersampling=1, near_radius=radius)
    ring = shown_between(render_world(case.world, camera, case.size, options), camera, case.world.grid, radius)
    found = {}
    with (
        opened_browser() as browser,
        serving(case.world.store, ServeOptions(port=0)) as url,
        visiting(browser, url, case.size) as page,
    ):
        page.options(supersampling=2, nearRadius=radius, light={"azimuth": lit_from(camera, "side").azimuth})
        for shadows in (False, True):
            drawn = []
            for near in (2 * radius, radius):
                page.options(shadows=shadows, nearRadius=near)
                page.look(camera.eye, camera.target, camera.fov)
                drawn.append(page.picture())
            name = "shadows" if shadows else "plain"
            found[name] = {key: round(value, 2) for key, value in differences(*drawn, ring).items()}
            if pictures is not None:
                save_side_by_side(pictures / f"page-{case.scene.parent.name}-{name}.png", *drawn)
    return found


def shown_between(picture: Picture, camera: Camera, grid: Grid, radius: float) -> NDArray[np.bool_]:
    """(h, w) bool: pixels whose nearest surface lies in a leaf from radius to twice that from the eye, metres."""
    height, width = picture.depth.shape
    covered = np.isfinite(picture.depth)
    depth = np.where(covered, picture.depth, 1.0).astype(np.float64)
    points = camera.rays((width, height)) * depth[..., None] + camera.eye
    cells = np.floor((points - grid.corner) / grid.leaf_size).astype(np.int64)
    inside, beyond = (LeftOut(grid, camera.eye, least).keeps(cells) for least in (radius, 2 * radius))
    return np.asarray(covered & inside & ~beyond)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", default=",".join(GOALS))
    parser.add_argument("--cameras", type=int, default=2)
    parser.add_argument("--page", action="store_true", help="the seam in the page instead, in Chromium")
    parser.add_argument("--pictures", type=Path, help="where to leave pictures side by side")
    given = parser.parse_args()
    found: dict[str, Any] = {}
    for name in given.scenes.split(","):
        scene = case(name, "leaf", WORK, DATA)
        if given.page:
            found[name] = page_seam(scene, PAGE_CAMERAS[name], given.pictures)
        else:
            found[name] = seam(scene, given.cameras, given.pictures)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
