"""Small scenes made in memory, for tests of the bake and of what reads worlds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Instances, Material, Mesh, Scene, Texture
from farfield.store.directory import DirectoryStore


@dataclass(frozen=True, slots=True)
class Held:
    """A mesh source that holds its mesh."""

    mesh: Mesh
    name: str = "held"

    def load(self) -> Mesh:
        """The mesh."""
        return self.mesh


def quad_mesh(corners: NDArray[np.float64], material: Material) -> Mesh:
    """(q, 4, 3) corners, counter-clockwise -> two triangles each, flat normals, uv 0..1."""
    q = len(corners)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.arange(q, dtype=np.uint32)[:, None] * 4
    triangles = (
        np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], 1).reshape(-1, 3).astype(np.uint32)
    )
    return Mesh(
        positions=corners.reshape(-1, 3),
        triangles=triangles,
        normals=np.repeat(normal, 4, 0).astype(np.float32),
        materials=(material,),
        triangle_material=np.zeros(2 * q, np.uint16),
        uvs=np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32), (q, 1)),
        triangle_object=np.repeat(np.arange(q, dtype=np.uint32), 2),
        object_count=q,
    )


def ground(lower: float, upper: float, z: float = 0.0, color: tuple[float, float, float] = (0.2, 0.4, 0.1)) -> Mesh:
    """A horizontal square facing up."""
    square = [[lower, lower, z], [upper, lower, z], [upper, upper, z], [lower, upper, z]]
    return quad_mesh(np.array([square]), Material("ground", (*color, 1.0)))


def box(lower: tuple[float, float, float], upper: tuple[float, float, float], material: Material) -> Mesh:
    """An axis-aligned box without a floor."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    sides = [
        [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
        [[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1]],
        [[x1, y1, z0], [x0, y1, z0], [x0, y1, z1], [x1, y1, z1]],
        [[x0, y1, z0], [x0, y0, z0], [x0, y0, z1], [x0, y1, z1]],
        [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
    ]
    return quad_mesh(np.array(sides, dtype=np.float64), material)


def scene_of(*placed: tuple[Mesh, list[tuple[float, float, float]]]) -> Scene:
    """A scene of meshes, each with the places it is moved to."""
    mesh = np.repeat(np.arange(len(placed)), [len(places) for _, places in placed]).astype(np.int32)
    shift = np.array([place for _, places in placed for place in places], dtype=np.float64)
    transform = np.tile(np.eye(3, 4), (len(shift), 1, 1))
    transform[:, :, 3] = shift
    objects = np.array([placed[m][0].object_count for m in mesh])
    first = 1 + np.cumsum(objects) - objects
    return Scene(
        meshes=[Held(m, f"mesh {i}") for i, (m, _) in enumerate(placed)],
        instances=Instances(mesh, transform, first.astype(np.int64), objects.astype(np.int64)),
        object_count=int(objects.sum()),
        credits=("made for tests",),
    )


def checkered(size: int = 16) -> Texture:
    """Squares of two colours with a hole in every fourth."""
    tile = np.indices((size, size)).sum(0) % 2
    pixels = np.full((size, size, 4), 255, np.uint8)
    pixels[tile == 1, :3] = (200, 60, 30)
    pixels[::4, ::4, 3] = 0
    return Texture(pixels)


def village() -> Scene:
    """Ground, a textured screen with holes, a box that crosses cell walls, and instances of a small box."""
    wall = Material("wall", (0.8, 0.7, 0.6, 1.0))
    lamp = Material("lamp", (1.0, 0.9, 0.3, 1.0), unlit=True)
    leaf = Material("screen", texture=checkered(), alpha_cutoff=0.5)
    screen = quad_mesh(np.array([[[2.0, 9.0, 0.0], [10.0, 9.5, 0.0], [10.0, 9.5, 5.0], [2.0, 9.0, 5.0]]]), leaf)
    places = [(float(3 * i), float(5 * j), 0.0) for i in range(4) for j in range(2)]
    return scene_of(
        (ground(-1.0, 15.0), [(0.0, 0.0, 0.0)]),
        (screen, [(0.0, 0.0, 0.0)]),
        (box((5.0, 5.0, 0.0), (9.0, 8.0, 6.0), wall), [(0.0, 0.0, 0.0)]),
        (box((0.0, 0.0, 0.0), (1.0, 1.0, 2.0), lamp), places),
    )


def contents(place: Path) -> dict[str, bytes]:
    """What readers see of a world: no notes of the bake, no generation."""
    store = DirectoryStore(place)
    found = {key: store.get(key) for key in store.list() if not key.startswith("record/")}
    return found | {"world.json": found["world.json"].replace(b'"generation": 2', b'"generation": 1')}
