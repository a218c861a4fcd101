"""From what a file says to a Mesh that can be relied on: bad triangles out and counted, normals complete."""

from __future__ import annotations

from dataclasses import dataclass, replace

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


def assemble(raw: RawSurface, where: str) -> Mesh:
    """The Mesh of a raw surface; its `warnings` count, at `where`, what had to be left out."""
    warnings: list[str] = []
    keep = _usable(raw, where, warnings)
    triangles = raw.triangles[keep].astype(np.uint32)
    vectors = face_vectors(raw.positions, triangles)
    solid = _with_area(raw.positions, triangles, vectors)
    if not solid.all():
        warnings.append(f"{where}: left out {counted(int((~solid).sum()), 'triangle')} of zero area")
        triangles, vectors = triangles[solid], vectors[solid]
        keep[keep] = solid
    if not len(triangles):
        warnings.append(f"{where}: has no usable triangles")
    triangles, source, normals = fill_normals(raw.positions, vectors, triangles, _given_normals(raw), raw.crease_cosine)
    used = np.zeros(len(source), bool)
    used[triangles.ravel()] = True
    if not used.all():
        number = np.cumsum(used) - 1
        triangles, source, normals = number[triangles].astype(np.uint32), source[used], normals[used]
    material = raw.triangle_material if raw.triangle_material is not None else np.zeros(len(keep), np.uint16)
    return Mesh(
        positions=np.ascontiguousarray(raw.positions[source], np.float64),
        triangles=np.ascontiguousarray(triangles),
        normals=normals.astype(np.float32),
        materials=raw.materials,
        triangle_material=np.ascontiguousarray(material[keep]),
        uvs=None if raw.uvs is None else _finite_uvs(raw.uvs[source]),
        colors=None if raw.colors is None else np.ascontiguousarray(raw.colors[source]),
        triangle_object=None if raw.triangle_object is None else raw.triangle_object[keep],
        object_count=raw.object_count,
        warnings=tuple(warnings),
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


def _usable(raw: RawSurface, where: str, warnings: list[str]) -> NDArray[np.bool_]:
    """(m,) bool: triangles whose vertices exist, are finite and lie near the others."""
    inside: NDArray[np.bool_] = np.all((raw.triangles >= 0) & (raw.triangles < len(raw.positions)), axis=1)
    if not inside.all():
        count = counted(int((~inside).sum()), "triangle")
        warnings.append(f"{where}: left out {count} with vertices that do not exist")
    finite: NDArray[np.bool_] = np.all(np.isfinite(raw.positions), axis=1)
    keep: NDArray[np.bool_] = inside.copy()
    keep[inside] = finite[raw.triangles[inside]].all(axis=1)
    if not finite.all():
        lost = counted(int((inside & ~keep).sum()), "triangle")
        warnings.append(f"{where}: left out {lost} with vertices that are NaN or infinite")
    if finite.any():
        _drop_far(raw, finite, keep, where, warnings)
    return keep


def _drop_far(
    raw: RawSurface, finite: NDArray[np.bool_], keep: NDArray[np.bool_], where: str, warnings: list[str]
) -> None:
    points = raw.positions if finite.all() else raw.positions[finite]
    if max(np.ptp(points[:, axis]) for axis in range(3)) <= ABSURD_METRES:
        return
    middle = np.median(points, axis=0)
    with np.errstate(invalid="ignore"):
        near: NDArray[np.bool_] = np.all(np.abs(raw.positions - middle) <= ABSURD_METRES, axis=1)
    kept = keep.copy()
    keep[kept] = near[raw.triangles[kept]].all(axis=1)
    lost = int(kept.sum() - keep.sum())
    if lost:
        warnings.append(f"{where}: left out {counted(lost, 'triangle')} more than 10,000 km from the rest")


def _with_area(
    positions: NDArray[np.float64], triangles: NDArray[np.uint32], vectors: NDArray[np.float64]
) -> NDArray[np.bool_]:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    longest = np.maximum(((b - a) ** 2).sum(1), np.maximum(((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)))
    solid: NDArray[np.bool_] = np.sqrt((vectors * vectors).sum(1)) > SLIVER * longest
    return solid


def _given_normals(raw: RawSurface) -> NDArray[np.float64]:
    """(n, 3) unit; rows of NaN where the file has none, or one without direction."""
    if raw.normals is None:
        return np.full((len(raw.positions), 3), np.nan)
    length = np.sqrt((raw.normals * raw.normals).sum(1, keepdims=True))
    good = np.isfinite(length) & (length > 1e-6)
    scaled: NDArray[np.float64] = np.divide(raw.normals, length, out=np.full(raw.normals.shape, np.nan), where=good)
    return scaled


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
