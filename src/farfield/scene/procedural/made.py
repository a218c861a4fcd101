"""What every made scene has in common: a folder with a scene.toml, counted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError, StoreError
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene, read_source


@dataclass(frozen=True, slots=True)
class MadeScene:
    """A scene that was written."""

    path: Path
    """Its scene.toml."""
    triangles: int
    """Counted with instances."""
    bytes: int
    """Size of the files, those given as meshes included."""


@dataclass(frozen=True, slots=True)
class GivenMesh:
    """A mesh file of the user's, and how it is brought to a common size."""

    path: Path
    low: NDArray[np.float64]
    """(3,) lower corner of its bounds, metres."""
    high: NDArray[np.float64]


def prepare(directory: Path) -> Path:
    """The folder, made when it is not there. Raises OptionError when it holds something else than a scene."""
    if directory.is_file():
        raise OptionError("is a file, not a folder", str(directory), "give another folder with -o")
    if directory.is_dir() and any(directory.iterdir()) and not (directory / "scene.toml").is_file():
        raise OptionError("holds something else", str(directory), "give an empty folder with -o")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot be written: {error.strerror}", str(directory), "give another folder") from error
    return directory


def finish(directory: Path, parts: list[str]) -> MadeScene:
    """Writes the scene.toml and counts what it describes, loading every mesh once."""
    path = directory / "scene.toml"
    path.write_text("\n".join(parts))
    scene = read_scene([path])
    return MadeScene(path, count_triangles(scene), scene.source_bytes)


def count_triangles(scene: Scene) -> int:
    """Triangles of the scene with its instances; every mesh is loaded once."""
    uses = np.bincount(scene.instances.mesh, minlength=len(scene.meshes))
    return sum(int(n) * len(source.load().triangles) for source, n in zip(scene.meshes, uses, strict=True))


def given_mesh(path: Path) -> GivenMesh:
    """A mesh file measured. Raises InputError when it cannot be read."""
    scene = read_source(path, ReadOptions())
    corners = []
    for row, transform in zip(scene.instances.mesh, scene.instances.transform, strict=True):
        points = scene.meshes[row].load().positions @ transform[:, :3].T + transform[:, 3]
        corners += [points.min(axis=0), points.max(axis=0)]
    return GivenMesh(path.resolve(), np.min(corners, axis=0), np.max(corners, axis=0))


def source_table(path: str | Path, table: str, scale: float = 1.0, shift: NDArray[np.float64] | None = None) -> str:
    """The [[source]] of a mesh with its instance table."""
    text = f'[[source]]\npath = "{path}"\ninstances = "{table}"\n'
    if scale != 1.0:
        text += f"scale = {scale:.9g}\n"
    if shift is not None:
        text += f"translate = [{', '.join(f'{value:.6f}' for value in shift)}]\n"
    return text
