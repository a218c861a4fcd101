"""Small CityJSON documents made by hand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from farfield.scene.model import Mesh, Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene

CUBE = [[[0, 3, 2, 1]], [[4, 5, 6, 7]], [[0, 1, 5, 4]], [[1, 2, 6, 5]], [[2, 3, 7, 6]], [[3, 0, 4, 7]]]
"""Surfaces of a box, counter-clockwise from outside: ground, roof, four walls."""
SEMANTICS = ["GroundSurface", "RoofSurface", "WallSurface", "WallSurface", "WallSurface", "WallSurface"]
TURN = {"scale": [0.001, 0.001, 0.001], "translate": [1000.0, 2000.0, 5.0]}
AT = np.array(TURN["translate"])


def box(x: float = 0, y: float = 0, z: float = 0, width: float = 10, depth: float = 8, height: float = 6) -> Any:
    """(8, 3): its corners, the ground first."""
    ground = np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]], float)
    return np.concatenate([np.c_[ground, np.full(4, z)], np.c_[ground, np.full(4, z + height)]])


class City:
    """A document that grows."""

    def __init__(self, version: str = "2.0", reference: Any = None) -> None:
        self.json: dict[str, Any] = {"type": "CityJSON", "version": version, "transform": TURN, "CityObjects": {},
                                     "vertices": []}  # fmt: skip
        if reference is not None:
            self.json["metadata"] = {"referenceSystem": reference}

    def points(self, points: Any) -> int:
        """Adds vertices, in metres from AT; the number of the first."""
        first = len(self.json["vertices"])
        self.json["vertices"] += np.round(np.asarray(points) * 1000).astype(int).tolist()
        return first

    def geometry(self, surfaces: Any, kind: str = "MultiSurface", lod: str = "2", **more: Any) -> dict[str, Any]:
        for _ in range({"Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}.get(kind, 0)):
            surfaces = [surfaces]
        return {"type": kind, "lod": lod, "boundaries": surfaces, **more}

    def cube(self, kind: str = "Solid", lod: str = "2", corners: Any = None, **more: Any) -> dict[str, Any]:
        first = self.points(box() if corners is None else corners)
        return self.geometry(moved(CUBE, first), kind, lod, **more)

    def add(self, name: str, *geometries: Any, kind: str = "Building", **more: Any) -> dict[str, Any]:
        self.json["CityObjects"][name] = {"type": kind, "geometry": list(geometries), **more}
        return self.json["CityObjects"][name]

    def write(self, path: Path) -> Path:
        path.write_text(json.dumps(self.json))
        return path

    def read(self, folder: Path, **options: Any) -> Scene:
        return read_scene([self.write(folder / "a.city.json")], ReadOptions(**options))


def moved(surfaces: Any, first: int) -> Any:
    """Boundaries with another first vertex."""
    return [moved(inner, first) for inner in surfaces] if isinstance(surfaces, list) else surfaces + first


def semantics(names: Sequence[str] = SEMANTICS, nested: int = 1) -> dict[str, Any]:
    values: Any = list(range(len(names)))
    for _ in range(nested):
        values = [values]
    return {"semantics": {"surfaces": [{"type": name} for name in names], "values": values}}


def load(scene: Scene) -> Mesh:
    (source,) = scene.meshes
    return source.load()


def areas(mesh: Mesh) -> np.ndarray:
    """(m, 3) area vectors of the triangles."""
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def volume(mesh: Mesh) -> float:
    """Enclosed by the triangles, positive when they face outwards."""
    return float((mesh.positions[mesh.triangles].mean(1) * areas(mesh)).sum() / 3)


def notes(scene: Scene) -> list[str]:
    """Warnings without the file."""
    return [line.split(": ", 1)[1] for line in scene.warnings]
