"""The scenes on which picture quality is measured, written as scene.toml from the large public inputs.

    python benchmarks/scenes.py DATA OUTPUT [tokyo|forest|statues|avenues ...]

tokyo: 1 km x 1 km of tokyo_core_lod2 round its middle, façades, on asphalt. forest: 400 trees of four kinds on
200 m x 200 m of grass. statues: 64 of five, 2 m long or high, on a paved plane. avenues: tokyo with 400 trees of two
kinds in its streets. The same inputs give the same scenes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from farfield.scene.gltf import read_gltf

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from convert_tokyo import read_archive, write_flatgeobuf

MIDDLE = (-2000.0, -1500.0)
"""Metres from the archive's origin: the middle of EPSG:6677 E -13500..-2500, N -41500..-31500."""
TOKYO_ORIGIN = (-8192.0, -37888.0)
"""EPSG:6677 coordinates of the scene's zero."""
MAP_MIDDLE = (-6000.0, -35000.0)
"""EPSG:6677 coordinates of the archive's origin."""
PLATEAU = "github.com/indigo-lab/plateau-lod2-mvt, from Project PLATEAU (MLIT Japan); CC BY 4.0"
EZTREE = "Trees: ez-tree by Daniel Greenheck (MIT)"
TREES = ("oak_dense", "pine_dense", "ash_large", "aspen_large")
STREET_TREES = ("ash_large", "aspen_large")
STATUES = ("pan", "theodoric_the_great", "jenner", "horse_head", "eagle")


def tokyo(data: Path, folder: Path) -> Path:
    """Prisms whose first vertex lies in the square; the ground reaches below all of them. Returns the scene.toml."""
    return _city(data, folder, [PLATEAU], [])


def avenues(data: Path, folder: Path) -> Path:
    """Tokyo with 400 trees 8 m apart at least and 4 m from its buildings, turned and scaled by seed."""
    random = np.random.default_rng(6677)
    walls = shapely.union_all(shapely.buffer(_shapes(data)[0], 4.0, quad_segs=2))
    shapely.prepare(walls)
    places = _apart(random, 4000, 500.0, 8.0)
    in_map = places + np.array(MIDDLE) + MAP_MIDDLE
    places = (in_map - np.array(TOKYO_ORIGIN))[~shapely.contains_xy(walls, in_map)][:400]
    count = len(places)
    table = np.column_stack([places, np.zeros(count), random.uniform(0, 360, count), random.uniform(0.8, 1.2, count)])
    sources = []
    for k, name in enumerate(STREET_TREES):
        np.save(folder / f"{name}.npy", table[k :: len(STREET_TREES)])
        sources.append(_source(data / f"eztree_trees/{name}.glb", f"{name}.npy"))
    return _city(data, folder, [PLATEAU, EZTREE], sources)


def _city(data: Path, folder: Path, credits: list[str], sources: list[str]) -> Path:
    shapes, heights = _shapes(data)
    write_flatgeobuf(folder / "buildings.fgb", shapes, heights)
    center = np.array(MIDDLE) + MAP_MIDDLE - np.array(TOKYO_ORIGIN)
    return write(folder, [
        'crs = "EPSG:6677"', f"origin = [{TOKYO_ORIGIN[0]}, {TOKYO_ORIGIN[1]}, 0.0]",
        f"credits = {json.dumps(credits)}",
        '[[source]]\npath = "buildings.fgb"\nheight_attribute = "height"', *sources,
        ground(1240, "asphalt", (float(center[0]), float(center[1]))),
    ])  # fmt: skip


def _shapes(data: Path) -> tuple[NDArray[np.object_], NDArray[np.float64]]:
    x, y = MIDDLE
    return read_archive(data / "tokyo_core_lod2/roofs.npz", (x - 500, y - 500, x + 500, y + 500))


def forest(data: Path, folder: Path) -> Path:
    """A hundred of each tree, at least 4 m apart, turned and scaled by seed. Returns the scene.toml."""
    random = np.random.default_rng(400)
    places = _apart(random, 400, 100.0, 4.0)
    table = np.column_stack([places, np.zeros(400), random.uniform(0, 360, 400), random.uniform(0.8, 1.2, 400)])
    lines = [f"credits = {json.dumps([EZTREE])}"]
    for k, name in enumerate(TREES):
        np.save(folder / f"{name}.npy", table[k::4])
        lines.append(_source(data / f"eztree_trees/{name}.glb", f"{name}.npy"))
    return write(folder, [*lines, ground(200, "grass", (0.0, 0.0))])


def statues(data: Path, folder: Path) -> Path:
    """Eight rows of eight, 3 m apart, kinds in turn, turned by seed. Returns the scene.toml."""
    heading = np.random.default_rng(64).uniform(0, 360, 64)
    row, column = np.divmod(np.arange(64), 8)
    lines = ['credits = ["Statues: Three D Scans (threedscans.com)"]']
    for k, name in enumerate(STATUES):
        path = data / f"threedscans_statues/{name}.glb"
        positions = read_gltf(path).meshes[0].load().positions
        low, high = positions.min(axis=0), positions.max(axis=0)
        scale = 2.0 / (high - low).max()
        middle = -scale * (low + high) / 2
        own = np.flatnonzero((row * 3 + column) % 5 == k)
        table = np.column_stack([column[own] * 3 - 10.5, row[own] * 3 - 10.5, np.zeros(len(own)), heading[own]])
        np.save(folder / f"{name}.npy", table)
        shift = f"translate = [{middle[0]:.5f}, {middle[1]:.5f}, {-scale * low[2]:.5f}]\nscale = {scale:.6f}"
        lines.append(_source(path, f"{name}.npy") + "\n" + shift)
    return write(folder, [*lines, ground(28, "paving", (0.0, 0.0), 12.0)])


SCENES: dict[str, Callable[[Path, Path], Path]] = {
    "tokyo": tokyo,
    "forest": forest,
    "statues": statues,
    "avenues": avenues,
}


def make(name: str, data: Path, output: Path) -> Path:
    """Writes one scene into its folder below `output`, unless it is there, and returns its scene.toml."""
    folder = output / name
    if not (folder / "scene.toml").exists():
        folder.mkdir(parents=True, exist_ok=True)
        SCENES[name](data.resolve(), folder)
    return folder / "scene.toml"


def _apart(random: np.random.Generator, count: int, half: float, least: float) -> NDArray[np.float64]:
    """(count, 2) places in a square, none nearer to another than `least`."""
    chosen = np.zeros((0, 2))
    while len(chosen) < count:
        place = random.uniform(-half, half, 2)
        if not len(chosen) or np.hypot(*(chosen - place).T).min() >= least:
            chosen = np.vstack([chosen, place])
    return chosen


def _source(path: Path, table: str) -> str:
    return f'[[source]]\npath = "{path}"\ninstances = "{table}"'


def ground(side: float, texture: str, center: tuple[float, float], tile: float = 30.0) -> str:
    place = f"translate = [{center[0]}, {center[1]}, 0.0]"
    return f'[[ground]]\nsize = {float(side)}\ntexture = "{texture}"\ntile = {tile}\n{place}'


def write(folder: Path, lines: list[str]) -> Path:
    path = folder / "scene.toml"
    path.write_text("\n\n".join(lines) + "\n")
    return path


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
