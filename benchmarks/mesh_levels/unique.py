"""The scene of Tokyo with unique façades: a GLB for each cell, on the same ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from farfield.scene.read import read_scene
from mesh_levels.cells import taken_apart
from mesh_levels.facades import write_cell
from mesh_levels.glb import joined


def make_unique(scene: Path, folder: Path, cell_size: float) -> Path:
    """scene: scene.toml of footprints on a ground. Writes the cells and a scene.toml, unless it is there."""
    target = folder / "scene.toml"
    if target.exists():
        return target
    folder.mkdir(parents=True, exist_ok=True)
    cells = taken_apart(read_scene([scene]), np.zeros(2), cell_size).unique
    lines = []
    for seed, (cell, meshes) in enumerate(sorted(cells.items())):
        name = f"cell_{cell[0]}_{cell[1]}.glb"
        write_cell(folder / name, joined(meshes), seed)
        lines.append(f'[[source]]\npath = "{name}"')
    text = scene.read_text()
    credits = next(line for line in text.splitlines() if line.startswith("credits"))
    target.write_text("\n\n".join([credits, *lines, text[text.index("[[ground]]") :]]))
    return target
