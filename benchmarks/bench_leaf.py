"""What it costs to draw a leaf: per view, both rasterisers and each part, on micro-triangles, a statue and a city."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from farfield.geometry.directions import PRINCIPAL, principal
from farfield.octree.grid import CellKey, Grid
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview import leaf, visibility
from farfield.scene.model import Material, Mesh

CELL = CellKey(0, 0, 0, 0)
VIEWS = (PRINCIPAL.index((0, 0, 1)), PRINCIPAL.index((0, -1, 0)), PRINCIPAL.index((1, 1, 1)))


def run(quick: bool = False) -> dict[str, Any]:
    """Milliseconds a view (processor time of one thread, least of several runs) and million triangles a second."""
    resolution, share = (64, 50) if quick else (512, 1)
    grid = Grid(1.0, resolution, (0.0, 0.0, 0.0), (0, 0, 0))
    table = MaterialTable.build([Material(base_color=(0.8, 0.5, 0.3, 1.0))])
    subjects = {
        "leaves": foliage(1_000_000 // share),
        "statue": statue(6 if share == 1 else 3),
        "city": city(20_000 // share),
    }
    return {name: _measured(mesh, table, grid, 1 if quick else 5) for name, mesh in subjects.items()}


def _measured(mesh: Mesh, table: MaterialTable, grid: Grid, runs: int) -> dict[str, float]:
    blocked = BlockedMesh.from_mesh(mesh)
    chunk = blocked.cell_chunk(np.eye(3, 4), grid, (0, 0, 0))
    assert chunk is not None
    figures: dict[str, float] = {"triangles": len(chunk.triangles)}
    figures["clip_ms"] = _least(lambda: blocked.cell_chunk(np.eye(3, 4), grid, (0, 0, 0)), runs)
    for layers in (1, 2):
        figures[f"view_{layers}_ms"] = _views(chunk, table, grid, layers, runs)
    figures["million_triangles_per_second"] = len(chunk.triangles) / figures["view_1_ms"] / 1e3
    chosen = visibility.KEY_BELOW
    for name, limit in (("visibility", 0.0), ("key", np.inf)):
        visibility.KEY_BELOW = limit
        figures[f"view_1_{name}_ms"] = _views(chunk, table, grid, 1, runs)
    visibility.KEY_BELOW = chosen
    return figures


def _views(chunk: Chunk, table: MaterialTable, grid: Grid, layers: int, runs: int) -> float:
    times = [
        _least(lambda n=number: leaf.draw_leaf(chunk, table, grid, CELL, principal(n), 2, layers), runs)
        for number in VIEWS
    ]
    return float(np.mean(times))


def _least(call: Callable[[], Any], runs: int) -> float:
    call()
    least = np.inf
    for _ in range(runs):
        begun = time.thread_time()
        call()
        least = min(least, (time.thread_time() - begun) * 1e3)
    return float(least)


def foliage(count: int) -> Mesh:
    """Small triangles everywhere in the unit cube."""
    generator = np.random.default_rng(1)
    middle = generator.random((count, 1, 3)) * 0.9 + 0.05
    corners = (middle + generator.normal(0, 0.002, (count, 3, 3))).reshape(-1, 3)
    return _flat(trimesh.Trimesh(corners, np.arange(3 * count).reshape(-1, 3), process=False))


def statue(subdivisions: int) -> Mesh:
    """A bumpy ball of smooth triangles: 82,000 at 6 subdivisions."""
    ball = trimesh.creation.icosphere(subdivisions)
    ball.vertices *= (1 + 0.02 * np.sin(40 * ball.vertices).sum(1))[:, None]
    ball.vertices = ball.vertices * 0.42 + 0.5
    count = len(ball.faces)
    normals = np.array(ball.vertex_normals, dtype=np.float32)
    return Mesh(np.array(ball.vertices), np.array(ball.faces, np.uint32), normals, (), np.zeros(count, np.uint16))


def city(count: int) -> Mesh:
    """Boxes of 12 large triangles."""
    generator = np.random.default_rng(2)
    boxes = []
    for _ in range(count // 12):
        box = trimesh.creation.box(generator.uniform(0.02, 0.08, 3))
        box.apply_translation([*generator.uniform(0.05, 0.95, 2), 0.1])
        boxes.append(box)
    return _flat(trimesh.util.concatenate(boxes))


def _flat(shape: trimesh.Trimesh) -> Mesh:
    corners = np.array(shape.triangles, dtype=np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat(across / np.linalg.norm(across, axis=1, keepdims=True), 3, axis=0).astype(np.float32)
    triangles = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), triangles, normals, (), np.zeros(len(corners), np.uint16))
