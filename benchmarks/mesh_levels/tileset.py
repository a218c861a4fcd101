"""A tileset of mesh levels of detail: a quadtree of cells, each with a chain of levels, refined by replacement."""

from __future__ import annotations

import gzip
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from farfield.octree.grid import Grid
from farfield.scene.model import Scene
from mesh_levels.cells import Cell, above, taken_apart
from mesh_levels.contents import Box, Contained, Content, Kinds, Once, Shelf

NEVER = 1e9
"""Metres: the error of a tile without content, which is never looked at."""
FINEST = -2
"""Level of the finest tiles: an error of a quarter of a leaf's pixel."""
COPIED = (-1, 0, 2, 4)
"""Levels of a cell with copies of what stands in many."""
COARSER = 2
"""Levels above the one that is a single cell: little, for the first moment."""
WORTH = 0.6
"""A coarser level must take at most this share of the bytes of what it stands in for, or it is left out."""


def write_tileset(folder: Path, scene: Scene, grid: Grid, instanced: bool) -> dict[str, int]:
    """Writes the tileset of a scene, with the cells and errors of a farfield world's grid; returns its figures.

    instanced: what stands many times is stored once a level, else it is copied into every tile.
    """
    corner = np.array(grid.corner)[:2]
    contents = taken_apart(scene, corner, grid.leaf_size)
    cells = sorted({*contents.placements, *contents.unique})
    top = next(level for level in range(32) if len(above(cells, level)) == 1)
    errors = {level: grid.pitch(0) * 2.0**level for level in range(FINEST, max(top + COARSER, *COPIED) + 1)}
    shelf = Shelf(folder)
    made: Contained = Kinds(contents, errors, shelf, instanced) if contents.kinds else Once(contents, errors, shelf)
    tree = _Tree(made, errors, cells)
    if contents.kinds and not instanced:
        # A parent of copies is as large as its children: leaves do not become fewer. Cells have chains alone.
        roots = [tree.chain(cell, COPIED) for cell in cells]
    else:
        roots = [tree.tile(top, cell, tuple(leaves)) for cell, leaves in above(cells, top).items()]
        for level in range(top + 1, top + COARSER + 1):
            roots = [tree.over(level, roots[0], cells)]
    children = [*_ground(contents.ground, errors, shelf), *roots]
    root = _tile(_around([_box(child) for child in children]), 4 * errors[top + COARSER], None, children) | {
        "refine": "ADD"
    }
    shutil.rmtree(shelf.work)
    compressed(folder)
    without_what_saves_little(root, folder)
    document = {"asset": {"version": "1.1"}, "geometricError": root["geometricError"], "root": root}
    (folder / "tileset.json").write_text(json.dumps(document, separators=(",", ":")))
    return {"files": len(list(folder.rglob("*.*"))), "bytes": compressed(folder)}


def compressed(folder: Path) -> int:
    """Leaves FILE.gz beside each file that gzip makes smaller; returns the bytes that would be sent of all."""
    total = 0
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix != ".gz":
            raw = path.read_bytes()
            small = gzip.compress(raw, 9, mtime=0)
            if len(small) < 0.97 * len(raw):
                path.with_name(path.name + ".gz").write_bytes(small)
            total += min(len(small), len(raw))
    return total


def without_what_saves_little(tile: dict[str, Any], folder: Path) -> int:
    """Takes the contents off tiles hardly smaller than those below; returns the bytes that show a tile whole."""
    below = sum(without_what_saves_little(child, folder) for child in tile.get("children", []))
    if "content" not in tile:
        return below
    own = min(path.stat().st_size for path in _forms(folder / tile["content"]["uri"]))
    if tile.get("children") and own > WORTH * below and not tile["content"]["uri"].endswith(".cmpt"):
        del tile["content"]
        tile["geometricError"] = max(tile["geometricError"], NEVER)
        return below
    return own


def _forms(path: Path) -> list[Path]:
    return [form for form in (path, path.with_name(path.name + ".gz")) if form.exists()]


@dataclass(frozen=True, slots=True)
class _Tree:
    made: Contained
    errors: dict[int, float]
    cells: Sequence[Cell]

    def tile(self, level: int, cell: Cell, leaves: tuple[Cell, ...]) -> dict[str, Any]:
        """A tile and all below it."""
        if level == 0:
            return self.chain(cell, range(FINEST, 1))
        content = self.made.content(level, cell, leaves)
        below = above(list(leaves), level - 1)
        children = [self.tile(level - 1, child, tuple(own)) for child, own in below.items()]
        return _tile(content.box, self.errors[level], content, children)

    def over(self, level: int, below: dict[str, Any], leaves: Sequence[Cell]) -> dict[str, Any]:
        """A coarser tile of everything."""
        content = self.made.content(level, (0, 0), tuple(leaves))
        return _tile(content.box, self.errors[level], content, [below])

    def chain(self, cell: Cell, levels: Sequence[int]) -> dict[str, Any]:
        """The levels of a leaf cell, without those that save little."""
        made = None
        least = 0
        for level in levels:
            content = self.made.content(level, cell, (cell,))
            if made is not None and content.cost > WORTH * least:
                continue
            least = content.cost
            made = _tile(content.box, self.errors[level] if made else 0.0, content, [made] if made else [])
        assert made is not None
        return made


def _ground(meshes: Sequence[Any], errors: dict[int, float], shelf: Shelf) -> list[dict[str, Any]]:
    """A plane with its texture as a user would: a coarse picture first, then one for each level."""
    found = []
    for number, mesh in enumerate(meshes):
        made: dict[str, Any] | None = None
        seen = ""
        for level, error in errors.items():
            content = shelf.pack(f"ground-{number}-{level}", mesh, error)
            if made is not None and content.cost > WORTH * int(seen):
                continue
            seen = str(content.cost)
            made = _tile(content.box, error if made else 0.0, content, [made] if made else [])
        found.append(made)
    return [tile for tile in found if tile is not None]


def _tile(box: Box, error: float, content: Content | None, children: list[dict[str, Any]]) -> dict[str, Any]:
    box = _around([box, *(_box(child) for child in children)])
    middle, half = box.mean(0), np.maximum((box[1] - box[0]) / 2, 1e-3)
    tile: dict[str, Any] = {
        "boundingVolume": {"box": [round(float(v), 3) for v in [*middle, *np.diag(half).ravel()]]},
        "geometricError": error,
        "refine": "REPLACE",
    }
    if content is not None:
        tile["content"] = {"uri": content.name}
    return tile | ({"children": children} if children else {})


def _box(tile: dict[str, Any]) -> Box:
    values = np.array(tile["boundingVolume"]["box"])
    half = np.diag(values[3:].reshape(3, 3))
    return np.stack([values[:3] - half, values[:3] + half])


def _around(boxes: Sequence[Box]) -> Box:
    stacked = np.stack(boxes)
    return np.stack([stacked[:, 0].min(0), stacked[:, 1].max(0)])
