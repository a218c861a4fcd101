"""Makes the bundled demo scene, src/farfield/demo/, from the open data it is credited to.

    python scripts/make_demo_scene.py DATA

DATA holds the folders tokyo_core_lod2, threedscans_statues and eztree_trees. Needs fast-simplification besides
farfield itself. The same inputs give the same scene.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import fast_simplification
import numpy as np
import shapely
from convert_tokyo import read_archive, write_flatgeobuf
from numpy.typing import NDArray
from PIL import Image

from farfield.geometry.color import linear_from_srgb
from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.gltf import read_gltf
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.model import Material, Mesh, Texture

OUTPUT = Path(__file__).parents[1] / "src/farfield/demo"
ARCHIVE_ORIGIN = np.array([-6000.0, -35000.0])
"""EPSG:6677 coordinates of the archive's zero."""
ORIGIN = np.array([-7168.0, -35840.0])
"""EPSG:6677 coordinates of the scene's zero."""
BOX = (-460.0, -700.0, 220.0, -20.0)
"""Tokyo Station and Marunouchi, 680 m x 680 m, metres from the archive's origin."""
TRACKS = shapely.Polygon([(-68, -167), (85, -167), (150, -200), (42, -590), (-90, -560), (-60, -440)])
"""Station and railway tracks, where neither trees nor statues stand."""

STATUES = {"pan": (12.0, 40_000), "theodoric_the_great": (21.0, 34_000), "eagle": (17.0, 24_000)}
"""Height in metres and triangles."""
TREES = {"aspen_medium": (0.74, 180), "oak_medium": (0.70, 80)}
"""Scale and number."""
STONE = (178, 170, 156)
BRONZE = (112, 122, 104)

SCENE = """# Tokyo Station, with statues and trees that are not there. LICENSES/CREDITS.md says who made what.
crs = "EPSG:6677"
origin = [{x}, {y}, 0.0]
credits = [
    "Buildings: github.com/indigo-lab/plateau-lod2-mvt, from Project PLATEAU (MLIT Japan); CC BY 4.0",
    "Statues: Three D Scans (threedscans.com)",
    "Trees: ez-tree by Daniel Greenheck (MIT); bark by Poly Haven and texturecan.com (CC0)",
]

[[source]]
path = "buildings.fgb"
height_attribute = "height"

[[ground]]
size = [{width}, {depth}]
translate = [{cx}, {cy}, 0.0]
texture = "paving"
"""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    data = parser.parse_args().data
    OUTPUT.mkdir(parents=True, exist_ok=True)
    shapes, heights = read_archive(data / "tokyo_core_lod2/roofs.npz", BOX)
    write_flatgeobuf(OUTPUT / "buildings.fgb", shapes, heights)
    open_places = _OpenPlaces(shapes)
    low, high = np.array(BOX[:2]), np.array(BOX[2:])
    center = (low + high) / 2 + ARCHIVE_ORIGIN - ORIGIN
    lines = [SCENE.format(x=ORIGIN[0], y=ORIGIN[1], width=760.0, depth=760.0, cx=center[0], cy=center[1])]
    places = open_places.statues(len(STATUES))
    for k, (name, (height, count)) in enumerate(STATUES.items()):
        lines.append(_statue(data / "threedscans_statues" / f"{name}.glb", height, count, places[k], k))
    table = open_places.trees(sum(number for _, number in TREES.values()), places)
    for name, (scale, number) in TREES.items():
        mine, table = table[:number], table[number:]
        mine[:, 4] *= scale
        lines.append(_trees(data / "eztree_trees" / f"{name}.glb", mine))
    (OUTPUT / "scene.toml").write_text("\n".join(lines))
    total = sum(file.stat().st_size for file in OUTPUT.rglob("*") if file.is_file())
    print(f"{len(shapes):,} prisms, {total:,} bytes")


