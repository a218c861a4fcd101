"""The scene: meshes loaded when needed, placed by instances. Local metres, right-handed, z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Texture:
    """An sRGB image with straight alpha that repeats in both axes. Compared and hashed by identity."""

    pixels: NDArray[np.uint8]
    """(h, w, 4) uint8, sRGB and alpha; row 0 is v = 0 (the glTF convention: v grows downwards)."""


@dataclass(frozen=True, slots=True)
class Material:
    """How a surface looks before any light falls on it."""

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Linear-light factor and alpha, multiplied with texture and vertex colour."""
    texture: Texture | None = None
    alpha_cutoff: float | None = None
    """Alpha below this is a hole; None: alpha is ignored."""
    double_sided: bool = True
    unlit: bool = False
    """Shown as it is, never lit."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles in the mesh's own frame (metres, z up). Arrays are read-only by convention."""

    positions: NDArray[np.float64]
    """(n, 3) float64."""
    triangles: NDArray[np.uint32]
    """(m, 3) uint32 into the vertices, counter-clockwise seen from outside."""
    normals: NDArray[np.float32]
    """(n, 3) float32, unit; computed when the file has none."""
    materials: tuple[Material, ...]
    triangle_material: NDArray[np.uint16]
    """(m,) uint16 into materials."""
    uvs: NDArray[np.float32] | None = None
    """(n, 2) float32 or None."""
    colors: NDArray[np.uint8] | None = None
    """(n, 4) uint8 sRGB with straight alpha, multiplied with the material, or None."""
    triangle_object: NDArray[np.uint32] | None = None
    """(m,) uint32: object within the mesh (0 .. object_count-1), or None: the mesh is one object."""
    object_count: int = 1
    warnings: tuple[str, ...] = ()
    """What loading left out and why, one line each, already counted; whoever loads the mesh passes them on."""


class MeshSource(Protocol):
    """A mesh that can be loaded. Cheap to hold and to pickle (workers load it themselves)."""

    @property
    def name(self) -> str:
        """For people: file and part."""
        ...

    def load(self) -> Mesh:
        """Reads the mesh; it may have no triangles, and then says why in `warnings`.

        Raises InputError when the file is gone or damaged.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """Placements of meshes, one row each."""

    mesh: NDArray[np.int32]
    """(k,) int32 into Scene.meshes."""
    transform: NDArray[np.float64]
    """(k, 3, 4) float64: scene point = transform[:, :3] @ mesh point + transform[:, 3]; may mirror or shear."""
    first_object: NDArray[np.int64]
    """(k,) int64: number of the mesh's object 0 among the scene's objects, from 1; `bake.numbering` gives the ids."""
    objects: NDArray[np.int64]
    """(k,) int64: objects of the mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that is to be baked."""

    meshes: Sequence[MeshSource]
    instances: Instances
    name: str = ""
    """For people, when the source gives one."""
    crs: str | None = None
    """Coordinate reference system (an authority code such as EPSG:6677, or WKT), or None: plain local metres."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """CRS coordinates of the local zero; multiples of 1024 m."""
    credits: tuple[str, ...] = ()
    source_bytes: int = 0
    """Size of the files read."""
    object_count: int = 0
    attributes: dict[str, Any] = field(default_factory=dict)
    """Per-object attributes: column name -> sequence of length object_count (row = object number - 1)."""
    attribute_parts: tuple[str, ...] = ()
    """(k,) for each instance the hash of its objects' attributes once they are stored, or ""; else empty."""
    families: tuple[str, ...] = ()
    """Files of footprints that were read, whether or not anything of them is here."""
    warnings: tuple[str, ...] = ()
    """What was left out and why, one line each, already counted ("3 footprints without height in x.gpkg")."""
