"""Levels of detail of a mesh: what they keep, how wrong they are, and that the measure of that is one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.represent.chunk import Chunk, merge
from farfield.represent.geometry.distance import SampledSurface, surface_distance
from farfield.represent.geometry.levels import STEP, levels_of, simplified
from farfield.represent.geometry.likeness import PIXELS, Likeness
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material, Texture


def chunk_of(shape: trimesh.Trimesh, material: int = 0, owner: int = 1) -> Chunk:
    count = len(shape.faces)
    return Chunk(
        np.array(shape.vertices, np.float32),
        np.array(shape.vertex_normals, np.float32),
        np.empty((0, 2), np.float32),
        np.empty((0, 4), np.uint8),
        np.array(shape.faces, np.uint32),
        np.full(count, material, np.uint32),
        np.full(count, owner, np.uint32),
    )


def checkered() -> Texture:
    pixels = np.full((64, 64, 4), 255, np.uint8)
    y, x = np.divmod(np.arange(64 * 64), 64)
    pixels[..., :3] = np.where(((x // 8 + y // 8) % 2).reshape(64, 64, 1), [220, 60, 40], [30, 60, 120])
    return Texture(pixels)


def grid(steps: int, height: float = 0.0) -> Chunk:
    """A square of 2 m, in the middle a hill; texture coordinates from above."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-1, 1, steps + 1)] * 2))
    z = height * np.exp(-8 * (x * x + y * y))
    at = np.arange((steps + 1) ** 2).reshape(steps + 1, -1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    shape = trimesh.Trimesh(
        np.stack([x, y, z], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), process=False
    )
    return replace(chunk_of(shape), uvs=np.stack([(x + 1) / 2, (y + 1) / 2], 1).astype(np.float32))


def textured_cube(steps: int) -> Chunk:
    """Six charts side by side, each a sixth of the width of the texture."""
    sides = []
    for k, direction in enumerate(np.concatenate([np.eye(3), -np.eye(3)])):
        side = grid(steps)
        turn = np.stack([np.roll(direction, 1), np.cross(direction, np.roll(direction, 1)), direction]).T
        positions = ((side.positions + [0, 0, 1]) @ turn.T).astype(np.float32)
        normals = np.repeat(direction[None], len(positions), 0).astype(np.float32)
        uvs = (side.uvs * [1 / 6, 1] + [k / 6, 0]).astype(np.float32)
        sides.append(replace(side, positions=positions, normals=normals, uvs=uvs))
    return merge(sides)


def cards(count: int, seed: int = 3) -> Chunk:
    random = np.random.default_rng(seed)
    centers = random.normal(size=(count, 3))
    centers *= (random.uniform(0, 1, count) ** (1 / 3) / np.linalg.norm(centers, axis=1))[:, None]
    u, v = random.normal(size=(2, count, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    v -= (u * v).sum(1)[:, None] * u
    v /= np.linalg.norm(v, axis=1)[:, None]
    corners = [centers + 0.03 * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    quads = 4 * np.arange(count)[:, None] + np.array([[0, 1, 2, 0, 2, 3]])
    return chunk_of(trimesh.Trimesh(np.stack(corners, 1).reshape(-1, 3), quads.reshape(-1, 3), process=False))


def area_of(chunk: Chunk) -> float:
    a, b, c = (chunk.positions[chunk.triangles[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def check(level: Chunk, chunk: Chunk) -> None:
    """What holds of every level."""
    assert level.triangles.max(initial=0) < max(len(level.positions), 1)
    for array in (level.positions, level.normals, level.uvs):
        assert np.isfinite(array).all()
    assert set(level.materials) <= set(chunk.materials)
    assert set(level.objects) == set(chunk.objects)
    assert len(level.uvs) in (0, len(level.positions))
    assert len(level.colors) in (0, len(level.positions))
    np.testing.assert_allclose(np.linalg.norm(level.normals, axis=1), 1, atol=1e-4)
    corners = level.positions[level.triangles].astype(np.float64)
    assert (np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0).all()


TABLE = MaterialTable.build([Material(base_color=(0.5, 0.6, 0.4, 1)), Material(base_color=(0.2, 0.1, 0.7, 1))])
TEXTURED = MaterialTable.build([Material(texture=checkered())])


def test_a_sphere_stays_one() -> None:
    sphere = chunk_of(trimesh.creation.icosphere(5))
    level = simplified(sphere, 500)
    check(level, sphere)
    assert 0.9 * 500 <= len(level.triangles) <= 500
    radius = np.linalg.norm(level.positions, axis=1)
    assert radius.min() > 0.97
    assert radius.max() < 1.03
    facing = np.cross(
        *(level.positions[level.triangles[:, k]] - level.positions[level.triangles[:, 0]] for k in (1, 2))
    )
    assert (np.einsum("ij,ij->i", facing, level.positions[level.triangles].mean(1)) > 0).all()


def test_a_flat_grid_becomes_two_triangles_of_the_same_picture() -> None:
    flat = grid(32)
    level = simplified(flat, 2)
    check(level, flat)
    assert len(level.triangles) <= 8
    assert Likeness.of(flat, TEXTURED).errors(level)[-1] < 0.02


def test_a_textured_cube_keeps_its_charts() -> None:
    cube = textured_cube(8)
    level = simplified(cube, 12)
    check(level, cube)
    assert len(level.triangles) <= 24
    chart = np.floor(level.uvs[level.triangles].mean(1)[:, 0] * 6)
    across = level.uvs[level.triangles][..., 0] * 6 - chart[:, None]
    assert across.min() > -1e-4
    assert across.max() < 1 + 1e-4
    assert max(Likeness.of(cube, TEXTURED).errors(level)) < 0.05


def test_a_hill_keeps_its_texture_where_it_was() -> None:
    hill = grid(48, 0.6)
    level = simplified(hill, 300)
    np.testing.assert_allclose(level.uvs, (level.positions[:, :2] + 1) / 2, atol=0.02)


def test_vertex_colours_are_averaged_not_lost() -> None:
    sphere = chunk_of(trimesh.creation.icosphere(4))
    dark = sphere.positions[:, 2] < 0
    colors = np.where(dark[:, None], [10, 20, 30, 255], [200, 210, 220, 255]).astype(np.uint8)
    level = simplified(replace(sphere, colors=colors), 400)
    height = level.positions[:, 2]
    assert (level.colors[height > 0.3, :3] > 150).all()
    assert (level.colors[height < -0.3, :3] < 60).all()


@pytest.mark.parametrize("share", [2, 4, 16])
def test_cards_keep_their_area(share: int) -> None:
    crown = cards(2000)
    level = simplified(crown, len(crown.triangles) // share)
    check(level, crown)
    assert len(level.triangles) <= len(crown.triangles) // share
    assert area_of(level) == pytest.approx(area_of(crown), rel=0.15)
    middle, extent = crown.positions.mean(0), crown.positions.std(0)
    np.testing.assert_allclose(level.positions.mean(0), middle, atol=0.1)
    np.testing.assert_allclose(level.positions.std(0), extent, rtol=0.15)


def test_every_object_stays() -> None:
    boxes = []
    for n in range(40):
        shape = trimesh.creation.box((1, 1, 1 + n)).subdivide()
        shape.apply_translation((3 * (n % 8), 3 * (n // 8), 0))
        boxes.append(chunk_of(shape, n % 2, n + 1))
    town = merge(boxes)
    level = simplified(town, 80)
    check(level, town)
    assert len(level.triangles) < len(town.triangles)


@given(seed=st.integers(0, 2**32 - 1), wanted=st.integers(1, 400), colors=st.booleans(), uvs=st.booleans())
@settings(max_examples=40, deadline=None)
def test_any_triangles_stay_valid(seed: int, wanted: int, colors: bool, uvs: bool) -> None:
    """Heaps of triangles that share corners as it comes: no manifold, several materials and objects."""
    random = np.random.default_rng(seed)
    points, count = int(random.integers(3, 80)), int(random.integers(1, 400))
    normals = random.normal(size=(points, 3)).astype(np.float32)
    heap = Chunk(
        random.integers(0, 6, (points, 3)).astype(np.float32),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        random.uniform(0, 1, (points if uvs else 0, 2)).astype(np.float32),
        random.integers(0, 256, (points if colors else 0, 4), dtype=np.uint8),
        random.integers(0, points, (count, 3)).astype(np.uint32),
        random.integers(0, 2, count).astype(np.uint32),
        random.integers(0, 3, count).astype(np.uint32),
    )
    level = simplified(heap, wanted)
    assert len(level.triangles) <= count
    assert level.triangles.max(initial=0) < max(len(level.positions), 1)
    assert np.isfinite(level.positions).all()
    assert np.isfinite(level.uvs).all()
    assert set(level.objects) <= set(heap.objects)
    again = simplified(heap, wanted)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(level.surface, again.surface, strict=True))


def test_the_order_of_triangles_and_vertices_does_not_matter() -> None:
    hill = grid(24, 0.6)
    random = np.random.default_rng(5)
    order, places = random.permutation(len(hill.triangles)), random.permutation(len(hill.positions))
    where = np.argsort(places).astype(np.uint32)
    shuffled = replace(
        hill,
        positions=hill.positions[places],
        normals=hill.normals[places],
        uvs=hill.uvs[places],
        triangles=where[hill.triangles[order]],
    )
    one, other = simplified(hill, 200), simplified(shuffled, 200)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(one.surface, other.surface, strict=True))


def test_levels_are_ever_smaller_and_ever_worse() -> None:
    hill = grid(48, 0.6)
    levels = levels_of(hill, TEXTURED)
    assert len(levels) >= 2
    counts = [len(hill.triangles), *(len(level.chunk.triangles) for level in levels)]
    assert all(few <= 1.5 * many / STEP for many, few in pairwise(counts))
    errors = np.array([level.errors for level in levels])
    assert errors.shape[1] == len(PIXELS)
    assert (np.diff(errors, axis=0) >= 0).all()
    distances = [level.geometric_error for level in levels]
    assert distances == sorted(distances)
    assert distances[0] < 0.01


def test_what_cannot_be_less_has_no_levels() -> None:
    assert levels_of(chunk_of(trimesh.creation.box()), TABLE) == []
    with pytest.raises(OptionError, match="triangle at least"):
        simplified(chunk_of(trimesh.creation.box()), 0)


def test_a_mesh_is_like_itself_and_nothing_is_not() -> None:
    sphere = chunk_of(trimesh.creation.icosphere(3))
    likeness = Likeness.of(sphere, TABLE)
    assert likeness.errors(sphere) == (0.0,) * len(PIXELS)
    none = np.zeros(len(sphere.triangles), np.bool_)
    nothing = replace(sphere, triangles=sphere.triangles[none], materials=sphere.materials[none])
    np.testing.assert_allclose(likeness.errors(nothing), 1.0, rtol=1e-9)
    painted = replace(sphere, materials=np.ones_like(sphere.materials))
    assert min(likeness.errors(painted)) > 0.3


def test_rank_of_errors_is_that_of_flip() -> None:
    """Of levels of unlike meshes; docstring of likeness has more."""
    pytest.importorskip("flip_evaluator")
    stats = pytest.importorskip("scipy.stats")
    own: list[float] = []
    flip: list[float] = []
    for chunk, materials in ((cards(2000), TABLE), (grid(48, 0.6), TEXTURED), (textured_cube(8), TEXTURED)):
        likeness = Likeness.of(chunk, materials)
        for share in (3, 10, 30, 100):
            level = simplified(chunk, max(len(chunk.triangles) // share, 1))
            own.append(likeness.errors(level)[-1])
            flip.append(_flip(likeness, chunk, level))
    assert stats.spearmanr(own, flip)[0] >= 0.9


def _flip(likeness: Likeness, chunk: Chunk, level: Chunk) -> float:
    from farfield.geometry.color import srgb_from_linear
    from farfield.quality.metrics import flip_map

    wrong = empty = 0.0
    for frame in likeness.frames:
        pictures: list[NDArray[np.uint8]] = []
        for shown in (chunk, level):
            linear = frame.draw(shown, likeness.materials)
            height, width = linear.shape[0] // 2, linear.shape[1] // 2
            mean = linear.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
            pictures.append(np.floor(srgb_from_linear(mean) * 255 + 0.5).astype(np.uint8))
        sky = np.broadcast_to(pictures[0][0, 0], pictures[0].shape).copy()
        wrong += float(flip_map(*pictures).sum(dtype=np.float64))
        empty += float(flip_map(pictures[0], sky).sum(dtype=np.float64))
    return wrong / empty


def test_distance_is_that_of_planes_and_of_every_triangle() -> None:
    flat = grid(8)
    raised = replace(flat, positions=flat.positions + np.float32([0, 0, 0.25]))
    assert surface_distance(SampledSurface.of(flat), SampledSurface.of(raised)) == pytest.approx(0.25, abs=1e-6)
    rough = chunk_of(trimesh.creation.icosphere(2))
    points = np.random.default_rng(1).normal(size=(200, 3))
    found = SampledSurface.of(rough).distances(points)
    corners = rough.positions[rough.triangles].astype(np.float64)
    for point, distance in zip(points, found, strict=True):
        nearest = trimesh.triangles.closest_point(corners, np.repeat(point[None], len(corners), 0))
        assert distance == pytest.approx(np.linalg.norm(nearest - point, axis=1).min(), abs=1e-12)


def test_nothing_has_no_distance_from_nothing() -> None:
    flat = grid(2)
    none = SampledSurface.of(replace(flat, triangles=flat.triangles[:0]))
    assert surface_distance(none, none) == 0
    assert surface_distance(none, SampledSurface.of(flat)) == np.inf
