"""The node tree: which mesh stands where, EXT_mesh_gpu_instancing included."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.faults import EXPORT_AGAIN
from farfield.scene.gltf.accessors import accessor_floats
from farfield.scene.gltf.container import Document

_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def placements(document: Document) -> list[tuple[int, NDArray[np.float64]]]:
    """Mesh number and (k, 3, 4) float64 transforms, z up on both sides, in the order of the tree.

    Raises InputError when the tree has a cycle or refers to what is not there.
    """
    found: list[tuple[int, NDArray[np.float64]]] = []
    pending = [(node, np.eye(4), 0) for node in reversed(_roots(document))]
    visited = 0
    while pending:
        index, parent, depth = pending.pop()
        visited += 1
        node = document.item("nodes", index)
        if depth > len(document.items("nodes")) or visited > 10_000_000:
            raise InputError("is damaged: its nodes form a cycle", document.where, EXPORT_AGAIN)
        world = parent @ _local(node)
        if "mesh" in node:
            document.item("meshes", node["mesh"])
            found.append((node["mesh"], _instanced(document, node, world)))
        pending.extend((child, world, depth + 1) for child in reversed(node.get("children", [])))
    return found


def rotation_matrices(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 4) x, y, z, w, any length -> (k, 3, 3)."""
    length = np.sqrt((quaternions * quaternions).sum(1, keepdims=True))
    x, y, z, w = np.divide(quaternions, length, out=np.tile([0.0, 0, 0, 1], (len(length), 1)), where=length > 0).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _roots(document: Document) -> list[int]:
    scenes = document.items("scenes")
    if scenes:
        roots: list[int] = document.item("scenes", document.json.get("scene", 0)).get("nodes", [])
        return roots
    nodes = document.items("nodes")
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _local(node: dict[str, Any]) -> NDArray[np.float64]:
    """(4, 4) of a node, y up."""
    if "matrix" in node:
        matrix: NDArray[np.float64] = np.array(node["matrix"], np.float64).reshape(4, 4).T
        return matrix
    composed: NDArray[np.float64] = _compose(
        np.array([node.get("translation", (0, 0, 0))], np.float64),
        np.array([node.get("rotation", (0, 0, 0, 1))], np.float64),
        np.array([node.get("scale", (1, 1, 1))], np.float64),
    )[0]
    return composed


def _compose(
    translation: NDArray[np.float64], rotation: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(k, 4, 4): scale, then rotate, then translate."""
    out = np.tile(np.eye(4), (len(translation), 1, 1))
    out[:, :3, :3] = rotation_matrices(rotation) * scale[:, None, :]
    out[:, :3, 3] = translation
    return out


def _instanced(document: Document, node: dict[str, Any], world: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3, 4), z up: one placement, or all those of EXT_mesh_gpu_instancing."""
    table = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {})
    given = {
        name: accessor_floats(document, table[name]) for name in ("TRANSLATION", "ROTATION", "SCALE") if name in table
    }
    if given:
        count = len(next(iter(given.values())))
        local = _compose(
            given.get("TRANSLATION", np.zeros((count, 3))),
            given.get("ROTATION", np.tile([0.0, 0, 0, 1], (count, 1))),
            given.get("SCALE", np.ones((count, 3))),
        )
        matrices = world @ local
    else:
        matrices = world[None]
    return np.ascontiguousarray((_Z_UP @ matrices @ _Z_UP.T)[:, :3])
