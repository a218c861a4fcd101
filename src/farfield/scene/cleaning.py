"""From what a file says to a Mesh that can be relied on: bad triangles out and counted, normals complete."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.faults import counted
from farfield.scene.model import Material, Mesh
from farfield.scene.shading import CREASE_COSINE, face_vectors, fill_normals

ABSURD_METRES = 1e7
"""Coordinates further than this from the median are mistakes: the Earth's radius is 6.4e6 m."""

SLIVER = 1e-12
"""Twice a triangle's area over its longest edge squared; below it the normal is rounding noise."""


@dataclass(frozen=True, slots=True, eq=False)
class RawSurface:
    """Triangles as a file gives them, nothing checked."""

    positions: NDArray[np.float64]
    """(n, 3)."""
    triangles: NDArray[np.int64]
    """(m, 3) into positions; may point outside."""
    normals: NDArray[np.float64] | None = None
    """(n, 3) or None."""
    uvs: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None
    materials: tuple[Material, ...] = (Material(),)
    triangle_material: NDArray[np.uint16] | None = None
    triangle_object: NDArray[np.uint32] | None = None
    object_count: int = 1
    crease_cosine: float = CREASE_COSINE
    """Where missing normals turn from smooth to faceted; see `shading`."""


@dataclass(slots=True)
class Losses:
    """How many triangles cannot be used, by the first reason that was found."""

    absent: int = 0
    unfinite: int = 0
    far: int = 0
    flat: int = 0

    def lines(self, where: str) -> tuple[str, ...]:
        """A line for each reason that there is."""
        reasons = (
            (self.absent, " with vertices that do not exist"),
            (self.unfinite, " with vertices that are NaN or infinite"),
            (self.far, " more than 10,000 km from the rest"),
            (self.flat, " of zero area"),
        )
        return tuple(f"{where}: left out {counted(count, 'triangle')}{why}" for count, why in reasons if count)


def assemble(raw: RawSurface, where: str) -> Mesh:
    """The Mesh of a raw surface; its `warnings` count, at `where`, what had to be left out."""
    losses = Losses()
    keep, vectors = usable(raw.positions, raw.triangles, _absurd_middle(raw.positions), losses)
    mesh = shaded(raw, raw.triangles[keep].astype(np.uint32), vectors)
    material = raw.triangle_material if raw.triangle_material is not None else np.zeros(len(keep), np.uint16)
    return replace(
        mesh,
        triangle_material=np.ascontiguousarray(material[keep]),
        triangle_object=None if raw.triangle_object is None else raw.triangle_object[keep],
        object_count=raw.object_count,
        warnings=losses.lines(where) + (() if keep.any() else (nothing_usable(where),)),
    )


def nothing_usable(where: str) -> str:
    """The warning of a mesh of which nothing is left."""
    return f"{where}: has no usable triangles"


