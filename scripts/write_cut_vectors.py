"""Writes tests/vectors/cut/*.json: viewpoints and the cuts that belong to them, for pytest and vitest alike.

    python scripts/write_cut_vectors.py

Each file is a world (its grid and the occupied leaves) with cases: eye, radius and near radius, the cells of the cut in
order of discovery, and the view bin of each cell of it (from the middle of the cell's box). The same every time.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.octree.cut import cut, near_radius, view_bin
from farfield.octree.grid import CellKey, Grid, axis_levels_of

FOLDER = Path(__file__).parents[1] / "tests/vectors/cut"


@dataclass(frozen=True, slots=True)
class LeafTree:
    """A tree of which only the occupied leaves are known."""

    grid: Grid
    leaves: list[tuple[int, int, int]]

    def occupied(self) -> dict[CellKey, list[CellKey]]:
        """Every cell that holds something with those below it, ascending."""
        below: dict[CellKey, set[CellKey]] = {CellKey(0, *leaf): set() for leaf in self.leaves}
        for level in range(self.grid.top_level):
            for key in [key for key in below if key.level == level]:
                below.setdefault(self.grid.parent(key), set()).add(key)
        return {key: sorted(children) for key, children in below.items()}


@dataclass(frozen=True, slots=True)
class KnownTree:
    """A `Tree` for `cut`."""

    below: dict[CellKey, list[CellKey]]
    top: int

    @property
    def roots(self) -> list[CellKey]:
        """Cells of the top level, ascending."""
        return sorted(key for key in self.below if key.level == self.top)

    def children(self, key: CellKey) -> list[CellKey]:
        """Occupied cells below."""
        return self.below[key]


def known_tree(grid: Grid, leaves: list[tuple[int, int, int]]) -> KnownTree:
    """The tree over some leaves."""
    return KnownTree(LeafTree(grid, leaves).occupied(), grid.top_level)


def case_of(tree: KnownTree, grid: Grid, case: dict[str, object]) -> dict[str, object]:
    """The case with its cut."""
    eye = np.array(case["eye"], dtype=np.float64)
    found = cut(tree, grid, eye, float(str(case["radius"])), float(str(case["near"])))
    chosen = [*found.pictures, *found.geometry]
    return case | {
        "pictures": [str(key) for key in found.pictures],
        "geometry": [str(key) for key in found.geometry],
        "bins": [view_bin(grid.bounds(key).mean(0), eye) for key in chosen],
    }


def cases(grid: Grid, eyes: list[list[float]]) -> list[dict[str, object]]:
    """Viewpoints with pictures of several widths, biases and near radii."""
    settings = [(640, 60.0, 0.0, None), (1920, 90.0, 0.5, None), (320, 40.0, -1.0, 0.0), (640, 60.0, 1.0, 0.0)]
    listed: list[dict[str, object]] = []
    for number, eye in enumerate(eyes):
        width, degrees, bias, near = settings[number % len(settings)]
        r = near_radius(grid, width, math.radians(degrees))
        listed.append({"eye": eye, "radius": r / 2**bias, "near": r if near is None else near})
    return listed


def _leaves(rows: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    unique = np.unique(rows, axis=0)
    return [(int(x), int(y), int(z)) for x, y, z in unique]


def worlds() -> dict[str, tuple[Grid, list[tuple[int, int, int]], list[list[float]]]]:
    """Name -> grid, leaves, eyes."""
    random = np.random.default_rng(26)
    made = {}
    for name, low, high, count, leaf, resolution, corner in (
        ("flat_town", (-6, -5, 0), (6, 7, 1), 150, 64.0, 512, (0.0, 0.0, -2.5)),
        ("tower", (0, 0, 0), (2, 2, 17), 60, 8.0, 128, (-8.125, 3.5, 100.0)),
        ("scattered", (-12, -12, -12), (12, 12, 12), 120, 0.5, 64, (0.1, 0.2, 0.3)),
        ("one_leaf", (0, 0, 0), (1, 1, 1), 1, 16.0, 256, (-3.0, -3.0, -3.0)),
    ):
        leaves = _leaves(random.integers(low, high, (count, 3)))
        array = np.array(leaves)
        grid = Grid(leaf, resolution, corner, axis_levels_of(array.min(0), array.max(0)))
        lower = np.array(corner) + array.min(0) * leaf
        upper = np.array(corner) + (array.max(0) + 1) * leaf
        span = upper - lower
        eyes = [(lower + span * random.uniform(-1.5, 2.5, 3)).tolist() for _ in range(10)]
        # On the corner, on a plane between cells, in the middle, and far away.
        eyes += [lower.tolist(), list(corner), ((lower + upper) / 2).tolist(), (upper + span * 40).tolist()]
        made[name] = (grid, leaves, eyes)
    return made


def written() -> dict[str, str]:
    """File name -> its text."""
    files = {}
    for name, (grid, leaves, eyes) in worlds().items():
        tree = known_tree(grid, leaves)
        content = {
            "grid": {
                "leaf_size": grid.leaf_size,
                "resolution": grid.resolution,
                "corner": grid.corner,
                "axis_levels": grid.axis_levels,
            },
            "leaves": leaves,
            "cases": [case_of(tree, grid, case) for case in cases(grid, eyes)],
        }
        files[f"{name}.json"] = json.dumps(content, separators=(",", ":")) + "\n"
    return files


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file_name, text in written().items():
        (FOLDER / file_name).write_text(text)
        print(FOLDER / file_name, len(text))
