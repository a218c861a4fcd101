"""How sources are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of `read_scene`; what a scene.toml says about a source comes first."""

    up: Literal["y", "z"] | None = None
    """Axis that points up in the file; None: y for glTF, z for everything else."""
    height_attribute: str | None = None
    """Footprints: the column of heights in metres; None: found by its name."""
    base_attribute: str | None = None
    """Footprints: the column of ground altitudes; None: the ground is flat at 0."""
    default_height: float | None = None
    """Footprints without a height get this, metres; None: they are left out and counted."""
    layer: str | None = None
    """Footprints: the layer of a GeoPackage; None: the first."""
    facades: bool = True
    """Footprints: windowed walls; False: plain colours."""
    buildings_per_mesh: int = 4096
    """Footprints: a file is split by place into meshes of at most about this many."""
    crs: str | None = None
    """Footprints in another coordinate reference system are brought to this one; None: they keep theirs."""
    inside: tuple[Path, ...] = ()
    """The scene.toml files that led here, outermost first."""
