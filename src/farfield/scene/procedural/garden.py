"""A garden of statues on pedestals, each a mesh of its own, and a walk through it (BEN 6.1)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farfield.errors import OptionError
from farfield.scene.gltf.write import write_glb
from farfield.scene.model import Material, Mesh
from farfield.scene.procedural.blobs import blob
from farfield.scene.procedural.made import MadeScene, finish, prepare
from farfield.scene.procedural.statues import standing, statue
from farfield.scene.procedural.walks import Walk, beside
from farfield.scene.shading import body_normals

SPACING = 7.0
"""Metres between plots."""
HEIGHT = 2.2
"""Metres of a statue, 0.8 to 1.2 times."""
PEDESTAL = 1.0
"""Metres high; 0.6 of it wide on each side."""
STOPS = ((0.0, 2.0), (23.0, 28.0), (32.0, 39.0))
"""Seconds in which the walk stands still; the thesis' walk stands in the last two."""
SECONDS = 40.0
WAY = ((-0.12, -0.2), (-0.12, 0.0), (0.03, 0.02), (0.08, 0.1))
"""Corners of the walk, in sides of the garden from its middle: 2 m/s."""
CLEAR = 1.5
"""Metres from the walk to the middle of any statue, at least."""


@dataclass(frozen=True, slots=True)
class GardenOptions:
    """Size of the garden."""

    count: int = 257
    """Statues."""
    triangles: int = 1_983
    """Of a statue: 257 of them and their pedestals have the thesis' 513,775."""
    seed: int = 0
    meshes: tuple[Path, ...] = ()
    """Mesh files to make statues of, in place of made bodies."""


def make_garden(directory: Path, options: GardenOptions | None = None) -> MadeScene:
    """Writes the scene, a GLB for each statue, and path.json, the walk. The same options give the same bytes.

    Statues of one kind are varied, so that each is a mesh of its own as in the thesis: longer or broader, and twisted.
    Raises OptionError for sizes that make no scene, InputError for a given mesh that cannot be read.
    """
    chosen = options or GardenOptions()
    if chosen.count < 1 or chosen.triangles < 12:
        raise OptionError("a garden needs at least 1 statue and 12 triangles for each", "make garden")
    prepare(directory)
    random = np.random.default_rng(chosen.seed)
    kinds = [statue(path, chosen.triangles, HEIGHT) for path in chosen.meshes]
    kinds = kinds or [standing(blob(chosen.triangles, 1.0, chosen.seed + n), HEIGHT) for n in range(5)]
    side = int(np.ceil(chosen.count**0.5))
    plots = np.stack(np.divmod(np.sort(random.permutation(side**2)[: chosen.count]), side), axis=-1)
    places = (plots - (side - 1) / 2 + random.uniform(-0.2, 0.2, plots.shape)) * SPACING
    way = np.array(WAY) * side * SPACING
    places = beside(way, places, CLEAR)
    write_glb(directory / "pedestal.glb", _pedestal())
    parts = [_ground(side * SPACING + 20.0)]
    for number, (x, y) in enumerate(places.tolist()):
        write_glb(directory / f"statue-{number}.glb", varied(kinds[number % len(kinds)], random))
        turn = random.uniform(0, 360)
        parts.append(_source(f"statue-{number}.glb", x, y, PEDESTAL, turn))
        parts.append(_source("pedestal.glb", x, y, 0.0, turn))
    walk = Walk(way, SECONDS, STOPS).recorded(lambda at: np.zeros(len(at)))
    (directory / "path.json").write_text(json.dumps(walk))
    return finish(directory, parts)


def varied(of: Mesh, random: np.random.Generator) -> Mesh:
    """A statue of 0.8 to 1.2 times the height, up to a tenth broader or slimmer, twisted by up to 20 degrees."""
    size = random.uniform(0.8, 1.2) * np.array([*random.uniform(0.9, 1.1, 2), 1.0])
    points = of.positions * size
    angle = np.radians(random.uniform(-20, 20)) * points[:, 2] / HEIGHT
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.column_stack(
        [cos * points[:, 0] - sin * points[:, 1], sin * points[:, 0] + cos * points[:, 1], points[:, 2]]
    )
    light = float(random.uniform(0.45, 0.75))
    return Mesh(
        positions=turned,
        triangles=of.triangles,
        normals=body_normals(turned, of.triangles),
        materials=(Material("stone", (light, 0.97 * light, 0.9 * light, 1.0)),),
        triangle_material=np.zeros(len(of.triangles), np.uint16),
        colors=of.colors,
    )


def _pedestal() -> Mesh:
    """A box with flat faces on z = 0."""
    a, z = 0.6, PEDESTAL
    sides = []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        u = np.array([-sign if axis else 0.0, 0.0 if axis else sign, 0.0]) * a
        out = np.array([0.0 if axis else sign, sign if axis else 0.0, 0.0]) * a
        sides.append([out - u, out + u, out + u + (0, 0, z), out - u + (0, 0, z)])
    sides.append([np.array([x, y, z]) for x, y in ((-a, -a), (a, -a), (a, a), (-a, a))])
    points = np.array(sides, np.float64).reshape(-1, 3)
    faces = (np.arange(len(sides))[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    first, second, third = (points[faces[::2, n]] for n in range(3))
    normals = np.cross(second - first, third - first)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(
        positions=points,
        triangles=faces.astype(np.uint32),
        normals=np.repeat(normals, 4, axis=0).astype(np.float32),
        materials=(Material("granite", (0.25, 0.24, 0.23, 1.0)),),
        triangle_material=np.zeros(len(faces), np.uint16),
    )


def _ground(side: float) -> str:
    return f'[[ground]]\nsize = [{side:.3f}, {side:.3f}]\ntexture = "grass"\n'


def _source(path: str, x: float, y: float, z: float, turn: float) -> str:
    return f'[[source]]\npath = "{path}"\nrotate = {turn:.3f}\ntranslate = [{x:.4f}, {y:.4f}, {z:.4f}]\n'