class _OpenPlaces:
    """Where there is room between the buildings, in local metres."""

    def __init__(self, shapes: NDArray[np.object_]) -> None:
        local = shapely.transform(shapes, lambda points: points - ARCHIVE_ORIGIN)
        self.tree = shapely.STRtree(local)
        self.footprints = local
        self.random = np.random.default_rng(20)

    def clearance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) metres to the nearest building; 0 on the tracks."""
        geometries = shapely.points(points)
        nearest = self.footprints[self.tree.nearest(geometries)]
        distance = shapely.distance(geometries, nearest)
        return np.where(shapely.contains(TRACKS, geometries), 0.0, distance)

    def statues(self, count: int) -> NDArray[np.float64]:
        """(count, 2): the widest open places at least 90 m apart and 130 m from the edge."""
        x, y = np.meshgrid(np.arange(BOX[0] + 130, BOX[2] - 130, 5.0), np.arange(BOX[1] + 130, BOX[3] - 130, 5.0))
        points = np.stack([x.ravel(), y.ravel()], -1)
        room = self.clearance(points)
        chosen: list[NDArray[np.float64]] = []
        for row in np.argsort(-room, kind="stable"):
            if all(np.hypot(*(points[row] - other)) > 90 for other in chosen):
                chosen.append(points[row])
            if len(chosen) == count:
                break
        return np.array(chosen)

    def trees(self, count: int, statues: NDArray[np.float64]) -> NDArray[np.float64]:
        """(count, 5) x, y, z, heading, scale in the scene's frame: along the streets, 8.5 m apart, none in a statue."""
        points = self.random.uniform(np.array(BOX[:2]) + 12, np.array(BOX[2:]) - 12, (40_000, 2))
        room = self.clearance(points)
        far = np.min(np.hypot(*(points[:, None] - statues[None]).transpose(2, 0, 1)), axis=1) > 20
        points = points[(room > 5.0) & (room < 9.0) & far]
        chosen = np.zeros((0, 2))
        for point in points:
            if len(chosen) == count:
                break
            if not len(chosen) or np.hypot(*(chosen - point).T).min() > 8.5:
                chosen = np.vstack([chosen, point])
        heading, scale = self.random.uniform(0, 360, count), self.random.uniform(0.8, 1.2, count)
        local = chosen + ARCHIVE_ORIGIN - ORIGIN
        return np.column_stack([local, np.zeros(count), heading, scale])


def _statue(path: Path, height: float, count: int, place: NDArray[np.float64], number: int) -> str:
    """Writes the statue in metres, standing on z = 0, and returns its table."""
    mesh = read_gltf(path).meshes[0].load()
    points, faces = fast_simplification.simplify(
        mesh.positions.astype(np.float32), mesh.triangles.astype(np.int32), target_count=count
    )
    low, high = points.min(axis=0), points.max(axis=0)
    points = (points - [*(low + high)[:2] / 2, low[2]]) * (height / (high[2] - low[2]))
    red, green, blue = linear_from_srgb(np.array(BRONZE if number == 2 else STONE) / 255.0).tolist()
    material = Material("stone", (red, green, blue, 1.0), double_sided=False)
    raw = RawSurface(points.astype(np.float64), faces.astype(np.int64), materials=(material,), crease_cosine=-1.0)
    write_glb(OUTPUT / path.name, assemble(raw, path.name), GlbOptions(draco=True))
    x, y = place + ARCHIVE_ORIGIN - ORIGIN
    return f'[[source]]\npath = "{path.name}"\ntranslate = [{x:.1f}, {y:.1f}, 0.0]\n'


def _trees(path: Path, table: NDArray[np.float64]) -> str:
    """Writes the tree with textures of half their side, and its instance table; returns its [[source]]."""
    mesh = read_gltf(path).meshes[0].load()
    options = GlbOptions(draco=True, position_bits=16, image_format="WEBP", image_quality=80)
    write_glb(OUTPUT / path.name, _small_textures(mesh), options)
    # Rounding leaves a few twigs without area; reading drops them, and what is written then reads without warnings.
    again = read_gltf(OUTPUT / path.name).meshes[0].load()
    write_glb(OUTPUT / path.name, replace(_small_textures(mesh), **_shape(again)), options)
    np.save(OUTPUT / f"{path.stem}.npy", table.astype(np.float32))
    return f'[[source]]\npath = "{path.name}"\ninstances = "{path.stem}.npy"\n'


def _shape(mesh: Mesh) -> dict[str, object]:
    names = ("positions", "triangles", "normals", "uvs", "triangle_material")
    return {name: getattr(mesh, name) for name in names}


def _small_textures(mesh: Mesh) -> Mesh:
    materials = []
    for material in mesh.materials:
        assert material.texture is not None
        image = Image.fromarray(material.texture.pixels)
        small = image.resize((image.width // 2, image.height // 2), Image.Resampling.BOX)
        materials.append(replace(material, texture=Texture(np.asarray(small))))
    return replace(mesh, materials=tuple(materials))


if __name__ == "__main__":
    main()
