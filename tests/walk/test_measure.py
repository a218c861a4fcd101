"""Walkthrough quality against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from farfield.octree.grid import CellKey, Grid
from farfield.stream.tree import NONE, CellTree
from farfield.walk.measure import HeldBoards, HeldGeometry, HeldMerged, HeldMeshes, HeldPictures, Measure, samples
from farfield.walk.objects import WorldObjects
from farfield.walk.observer import Pose
from farfield.world.index import CellEntry, GeometryEntry, GeometryLevel, Impostor, InstancedMesh, MeshLevel
from farfield.world.keys import DynamicImpostor, geometry_key, mesh_key, orthoview_key, texture_key

GRID = Grid(leaf_size=8.0, resolution=64, corner=(0.0, 0.0, 0.0), axis_levels=(1, 1, 0))
LEAF, OTHER, ROOT = CellKey(0, 0, 0, 0), CellKey(0, 1, 0, 0), CellKey(1, 0, 0, 0)
HASH, MESH, FULL, COARSE = "0123456789abcdef", "ab" * 8, "fe" * 8, "fc" * 8
FRONT, SIDE, CORNER = 0, 1, 2
DIRECTIONS = [(FRONT, (0.0, -1.0, 0.0)), (SIDE, (1.0, 0.0, 0.0)), (CORNER, (0.5**0.5, -(0.5**0.5), 0.0))]
SIZE = (200, 200)
POSE = Pose(np.array([4.0, -16.0, 1.0]), np.array([0.0, 1.0, 0.0]), 90.0)
"""Looks at the first object from 19 m before it; 100 pixels are a metre at 1 m."""


def entry(key: CellKey) -> CellEntry:
    lower, upper = GRID.bounds(key).tolist()
    coarse = GeometryLevel(COARSE, 30, 10, 0)
    near = GeometryEntry(FULL, 100, 160, 1, ((MESH, 50),), levels=(coarse,)) if key.level == 0 else None
    tiles = tuple((number, layer, 10) for number, _ in DIRECTIONS for layer in (0, 1))
    return CellEntry(str(key), (tuple(lower), tuple(upper)), GRID.pitch(key.level), HASH, tiles, geometry=near)


TREE = CellTree(GRID, [entry(ROOT), entry(LEAF), entry(OTHER)], [NONE, 0, 0])


def objects(
    *boxes: tuple[float, ...], pieces: tuple[tuple[int, int, float], ...], instances: tuple[int, ...] | None = None
) -> WorldObjects:
    rows, leaves, shares = (np.array(column) for column in zip(*pieces, strict=True))
    count = len(boxes)
    return WorldObjects(
        np.arange(1, count + 1),
        np.array(boxes, np.float64),
        np.zeros(count, bool),
        np.full(count, 1000),
        rows,
        leaves,
        shares,
        np.full(len(rows), NONE) if instances is None else np.array(instances),
    )


ONE = objects((3, 3, 0, 5, 5, 2), pieces=((0, 1, 1.0),))
"""2 m high, in the first leaf."""


def tile(key: CellKey, direction: int, layer: int = 0) -> str:
    return orthoview_key(key, direction, layer, HASH)


def quality(of: WorldObjects, *held: str, near: float = 0.0, pose: Pose = POSE) -> float:
    measure = Measure(of, [HeldGeometry(TREE, near), HeldPictures(TREE, DIRECTIONS)], SIZE)
    measure.hold(held)
    return measure.sample(pose).quality


def board(letter: str, side: int) -> str:
    return texture_key(letter * 15 + str(side))


def impostor(letter: str, rows: int, sides: int) -> Impostor:
    return Impostor(rows, tuple((board(letter, side).split("/")[1], 100) for side in range(sides)))


def statues() -> CellTree:
    """One mesh with boards of 8 and of 4 rows: turned by 90 degrees, so that its x is the world's y; mirrored along x;
    and another mesh that has none.
    """
    box = ((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    turned = (0, -1, 0, 4, 1, 0, 0, 4, 0, 0, 1, 0)
    mirrored = (-1, 0, 0, 4, 0, 1, 0, 4, 0, 0, 1, 0)
    levels = MeshLevel(MESH, 500, 1000), MeshLevel("ad" * 8, 50, 10, (("ae" * 8, 9),), (9, 9, 9))
    one = InstancedMesh(box, levels, (1, 2), (turned, mirrored), (impostor("e", 8, 4), impostor("c", 4, 8)))
    other = InstancedMesh(box, (MeshLevel("af" * 8, 5, 10),), (3,), (turned,))
    leaf = msgspec.structs.replace(entry(LEAF), instances=(one, other))
    return CellTree(GRID, [entry(ROOT), leaf, entry(OTHER)], [NONE, 0, 0])


STATUES = statues()


def by_boards(instance: int, *held: str, top: float = 2.0, pose: Pose = POSE) -> float:
    """Quality of ONE, or what of it is so high, of an instance of STATUES."""
    seen = objects((3, 3, 0, 5, 5, top), pieces=((0, 1, 1.0),), instances=(instance,))
    measure = Measure(seen, [HeldBoards(STATUES)], SIZE)
    measure.hold(held)
    return measure.sample(pose).quality


def test_boards_by_rows_and_angle_in_the_frame_of_their_mesh() -> None:
    # 10.53 pixels again; the eye lies at -x of the mesh, which is turned.
    rows = 8 * 19 / 200
    assert by_boards(0, board("e", 2)) == pytest.approx(rows, rel=1e-5)
    assert by_boards(0, board("c", 4)) == pytest.approx(rows / 2, rel=1e-5)
    assert by_boards(0, board("e", 2), board("c", 4)) == pytest.approx(rows, rel=1e-5)
    assert [by_boards(0, board("e", side)) for side in (0, 1, 3)] == pytest.approx([0, 0, 0])
    aside = (0.5**0.5 / 0.75**0.5) ** 3
    for side in (3, 5):
        assert by_boards(0, board("c", side)) == pytest.approx(rows / 2 * aside, rel=1e-5)


def test_boards_of_what_is_mirrored() -> None:
    """From the world's +x one is at -x of the mesh."""
    pose = Pose(np.array([24.0, 4.0, 1.0]), np.array([-1.0, 0.0, 0.0]), 90.0)
    assert by_boards(1, board("e", 2), pose=pose) == pytest.approx(8 * 19 / 200, rel=1e-5)
    assert by_boards(1, board("e", 0), pose=pose) == 0
    assert by_boards(1, board("e", 3)) == pytest.approx(8 * 19 / 200, rel=1e-5)


