"""A world of cells without a store: what the scheduler knows of one."""

from __future__ import annotations

import msgspec

from farfield.octree.grid import CellKey, Grid
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

GRID = Grid(leaf_size=8.0, resolution=8, corner=(0.0, 0.0, 0.0), axis_levels=(3, 3, 0))
TILE_BYTES = 1_000
GEOMETRY_BYTES = 20_000
SHARED = ("ab" * 8, 5_000)


STATUE = (MeshLevel("5a" * 8, 6_000, 2_000), MeshLevel("5b" * 8, 700, 120, (("5c" * 8, 300),), (30, 40, 50)))
"""Levels of a mesh that is placed in every fourth leaf."""


BOARDS = Impostor(64, tuple((f"6{side}" * 8, 900 + side) for side in range(8)), (20, 40, 80))
"""Images of it."""


MERGED = GeometryEntry(
    "de" * 8,
    900,
    60,
    0,
    (),
    (("dd" * 8, 400),),
    (20, 60, 120),
    60,
    (GeometryLevel("df" * 8, 250, 15, 0, (), (), (50, 120, 200), 15),),
)
"""Geometry of a cell above the leaves."""


def flat_tree(
    height: float = 4.0,
    drawn: int = 0,
    statues: bool = False,
    boards: bool = False,
    merged: bool = False,
    geometry_bytes: int = GEOMETRY_BYTES,
) -> CellTree:
    """8 x 8 leaves of 8 m and all above them; every cell has three tiles, of which two are worth their bytes.

    Every other leaf places a mesh that they share. height: metres of what is in the cells. drawn: triangles of a leaf.
    statues: whether every fourth leaf lists a STATUE of 2 m in its middle, too; boards: with BOARDS of it.
    merged: whether cells above leaves have geometry of their own. geometry_bytes: of a leaf.
    """
    levels = [[CellKey(3, 0, 0, 0)]]
    for level in (2, 1, 0):
        levels.append([child for key in levels[-1] for child in GRID.children(key)])
        assert all(key.level == level for key in levels[-1])
    keys = [key for cells in levels for key in cells]
    number = {key: n for n, key in enumerate(keys)}
    parents = [number[GRID.parent(key)] if key.level < 3 else NONE for key in keys]
    return CellTree(
        GRID, [_entry(key, height, drawn, statues, boards, merged, geometry_bytes) for key in keys], parents
    )


def _entry(
    key: CellKey, height: float, drawn: int, statues: bool, boards: bool, merged: bool, geometry_bytes: int
) -> CellEntry:
    lower, upper = GRID.bounds(key).tolist()
    picked = pack_picks([(n, 100.0), ((n + 1) % 3, 40.0), ((n + 2) % 3, 5.0)] for n in _starts())
    entry = CellEntry(
        key=str(key),
        bounds=((lower[0], lower[1], 0.0), (upper[0], upper[1], height)),
        error=GRID.pitch(key.level),
        hash="0123456789abcdef",
        tiles=((0, 0, TILE_BYTES), (1, 0, TILE_BYTES), (2, 1, TILE_BYTES)),
        picked=picked,
        children=tuple(map(str, GRID.children(key))),
    )
    if key.level > 0:
        return msgspec.structs.replace(entry, geometry=MERGED) if merged else entry
    meshes = (SHARED,) if (key.x + key.y) % 2 else ()
    instances: tuple[InstancedMesh, ...] = ()
    if statues and key.x % 2 == key.y % 2 == 0:
        place = (1.0, 0.0, 0.0, 4.0, 0.0, 1.0, 0.0, 4.0, 0.0, 0.0, 1.0, 0.0)
        box, impostors = ((-0.5, -0.5, 0.0), (0.5, 0.5, 2.0)), (BOARDS,) if boards else ()
        instances = (InstancedMesh(box, STATUE, (1 + key.x + 8 * key.y,), (place,), impostors),)
    near = GeometryEntry("fe" * 8, geometry_bytes, 100, 1, meshes, drawn=drawn)
    return msgspec.structs.replace(entry, geometry=near, instances=instances)


def _starts() -> list[int]:
    """For each view bin the first of its three tiles."""
    return [n % 3 for n in range(26)]