def usable(
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    middle: NDArray[np.float64] | None,
    losses: Losses,
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which triangles can be drawn, (m,) bool, and the vectors of these (see `shading.face_vectors`).

    positions: (n, 3), anything. triangles: (m, 3), which may point outside. middle: (3,) what vertices may be no
    further than ABSURD_METRES from along any axis; None: they are near each other. The others are counted in `losses`.
    """
    keep: NDArray[np.bool_] = np.all((triangles >= 0) & (triangles < len(positions)), axis=1)
    losses.absent += int((~keep).sum())
    losses.unfinite += _drop(keep, triangles, np.all(np.isfinite(positions), axis=1))
    if middle is not None:
        with np.errstate(invalid="ignore"):
            losses.far += _drop(keep, triangles, np.all(np.abs(positions - middle) <= ABSURD_METRES, axis=1))
    kept = triangles[keep].astype(np.uint32)
    vectors = face_vectors(positions, kept)
    solid = _with_area(positions, kept, vectors)
    losses.flat += int((~solid).sum())
    keep[keep] = solid
    return keep, vectors if solid.all() else vectors[solid]


def shaded(
    raw: RawSurface,
    triangles: NDArray[np.uint32],
    vectors: NDArray[np.float64],
    chosen: NDArray[np.intp] | None = None,
) -> Mesh:
    """The Mesh of usable triangles, its normals complete, of the first material and one object.

    triangles: (m, 3) into the vertices of `raw`, whose own are not looked at. vectors: (m, 3) of these.
    chosen: which of them become the mesh, in that order, once all have had their part in the normals; None: all.
    """
    triangles, source, normals = fill_normals(raw.positions, vectors, triangles, _given_normals(raw), raw.crease_cosine)
    if chosen is not None:
        triangles = triangles[chosen]
    used = np.zeros(len(source), bool)
    used[triangles.ravel()] = True
    if not used.all():
        number = np.cumsum(used) - 1
        triangles, source, normals = number[triangles].astype(np.uint32), source[used], normals[used]
    return Mesh(
        positions=np.ascontiguousarray(raw.positions[source], np.float64),
        triangles=np.ascontiguousarray(triangles),
        normals=normals.astype(np.float32),
        materials=raw.materials,
        triangle_material=np.zeros(len(triangles), np.uint16),
        uvs=None if raw.uvs is None else _finite_uvs(raw.uvs[source]),
        colors=None if raw.colors is None else np.ascontiguousarray(raw.colors[source]),
    )


def clean(mesh: Mesh, where: str) -> Mesh:
    """The mesh without unusable triangles and with complete normals; adds to its `warnings` what was left out."""
    raw = RawSurface(
        mesh.positions, mesh.triangles.astype(np.int64), mesh.normals.astype(np.float64), mesh.uvs, mesh.colors,
        mesh.materials, mesh.triangle_material, mesh.triangle_object, mesh.object_count,
    )  # fmt: skip
    cleaned = assemble(raw, where)
    return replace(cleaned, warnings=mesh.warnings + cleaned.warnings)


def merge(parts: list[Mesh]) -> Mesh:
    """One mesh of several that are one object together (the primitives of a glTF mesh); materials stay shared."""
    if len(parts) == 1:
        return parts[0]
    materials: list[Material] = []
    remapped = [_remap_materials(part, materials) for part in parts]
    starts = np.concatenate([[0], np.cumsum([len(part.positions) for part in parts])])
    return Mesh(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=np.concatenate([part.triangles + np.uint32(s) for part, s in zip(parts, starts, strict=False)]),
        normals=np.concatenate([part.normals for part in parts]),
        materials=tuple(materials),
        triangle_material=np.concatenate(remapped),
        uvs=_stack([part.uvs for part in parts], starts, np.zeros((1, 2), np.float32)),
        colors=_stack([part.colors for part in parts], starts, np.full((1, 4), 255, np.uint8)),
        warnings=tuple(line for part in parts for line in part.warnings),
    )


def _drop(keep: NDArray[np.bool_], triangles: NDArray[np.int64], good: Any) -> int:
    """Takes triangles with a vertex that is not good out of `keep`; how many."""
    before = int(keep.sum())
    keep[keep] = good[triangles[keep]].all(axis=1)
    return before - int(keep.sum())


def _absurd_middle(positions: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3,) the median of the finite positions where they reach further than is believable, else None."""
    finite = np.isfinite(positions).all(axis=1)
    points = positions if finite.all() else positions[finite]
    if not len(points) or max(np.ptp(points[:, axis]) for axis in range(3)) <= ABSURD_METRES:
        return None
    return np.asarray(np.median(points, axis=0))


def _with_area(
    positions: NDArray[np.float64], triangles: NDArray[np.uint32], vectors: NDArray[np.float64]
) -> NDArray[np.bool_]:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    longest = np.maximum(((b - a) ** 2).sum(1), np.maximum(((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)))
    solid: NDArray[np.bool_] = np.sqrt((vectors * vectors).sum(1)) > SLIVER * longest
    return solid


def _given_normals(raw: RawSurface) -> NDArray[np.float64]:
    """(n, 3) unit; rows of NaN where the file has none, or one without direction."""
    return np.full((len(raw.positions), 3), np.nan) if raw.normals is None else unit_or_missing(raw.normals)


def unit_or_missing(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) unit; rows of NaN for those without direction."""
    length = np.sqrt((normals * normals).sum(1, keepdims=True))
    good = np.isfinite(length) & (length > 1e-6)
    scaled: NDArray[np.float64] = np.divide(normals, length, out=np.full(normals.shape, np.nan), where=good)
    return scaled


def visible(colors: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
    """The colours, or None when they are all white and change nothing."""
    return None if colors is None or (colors == 255).all() else colors


def _finite_uvs(uvs: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.nan_to_num(np.ascontiguousarray(uvs, np.float32), nan=0.0, posinf=0.0, neginf=0.0)


def _remap_materials(part: Mesh, materials: list[Material]) -> NDArray[np.uint16]:
    """The part's triangle_material into the joint list, which grows by what it lacks."""
    table = []
    for material in part.materials:
        if material not in materials:
            materials.append(material)
        table.append(materials.index(material))
    return np.array(table, np.uint16)[part.triangle_material]


def _stack(arrays: list[NDArray[np.generic] | None], starts: NDArray[np.int64], fill: NDArray[np.generic]):  # type: ignore[no-untyped-def]
    """Rows of all parts, `fill` where a part has none; None when no part has any."""
    if all(array is None for array in arrays):
        return None
    counts = np.diff(starts)
    return np.concatenate(
        [np.repeat(fill, n, 0) if array is None else array for array, n in zip(arrays, counts, strict=True)]
    )
