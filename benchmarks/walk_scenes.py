"""The scenes of the thesis' walks, made of real statues, and the worlds that they are walked in (bench_walks.py)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.progress import Progress
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.model import Material, Mesh, Texture
from farfield.scene.procedural.garden import GardenOptions, make_garden
from farfield.scene.procedural.ground import ground_texture
from farfield.scene.procedural.terrain import TerrainOptions, make_terrain
from farfield.scene.read import read_scene
from farfield.store.directory import DirectoryStore

STATUES = ("pan", "theodoric_the_great", "jenner", "horse_head", "eagle")
SIDES = "5+1,1,0+1,-1,0+-1,1,0+-1,-1,0"
"""Directions: the top and eight round about. Who walks sees all objects from the side, and of eight sides one always
within 22.5 degrees, where a board is as good as head on (BEN 4.1)."""
TEXELS, TILE = 256, 4.0
"""Of the garden's grass, and metres that it repeats after. The thesis' ground takes 112 kB with its textures; the
1,024 texels of `[[ground]]` are 437 kB, 22 s at 20 kB/s, which the leaves' full geometry needs."""


@dataclass(frozen=True, slots=True)
class WalkScene:
    """A scene, how it is baked and what is walked."""

    options: BakeOptions
    seconds: float
    """Of the path that are walked; 0: all."""


SCENES = {
    # A pixel of 1.6 cm: statues of 2.2 m have 140 rows, those beyond r = 9 m are as sharp as the screen. Leaves of 2 m
    # hold one statue at most and make tiles of a kilobyte or two, half a second at 2,000 B/s.
    "garden": WalkScene(BakeOptions(leaf_size=2.0, resolution=128, directions=SIDES, depth_layers=1), 0.0),
    # A pixel of 6.3 cm, r = 36 m: half of that would take four times as many leaves and an hour.
    "terrain": WalkScene(BakeOptions(leaf_size=16.0, resolution=256, directions=SIDES), 30.0),
}


def made_world(name: str, data: Path, work: Path, progress: Progress | None = None) -> Path:
    """The world of a scene below `work`, made and baked unless it is there; beside it NAME-scene/path.json."""
    scene, world = work / f"{name}-scene", work / name
    statues = tuple(data / "threedscans_statues" / f"{statue}.glb" for statue in STATUES)
    if not (scene / "path.json").exists():
        if name == "garden":
            make_garden(scene, GardenOptions(meshes=statues))
            _with_small_grass(scene)
        else:
            make_terrain(scene, TerrainOptions(meshes=statues))
    if not (world / "world.json").exists():
        bake(read_scene([scene / "scene.toml"]), DirectoryStore(world), SCENES[name].options, progress)
    return world


def _with_small_grass(scene: Path) -> None:
    """In place of the garden's `[[ground]]` a plane of the same size with a smaller texture."""
    text = (scene / "scene.toml").read_text()
    found = re.search(r'\[\[ground\]\]\nsize = \[([0-9.]+), [0-9.]+\]\ntexture = "grass"\n', text)
    assert found is not None
    half = float(found[1]) / 2
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    grass = Image.fromarray(ground_texture("grass").pixels).resize((TEXELS, TEXELS), Image.Resampling.BOX)
    mesh = Mesh(
        positions=corners,
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        normals=np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)),
        materials=(Material("grass", texture=Texture(np.array(grass))),),
        triangle_material=np.zeros(2, np.uint16),
        uvs=(corners[:, :2] / TILE).astype(np.float32),
    )
    write_glb(scene / "ground.glb", mesh, GlbOptions(image_format="WEBP", image_quality=75))
    (scene / "scene.toml").write_text(text.replace(found[0], '[[source]]\npath = "ground.glb"\n'))
