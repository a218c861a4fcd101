"""How sources are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Region = tuple[float, float, float, float]
"""x0, y0, x1, y1: a rectangle of the plane in coordinates of the CRS, half-open."""
Facades = bool | Literal["unique"]
"""Walls of footprints: plain or with windows, or each building with windows of its own."""


def inside(points: NDArray[np.float64], region: Region) -> NDArray[np.bool_]:
    """(n,) bool: which of the points (n, 2 or more) lie in a region."""
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= region[0]) & (y >= region[1]) & (x < region[2]) & (y < region[3]))


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of `read_scene`; what a scene.toml says about a source comes first."""

    up: Literal["y", "z"] | None = None
    """Axis that points up in the file; None: y for glTF, z for everything else."""
    height_attribute: str | None = None
    """Footprints: the column of heights in metres; None: found by its name."""
    base_attribute: str | None = None
    """Footprints: the column of ground altitudes; None: the ground is flat at 0."""
    top_attribute: str | None = None
    """Footprints: the column of roof altitudes; heights are then these above the ground where both are known."""
    min_height_attribute: str | None = None
    """Footprints: the column of metres above the ground where the walls begin; None: at the ground."""
    wall_color_attribute: str | None = None
    """Footprints: the column of colours of the walls, as CSS has them; None: they are drawn by chance."""
    roof_color_attribute: str | None = None
    """Likewise of the roofs."""
    default_height: float | None = None
    """Footprints without a height get this, metres; None: they are left out and counted."""
    layer: str | None = None
    """Footprints: the layer of a GeoPackage; None: the first."""
    facades: Facades = True
    """Footprints and CityJSON: windowed walls; False: plain colours; footprints, "unique": a façade of their own for
    all."""
    use_attribute: str | None = None
    """Footprints with unique façades: the column that says what buildings are used for; None: their height decides."""
    lod: float | None = None
    """CityJSON: of each object the highest level of detail that is not above it; None: the highest."""
    region: Region | None = None
    """Footprints: only those whose middle lies in it; None: all."""
    buildings_per_mesh: int | None = None
    """Footprints: a file is split by place into meshes of at most about this many; None: the usual number."""
    crs: str | None = None
    """Footprints and CityJSON of another coordinate reference system are brought to it; None: they keep theirs."""
    origin: tuple[float, float, float] | None = None
    """Local zero of everything with a CRS, unless the only source is a scene.toml that tells one; None: it follows
    from what is read."""
    inside: tuple[Path, ...] = ()
    """The scene.toml files that led here, outermost first."""
