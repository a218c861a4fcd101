"""Merged geometry: charts that never meet, colours that come through, corners that neighbours share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.represent.chunk import Chunk, merge
from farfield.represent.geometry.atlas import Charts, charts_of, packed
from farfield.represent.geometry.hlod import ColoredSurface, MergedForm, colored, plain_shape
from farfield.represent.geometry.likeness import Likeness
from farfield.represent.geometry.reduction import reduced
from farfield.represent.geometry.walls import Walls
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material
from represent.test_levels import TEXTURED, chunk_of, grid, textured_cube

MANY = 1 << 20
PLAIN = MaterialTable.build([Material(base_color=(0.8, 0.4, 0.2, 1), double_sided=False)])


def form_of(chunk: Chunk, materials: MaterialTable, triangles: int, texel: float, most: int = MANY) -> MergedForm:
    shape = reduced(plain_shape(chunk, materials), triangles)
    return colored(shape, ColoredSurface.of(chunk, materials), texel, most)


def errors(form: MergedForm, chunk: Chunk, materials: MaterialTable) -> tuple[float, ...]:
    like, own = Likeness.of(chunk, materials), MaterialTable.build(form.materials)
    return like.errors_by((form.chunk, own) for _ in like.frames)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.01, 90), st.floats(0.01, 60)), min_size=1, max_size=60), st.floats(0.5, 4))
def test_charts_never_overlap(sizes: list[tuple[float, float]], texel: float) -> None:
    size = np.sort(np.array(sizes), axis=1)[:, ::-1]
    flat = np.zeros((len(size), 3, 2))
    flat[:, 1], flat[:, 2, 1] = size, size[:, 1]
    charts = Charts(np.arange(len(size)), flat, size, size.prod(axis=1))
    chosen = np.arange(0, len(size), 2)
    atlas = packed(charts, chosen, texel)
    taken = np.zeros((atlas.height, atlas.width), int)
    for x, y, width, height in atlas.boxes.tolist():
        assert taken[y : y + height, x : x + width].shape == (height, width)
        taken[y : y + height, x : x + width] += 1
    assert taken.max() == 1
    assert atlas.rows.tolist() == chosen.tolist()
    low, high = atlas.boxes[:, None, :2], atlas.boxes[:, None, :2] + atlas.boxes[:, None, 2:]
    # A bilinear look-up reaches half a texel around.
    assert (atlas.corners >= low + 0.5 - 1e-9).all()
    assert (atlas.corners <= high - 0.5 + 1e-9).all()


def test_a_cube_has_six_charts() -> None:
    charts = charts_of(textured_cube(4))
    assert len(charts) == 6
    np.testing.assert_allclose(charts.areas, 4, rtol=1e-5)
    np.testing.assert_allclose(charts.size, 2, rtol=1e-5)


def test_an_image_comes_through() -> None:
    for chunk, triangles in ((grid(32, 1.0), 200), (textured_cube(8), 12)):
        form = form_of(chunk, TEXTURED, triangles, 2 / 128)
        assert form.texture is not None
        assert (form.texture.pixels[..., 3] == 255).all()
        assert len(form.chunk.triangles) <= 2 * triangles
        assert max(errors(form, chunk, TEXTURED)) < 0.09


def test_colours_of_corners_come_through() -> None:
    random = np.random.default_rng(1)
    chunk = replace(grid(16), colors=random.integers(60, 255, (289, 4)).astype(np.uint8))
    form = form_of(chunk, PLAIN, 2, 2 / 64)
    assert form.texture is not None
    assert len(form.chunk.triangles) <= 8
    assert max(errors(form, chunk, PLAIN)) < 0.08


def test_what_is_small_has_colours_at_its_corners() -> None:
    cube = textured_cube(2)
    small = replace(cube, positions=(cube.positions * 0.02 + [0, 0, 1]).astype(np.float32))
    both = merge([grid(8), small])
    form = form_of(both, TEXTURED, 10**6, 2 / 64)
    assert len(form.materials) == 2
    assert sorted(material.texture is not None for material in form.materials) == [False, True]
    # White where there is an image: the colours would be multiplied.
    textured = np.array([material.texture is not None for material in form.materials])[form.chunk.materials]
    assert (form.chunk.colors[form.chunk.triangles[textured]] == 255).all()
    assert (form.chunk.colors[form.chunk.triangles[~textured]] != 255).any()
    far = form_of(both, TEXTURED, 10**6, 2.0)
    assert far.texture is None
    assert len(far.materials) == 1
    mean = LINEAR_OF_BYTE[far.chunk.colors[:81, :3]].mean(axis=0)
    pixels = LINEAR_OF_BYTE[TEXTURED.arrays.pixels[: 64 * 64, :3]].mean(axis=0)
    np.testing.assert_allclose(mean, pixels, atol=0.03)


def test_one_colour_needs_no_image() -> None:
    cube = replace(textured_cube(4), uvs=np.empty((0, 2), np.float32))
    form = form_of(cube, PLAIN, 12, 2 / 256)
    assert form.texture is None
    assert form.materials == (Material(double_sided=False),)
    assert max(errors(form, cube, PLAIN)) < 0.03


def test_what_is_unlit_stays_so() -> None:
    lamp, ground = grid(4), grid(4)
    raised = replace(lamp, positions=lamp.positions + np.float32([0, 0, 0.01]), materials=lamp.materials + np.uint32(1))
    chunk = merge([ground, raised])
    table = MaterialTable.build([Material(base_color=(0, 1, 0, 1)), Material(base_color=(1, 0, 0, 1), unlit=True)])
    form = form_of(chunk, table, 4, 2 / 64)
    for number, material in enumerate(form.materials):
        seen = form.chunk.colors[form.chunk.triangles[form.chunk.materials == number], :3].reshape(-1, 3)
        assert (seen == ([255, 0, 0] if material.unlit else [0, 255, 0])).all()


def test_an_atlas_has_no_more_texels_than_it_may() -> None:
    form = form_of(grid(8), TEXTURED, 10**6, 2 / 256, 40**2)
    assert form.texture is not None
    assert 20**2 < form.texture.pixels[..., 0].size <= 40**2


def test_fixed_corners_stay() -> None:
    chunk = grid(24, 0.7)
    fixed = np.random.default_rng(5).random(len(chunk.positions)) < 0.03
    level = reduced(chunk, 200, fixed)
    assert len(level.triangles) <= 200
    kept = {point.tobytes() for point in level.positions}
    assert all(point.tobytes() in kept for point in chunk.positions[fixed])


def test_fewer_triangles_than_fixed_corners_need_are_not_forced() -> None:
    chunk = grid(8, 0.7)
    level = reduced(chunk, 2, np.ones(len(chunk.positions), np.bool_))
    assert len(level.triangles) == len(chunk.triangles)


def cut(chunk: Chunk, wanted: NDArray[np.bool_], shift: float) -> Chunk:
    """Some triangles, moved along x."""
    rows = chunk.triangles[wanted]
    used, corners = np.unique(rows, return_inverse=True)
    shape = trimesh.Trimesh(chunk.positions[used] + [shift, 0, 0], corners.reshape(-1, 3), process=False)
    return replace(chunk_of(shape), normals=chunk.normals[used])


def test_neighbours_keep_the_same_corners() -> None:
    """A hill in two cells of 1 m beside each other, x from -1 to 0 and from 0 to 1."""
    hill = grid(64, 0.4)
    positions = hill.positions + np.float32([0, 1, 0.1])
    slope = trimesh.Trimesh(positions, hill.triangles, process=False)
    chunk = replace(hill, positions=positions, normals=np.array(slope.vertex_normals, np.float32))
    left = positions[chunk.triangles].mean(axis=1)[:, 0] < 0
    walls = Walls(np.array([1.0, 2.0, 2.0]), 1 / 1024)
    for square, triangles in ((0.06, 400), (0.25, 100)):
        seen = []
        for part, wall in ((cut(chunk, left, 1.0), 1.0), (cut(chunk, ~left, 0.0), 0.0)):
            gathered = walls.gathered(part, square)
            shape = walls.with_normals(reduced(gathered.chunk, triangles, gathered.fixed), gathered)
            assert len(shape.triangles) <= 1.25 * triangles
            at = shape.positions[:, 0] == wall
            assert 5 < at.sum() <= 3 * 2 / square
            assert np.unique(shape.positions[at], axis=0).shape[0] == at.sum()
            seen.append(np.unique(np.concatenate([shape.positions[at, 1:], shape.normals[at]], axis=1), axis=0))
        np.testing.assert_array_equal(*seen)