def test_boards_from_above_show_less() -> None:
    # 45 degrees above the middle.
    pose = Pose(np.array([4.0, -16.0, 21.0]), np.array([0.0, 0.5**0.5, -(0.5**0.5)]), 90.0)
    height = Measure(ONE, [], SIZE).look(pose).sight.height[0]
    found = by_boards(0, *(board("e", side) for side in range(4)), pose=pose)
    assert found == pytest.approx(8 / height * (0.5 / 0.75) ** 1.5, rel=1e-5)
    # One that was made for just there, and of the others none: of another mesh, size or side.
    made = DynamicImpostor(MESH, 8, 8, 6)
    assert by_boards(0, board("e", 2), made.key, pose=pose) == pytest.approx(8 / height, rel=1e-5)
    others = (replace(made, mesh="af" * 8), replace(made, rows=9), replace(made, turn=0))
    assert by_boards(0, *(other.key for other in others), pose=pose) == 0


def test_a_part_of_a_mesh_has_its_part_of_the_rows() -> None:
    # Half of 8 rows, half as high: as sharp as the whole.
    assert by_boards(0, board("e", 2), top=1.0) == pytest.approx(8 * 19 / 200, rel=1e-5)


def test_boards_of_nothing_else() -> None:
    every = [board(letter, side) for letter in "ec" for side in range(8)]
    assert by_boards(2, *every) == by_boards(NONE, *every) == 0.0
    assert by_boards(0, mesh_key(MESH), "texture/" + "ae" * 8) == 0.0


def test_levels_of_meshes_need_their_images() -> None:
    seen = objects((3, 3, 0, 5, 5, 2), pieces=((0, 1, 1.0),), instances=(1,))
    # A metre before it a face of 10 has 4,000 pixels, one of 1,000 has 40.
    close = Pose(np.array([4.0, 2.0, 1.0]), np.array([0.0, 1.0, 0.0]), 90.0)
    coarse = mesh_key("ad" * 8), texture_key("ae" * 8)
    for held, expected in [(coarse[:1], 0.0), (coarse, 0.1), ((*coarse, mesh_key(MESH)), 1.0), ((board("e", 3),), 0.0)]:
        measure = Measure(seen, [HeldMeshes(STATUES)], SIZE)
        measure.hold(held)
        assert measure.sample(close).quality == pytest.approx(expected)


def test_nothing_is_held() -> None:
    measure = Measure(ONE, [HeldPictures(TREE, DIRECTIONS)], SIZE)
    found = measure.sample(POSE)
    assert (found.quality, found.missing, found.in_view) == (0.0, 1, 1)


def test_nothing_is_in_view() -> None:
    away = Pose(POSE.eye, np.array([0.0, -1.0, 0.0]), 90.0)
    assert math.isnan(quality(ONE, pose=away))


def test_pictures_by_rows_and_angle() -> None:
    # 2 m at 19 m are 200 / 19 = 10.53 pixels; pictures of the leaf have 16 rows of it, those above 8.
    assert quality(ONE, tile(LEAF, FRONT)) == pytest.approx(1.0)
    assert quality(ONE, tile(ROOT, FRONT)) == pytest.approx(8 * 19 / 200, rel=1e-5)
    assert quality(ONE, tile(LEAF, SIDE)) == pytest.approx(0.0)
    corner = (0.5**0.5 / 0.75**0.5) ** 3
    assert quality(ONE, tile(LEAF, CORNER)) == pytest.approx(corner, rel=1e-5)
    assert quality(ONE, tile(LEAF, CORNER), tile(ROOT, FRONT)) == pytest.approx(max(corner, 8 * 19 / 200), rel=1e-5)


