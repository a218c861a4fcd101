"""Putting scenes together: numbering objects, placing, joining."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Instances, MeshSource, Scene

IDENTITY: NDArray[np.float64] = np.eye(4)[:3]


def scene_of(
    meshes: Sequence[MeshSource],
    mesh_rows: NDArray[np.int32],
    transforms: NDArray[np.float64],
    object_counts: NDArray[np.int64] | None = None,
    **fields: Any,
) -> Scene:
    """A Scene whose objects are numbered from 1 in the order of the instances.

    mesh_rows: (k,) into meshes. transforms: (k, 3, 4). object_counts: (meshes,) objects of each mesh, 1 by default.
    fields: the other fields of Scene.
    """
    counts = np.ones(len(meshes), np.int64) if object_counts is None else object_counts
    per_instance = counts[mesh_rows]
    ends = np.cumsum(per_instance)
    first = ends - per_instance + 1
    instances = Instances(mesh_rows.astype(np.int32), np.ascontiguousarray(transforms, np.float64), first, per_instance)
    return Scene(tuple(meshes), instances, object_count=int(ends[-1]) if len(ends) else 0, **fields)


def compose(outer: NDArray[np.float64], inner: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3, 4): first `inner`, then `outer`; leading axes broadcast."""
    linear = outer[..., :3] @ inner[..., :3]
    shift = outer[..., :3] @ inner[..., 3:] + outer[..., 3:]
    return np.concatenate([linear, shift], -1)


def place(scene: Scene, transforms: NDArray[np.float64]) -> Scene:
    """The scene once per transform (k, 3, 4), every copy with objects of its own."""
    copies, rows = len(transforms), len(scene.instances.mesh)
    placed = compose(transforms[:, None], scene.instances.transform[None]).reshape(copies * rows, 3, 4)
    offsets = np.arange(copies, dtype=np.int64)[:, None] * scene.object_count
    instances = Instances(
        np.tile(scene.instances.mesh, copies),
        placed,
        (scene.instances.first_object[None] + offsets).ravel(),
        np.tile(scene.instances.objects, copies),
    )
    attributes = {name: np.tile(np.asarray(column), copies) for name, column in scene.attributes.items()}
    return replace(scene, instances=instances, object_count=copies * scene.object_count, attributes=attributes)


def join(scenes: Sequence[Scene]) -> Scene:
    """One scene of several in the same frame; equal mesh sources become one, objects are renumbered.

    CRS and origin are those of the first scene that has a CRS; the caller has brought the others to it.
    """
    if len(scenes) == 1:
        return scenes[0]
    meshes: list[MeshSource] = []
    number: dict[MeshSource, int] = {}
    parts: list[Instances] = []
    objects = 0
    for scene in scenes:
        rows = np.array([_number(source, meshes, number) for source in scene.meshes], np.int32)
        own = scene.instances
        parts.append(Instances(rows[own.mesh], own.transform, own.first_object + objects, own.objects))
        objects += scene.object_count
    frame = next((scene for scene in scenes if scene.crs is not None), scenes[0])
    return Scene(
        tuple(meshes),
        Instances(
            np.concatenate([part.mesh for part in parts]),
            np.concatenate([part.transform for part in parts]),
            np.concatenate([part.first_object for part in parts]),
            np.concatenate([part.objects for part in parts]),
        ),
        crs=frame.crs,
        origin=frame.origin,
        credits=tuple(dict.fromkeys(line for scene in scenes for line in scene.credits)),
        source_bytes=sum(scene.source_bytes for scene in scenes),
        object_count=objects,
        attributes=_join_attributes(scenes),
        families=tuple(dict.fromkeys(name for scene in scenes for name in scene.families)),
        warnings=tuple(line for scene in scenes for line in scene.warnings),
    )


def _number(source: MeshSource, meshes: list[MeshSource], number: dict[MeshSource, int]) -> int:
    if source not in number:
        number[source] = len(meshes)
        meshes.append(source)
    return number[source]


def _join_attributes(scenes: Sequence[Scene]) -> dict[str, NDArray[Any]]:
    """Columns of all scenes; NaN (numbers) or None (anything else) for the objects of a scene that lacks one."""
    names = dict.fromkeys(name for scene in scenes for name in scene.attributes)
    return {
        name: _join_column([(scene.attributes.get(name), scene.object_count) for scene in scenes]) for name in names
    }


def _join_column(parts: list[tuple[Any, int]]) -> NDArray[Any]:
    given = [np.asarray(column) for column, _ in parts if column is not None]
    if all(column.dtype.kind in "iufb" for column in given):
        kind: Any = np.result_type(*given) if len(given) == len(parts) else np.float64
        filled = [np.full(n, np.nan) if column is None else np.asarray(column, kind) for column, n in parts]
    else:
        filled = [np.full(n, None, object) if column is None else np.asarray(column, object) for column, n in parts]
    return np.concatenate(filled)
