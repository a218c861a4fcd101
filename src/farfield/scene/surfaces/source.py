"""A mesh source for files that hold one mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from farfield.scene.assembly import IDENTITY, scene_of
from farfield.scene.cleaning import RawSurface, assemble
from farfield.scene.faults import reading
from farfield.scene.model import Mesh, Scene
from farfield.scene.streams import MeshStream, SurfaceStream


@dataclass(frozen=True, slots=True)
class FileMesh:
    """The mesh of one file; its functions must be those of a module, so that the source can be pickled."""

    path: Path
    parse: Callable[[Path], tuple[RawSurface, tuple[str, ...]]]
    """Path -> the surface, and warnings."""
    open: Callable[[Path], SurfaceStream | None] | None = None
    """Path -> the surface to be read a part at a time, of which only the header is read; None: it cannot be."""

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    def load(self) -> Mesh:
        """Reads the file. Raises InputError."""
        with reading(self.name):
            raw, warnings = self.parse(self.path)
            mesh = assemble(raw, self.name)
        return replace(mesh, warnings=warnings + mesh.warnings)

    def stream(self) -> MeshStream | None:
        """See `StreamedSource.stream`."""
        if self.open is None:
            return None
        with reading(self.name):
            surface = self.open(self.path)
        return None if surface is None else MeshStream((surface,), (self.path,))


def single_mesh_scene(source: FileMesh, source_bytes: int, warnings: tuple[str, ...] = ()) -> Scene:
    """One instance of one mesh."""
    return scene_of([source], np.zeros(1, np.int32), IDENTITY[None], source_bytes=source_bytes, warnings=warnings)
