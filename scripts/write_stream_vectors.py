"""Writes tests/vectors/stream/*.json: worlds, viewers and what is to be sent to them, for pytest and vitest alike.

    python scripts/write_stream_vectors.py

Each file is a world (its grid and the entries of its index) with cases: what a viewer says of itself, one after the
other, what it holds, its link, and the first items that the scheduler chooses after the last: cell (of instances their
mesh), whether as geometry, keys, bytes, and benefit in pixel seconds. The same every time.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from farfield.octree.grid import CellKey, Grid
from farfield.stream.link import Link
from farfield.stream.motion import Viewing
from farfield.stream.pictures import Pictures, SentCell
from farfield.stream.regions import Regions, Shape
from farfield.stream.scheduler import Scheduler
from farfield.stream.tree import NONE, CellTree
from farfield.world.index import (
    CellEntry,
    GeometryEntry,
    GeometryLevel,
    Impostor,
    InstancedMesh,
    MeshLevel,
    pack_picks,
)

FOLDER = Path(__file__).parents[1] / "tests/vectors/stream"
MOST = 24
"""Items of a case."""
FOV, SIZE = 55.0, (320, 240)


def tree_over(grid: Grid, leaves: set[CellKey], random: np.random.Generator) -> CellTree:
    """All cells above some leaves, each with random bounds, tiles and picks."""
    levels = [sorted(leaves)]
    while levels[-1][0].level < grid.top_level:
        levels.append(sorted({grid.parent(key) for key in levels[-1]}))
    above, parents = [list(levels[-1])], [NONE] * len(levels[-1])
    first = 0
    for below in reversed(levels[:-1]):
        number = {key: first + n for n, key in enumerate(above[-1])}
        first += len(above[-1])
        # The children of each cell in a row.
        above.append(sorted(below, key=lambda key: (number[grid.parent(key)], key)))
        parents += [number[grid.parent(key)] for key in above[-1]]
    keys = [key for level in above for key in level]
    children = {key: [str(child) for child in grid.children(key) if child in keys] for key in keys}
    return CellTree(grid, [_entry(grid, key, children[key], random) for key in keys], parents)


def _entry(grid: Grid, key: CellKey, children: list[str], random: np.random.Generator) -> CellEntry:
    lower, upper = grid.bounds(key)
    inner = np.sort(random.uniform(0.02, 0.98, (2, 3)), axis=0) if key.level == 0 else np.array([[0.0] * 3, [1.0] * 3])
    low, high = (np.round(lower + (upper - lower) * row, 3).tolist() for row in inner)
    tiles = tuple((n, layer, int(random.integers(500, 9_000))) for n in range(3) for layer in range(2))
    picks = []
    for _ in range(26):
        gains = sorted(random.uniform(2.0, 300.0, 3).tolist(), reverse=True)
        picks.append(list(zip(random.permutation(6)[:3].tolist(), gains, strict=True)))
    entry = CellEntry(
        key=str(key),
        bounds=(tuple(low), tuple(high)),
        error=grid.pitch(key.level),
        hash=random.bytes(8).hex(),
        tiles=tiles,
        picked=pack_picks(picks),
        children=tuple(children),
        errors=tuple(sorted(random.integers(10, 120, 3).tolist())) if random.random() < 0.8 else (),
        losses=tuple(random.integers(0, 90, len(children)).tolist()) if random.random() < 0.8 else (),
    )
    if key.level > 0:
        return msgspec.structs.replace(entry, geometry=_merged(random)) if random.random() < 0.6 else entry
    meshes = (("ab" * 8, 7_000),) if random.random() < 0.5 else ()
    images = (("cd" * 8, 60_000),) if random.random() < 0.5 else ()
    full = int(random.integers(5_000, 90_000))
    drawn = int(random.integers(20, 400))
    levels = tuple(
        GeometryLevel(
            random.bytes(8).hex(),
            full // 4**n,
            10,
            len(meshes),
            tuple((f"{n}{name[1:]}", size // 4**n) for name, size in meshes),
            tuple((f"{n}{name[1:]}", size // 16**n) for name, size in images),
            tuple(sorted(random.integers(10 * n, 60 * n, 3).tolist())),
            drawn // 3**n,
        )
        for n in range(1, int(random.integers(1, 4)))
    )
    near = GeometryEntry(random.bytes(8).hex(), full, 10, len(meshes), meshes, images, drawn=drawn, levels=levels)
    return msgspec.structs.replace(entry, geometry=near, instances=_instances(grid, random))


def _merged(random: np.random.Generator) -> GeometryEntry:
    """Geometry of a cell above the leaves, some with images."""
    forms = []
    for n in range(int(random.integers(1, 4))):
        images = ((random.bytes(8).hex(), 4_000 // 4**n),) if random.random() < 0.7 else ()
        errors = tuple(sorted(random.integers(20 + 20 * n, 90 + 40 * n, 3).tolist()))
        forms.append((random.bytes(8).hex(), 8_000 // 4**n, 900 // 4**n, 0, (), images, errors, 900 // 4**n))
    return GeometryEntry(*forms[0], levels=tuple(GeometryLevel(*form) for form in forms[1:]))


def _instances(grid: Grid, random: np.random.Generator) -> tuple[InstancedMesh, ...]:
    """None, or up to two of five meshes, some with images, each placed once or twice."""
    found = []
    for mesh in sorted(random.permutation(5)[: int(random.integers(0, 3))].tolist()):
        levels = []
        for level in range(1 + mesh % 3):
            images = ((f"{level}e" * 8, 3_000 // 4**level),) if mesh % 2 else ()
            errors = (30 * level, 40 * level, 55 * level) if level else ()
            levels.append(MeshLevel(f"{mesh}{level}" * 8, 6_000 // 4**level, 2_000 // 4**level, images, errors))
        count = int(random.integers(1, 3))
        turns = []
        for _ in range(count):
            angle, size = random.uniform(0, 2 * np.pi), random.uniform(0.5, 1.5)
            x, y, z = random.uniform(0.1, 0.9, 3) * grid.leaf_size
            cos, sin = size * np.cos(angle), size * np.sin(angle)
            rows = np.round([cos, -sin, 0.0, x, sin, cos, 0.0, y, 0.0, 0.0, size, z], 4)
            turns.append(tuple(rows.tolist()))
        bounds = ((-0.7, -0.5, 0.0), (0.7, 0.5, 1.5 + 0.5 * mesh))
        ids = tuple(random.integers(1, 1_000, count).tolist())
        found.append(InstancedMesh(bounds, tuple(levels), ids, tuple(turns), _impostors(mesh)))
    return tuple(found)


def _impostors(mesh: int) -> tuple[Impostor, ...]:
    """Of three of the meshes, of two in two sizes."""
    found = []
    for number, rows in enumerate((96, 24)[: (0, 2, 1, 0, 2)[mesh]]):
        images = tuple((f"{mesh}{number}f{side}" * 4, rows * (8 + side)) for side in range(8 - 2 * number))
        found.append(Impostor(rows, images, (20 + 30 * number, 40 + 40 * number, 90)))
    return tuple(found)


def case_of(tree: CellTree, case: dict[str, Any]) -> dict[str, Any]:
    """The case with what is chosen."""
    regions = Regions(tree, Shape(case["near"]))
    pictures = Pictures(regions)
    pictures.keep(case["held"])
    link = Link(case["bandwidth"], case["latency"])
    scheduler = Scheduler(regions, [pictures], case["far"], link)
    for said in case["viewings"]:
        seen = {name: np.array(value) if isinstance(value, list) else value for name, value in said.items()}
        scheduler.follow(Viewing(fov=FOV, size=SIZE, **seen), said["time"])
    now, chosen = case["now"], []
    while len(chosen) < MOST and (choice := scheduler.next(now)):
        assert isinstance(choice.item, SentCell)
        chosen.append(
            {
                "cell": choice.item.cell,
                "geometry": choice.item.is_geometry,
                "keys": list(choice.item.keys),
                "bytes": choice.size,
                "benefit": float(f"{choice.benefit:.6g}"),
            }
        )
        link.sent(now, choice.size)
    return case | {"chosen": chosen}


def cases(tree: CellTree, random: np.random.Generator) -> list[dict[str, Any]]:
    """Viewers that stand, turn, fly straight and in curves, with all kinds of links, holding nothing or something."""
    low, high = tree.boxes[:, :3].min(axis=0), tree.boxes[:, 3:].max(axis=0)
    made = []
    for number in range(16):
        eye = low + (high - low) * random.uniform(-0.4, 1.4, 3)
        heading = random.uniform(0, 2 * np.pi)
        movement = ("standing", "turning", "straight", "curve")[number % 4]
        viewings = []
        for step in range(4):
            angle = heading + (0.15 * step if movement in ("turning", "curve") else 0.0)
            forward = np.array([np.cos(angle), np.sin(angle), -0.2])
            moves = movement in ("straight", "curve")
            velocity = 12.0 * np.array([np.cos(angle), np.sin(angle), 0.0]) if moves else np.zeros(3)
            viewings.append(
                {
                    "time": 0.5 * step,
                    "eye": np.round(eye, 3).tolist(),
                    "forward": (forward / np.linalg.norm(forward)).tolist(),
                    "velocity": velocity.tolist(),
                    "turning": 0.3 if movement in ("turning", "curve") else 0.0,
                    "acceleration": [0.0, 0.0, 0.5] if movement == "straight" else [0.0, 0.0, 0.0],
                }
            )
            eye = eye + velocity * 0.5
        case = {
            "movement": movement,
            "viewings": viewings,
            "now": 1.6,
            "far": float(np.linalg.norm(high - low)),
            "near": (None, 0.0, 20.0)[number % 3],
            "bandwidth": float((2_000, 20_000, 250_000)[number % 3]),
            "latency": 0.04,
            "held": [],
        }
        if number >= 8:
            first = case_of(tree, case)["chosen"]
            case["held"] = [key for item in first[::2] for key in item["keys"]]
        made.append(case_of(tree, case))
    return made


def written() -> dict[str, str]:
    """File name -> its text."""
    files = {}
    for name, grid, count in (
        ("flat", Grid(16.0, 32, (0.0, 0.0, -1.0), (2, 2, 0)), 40),
        ("solid", Grid(8.0, 16, (-3.0, 2.5, 10.0), (1, 1, 1)), 30),
    ):
        random = np.random.default_rng(5)
        reach = [2**level for level in grid.axis_levels]
        leaves = {CellKey(0, *(int(random.integers(-r, r)) for r in reach)) for _ in range(count)}
        tree = tree_over(grid, leaves, random)
        content = {
            "grid": {
                "leaf_size": grid.leaf_size,
                "resolution": grid.resolution,
                "corner": grid.corner,
                "axis_levels": grid.axis_levels,
            },
            "fov": FOV,
            "size": SIZE,
            "roots": [tree.entries[number].key for number in tree.roots],
            "entries": json.loads(msgspec.json.encode(tree.entries)),
            "cases": cases(tree, random),
        }
        files[f"{name}.json"] = json.dumps(content, separators=(",", ":")) + "\n"
    return files


def main() -> None:
    """Writes them."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, text in written().items():
        (FOLDER / name).write_text(text)


if __name__ == "__main__":
    main()