def test_what_lies_behind_is_no_picture_of_its_own() -> None:
    assert quality(ONE, tile(LEAF, FRONT, layer=1)) == 0.0


def test_pictures_without_a_row_show_nothing() -> None:
    low = objects((3, 3, 0, 5, 5, 0.1), pieces=((0, 1, 1.0),))
    assert quality(low, tile(LEAF, FRONT)) == 0.0


def test_geometry_needs_its_meshes_and_to_be_near() -> None:
    leaf, mesh = geometry_key(LEAF, FULL), mesh_key(MESH)
    assert quality(ONE, leaf, near=17.0) == 0.0
    assert quality(ONE, leaf, mesh, near=17.0) == 1.0
    # The leaf begins 16 m away, and nobody knows how many triangles its instance has.
    assert quality(ONE, leaf, mesh, near=15.0) == 0.0


def test_few_triangles_are_drawn_from_afar_too() -> None:
    assert quality(ONE, geometry_key(LEAF, COARSE), near=15.0) == pytest.approx(1.0)


def test_coarser_geometry_by_its_faces() -> None:
    # Of 1,000 faces a fifth, by the bytes of the forms, 30 of 150. From afar faces of both take less than a pixel.
    assert quality(ONE, geometry_key(LEAF, COARSE), near=17.0) == pytest.approx(1.0)
    close = Pose(np.array([4.0, 2.0, 1.0]), np.array([0.0, 1.0, 0.0]), 90.0)
    # A metre before it, 200 pixels a side: 40 pixels a face of the full model, 200 a face of the coarse one.
    assert quality(ONE, geometry_key(LEAF, COARSE), near=17.0, pose=close) == pytest.approx((40 / 200) ** 0.5)


def test_merged_geometry_shows_what_lies_below_it_but_for_instances() -> None:
    forms = GeometryEntry("da" * 8, 60, 64, 0, (), (("db" * 8, 20),), (9,), 64, (GeometryLevel("dc" * 8, 9, 16, 0),))
    root = msgspec.structs.replace(entry(ROOT), geometry=forms)
    tree = CellTree(GRID, [root, entry(LEAF), entry(OTHER)], [NONE, 0, 0])
    close = Pose(np.array([4.0, 2.0, 1.0]), np.array([0.0, 1.0, 0.0]), 90.0)

    def shown(*held: str, instance: int = NONE) -> float:
        seen = objects((3, 3, 0, 5, 5, 2), pieces=((0, 1, 1.0),), instances=(instance,))
        measure = Measure(seen, [HeldMerged(tree)], SIZE)
        measure.hold(held)
        return measure.sample(close).quality

    fine, coarse, image = geometry_key(ROOT, "da" * 8), geometry_key(ROOT, "dc" * 8), texture_key("db" * 8)
    assert shown(fine) == 0.0, "without its image"
    # Of 320 triangles in both leaves a fifth: of the object's 1,000 on 40,000 pixels 200.
    assert shown(fine, image) == pytest.approx((40 / 200) ** 0.5)
    assert shown(coarse) == pytest.approx((40 / 800) ** 0.5)
    assert shown(coarse, fine, image) == pytest.approx((40 / 200) ** 0.5)
    assert shown(fine, image, instance=0) == 0.0


def test_objects_count_by_what_is_seen_of_them() -> None:
    # The second is twice as far away and in another leaf: seen from 40 m a quarter of the pixels.
    two = objects((3, 4, 0, 5, 4, 2), (13, 24, 0, 17, 24, 4), pieces=((0, 1, 1.0), (1, 2, 1.0)))
    first, second = (200 / 20) ** 2, (400 / 40) ** 2
    assert quality(two, tile(LEAF, FRONT)) == pytest.approx(first / (first + second), rel=1e-5)


def test_pieces_count_by_their_surface() -> None:
    halved = objects((3, 3, 0, 9, 5, 2), pieces=((0, 1, 0.75), (0, 2, 0.25)))
    found = quality(halved, geometry_key(LEAF, FULL), mesh_key(MESH), near=100.0)
    assert found == pytest.approx(0.75)


def test_what_arrives_counts_from_then_on() -> None:
    measure = Measure(ONE, [HeldPictures(TREE, DIRECTIONS)], SIZE)
    found = samples(
        measure, [(0.5, tile(ROOT, FRONT)), (1.5, tile(LEAF, FRONT))], [(at, POSE) for at in (0.0, 1.0, 2.0)]
    )
    assert [one.quality for one in found] == pytest.approx([0.0, 8 * 19 / 200, 1.0], rel=1e-5)
